"""Template values of the gap as residual, prediction and attractor; page ``verify.html``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from herringbone_sim.gap.further_runs import Repetition
from herringbone_sim.gap.verification.residual_gap import GapNumbers
from herringbone_sim.gap.verification.senses import Senses
from herringbone_sim.views.numbers import figure, percent
from herringbone_sim.views.pages.gap import words
from herringbone_sim.views.pages.html import Table, render

NAMES = {
    "residual": "Residual",
    "prediction": "Prediction over a short horizon",
    "attractor": "Attractor",
}
TEXTS = {
    "residual": "what the model leaves of every sample",
    "prediction": "RMS error of the mesh displacements",
    "attractor": "energy distance of the Poincaré sections",
}
COLUMNS = (
    ("nominal", "before"),
    ("augmented", "after"),
    ("noise_floor", "noise floor"),
    ("runner_up", "runner-up"),
    ("closure", "closure"),
    ("closure_runner_up", "of the runner-up"),
)
DISTANCES = (
    ("contact", "contact", "share of time"),
    ("load_sharing", "load sharing", "share"),
    ("spectrum", "spectrum", "dB"),
    ("section", "section density", "σ"),
)
MODELS = (
    ("nominal", "before"),
    ("augmented", "after"),
    ("floor", "floor"),
    ("runner_up", "runner-up"),
)


def senses_values(
    senses: Senses | None, runner_up: Sequence[str] = ()
) -> dict[str, object] | None:
    """Return the template values of the gap on held-out runs in three senses.

    Args:
        senses: gap as residual, prediction and attractor; None, then returned, if not measured.
        runner_up: ids of the effects of the runner-up.
    """
    if senses is None:
        return None
    numbers = {name: gap.numbers() for name, gap in senses.gaps.items()}
    return {
        "table": numbers_table(numbers, _horizon(senses)),
        "runner_up": " and ".join(runner_up) if _has_runner_up(numbers) else "",
    }


def numbers_table(senses: Mapping[str, GapNumbers], horizon: str = "") -> Table:
    """Return a table with a row per sense; ``horizon`` is text added to that of prediction."""
    control = _has_runner_up(senses)
    columns = [c for c in COLUMNS if control or "runner_up" not in c[0]]
    rows = [
        _row(NAMES[name], TEXTS[name] + horizon * (name == "prediction"), senses[name], columns)
        for name in NAMES
        if name in senses
    ]
    head = ["in the sense of", "unit", *(title for _, title in columns)]
    return Table(head, rows, numeric=range(1, len(head)))


def _has_runner_up(senses: Mapping[str, GapNumbers]) -> bool:
    return any(math.isfinite(numbers.runner_up) for numbers in senses.values())


def _row(
    name: str, text: str, numbers: GapNumbers, columns: Sequence[tuple[str, str]]
) -> list[str]:
    factor, unit = words.DISPLAY_UNITS.get(numbers.unit, (1.0, numbers.unit))
    cells = [unit]
    for key, _ in columns:
        value = getattr(numbers, key)
        shown = percent(value) if "closure" in key else figure(factor * value)
        cells.append(shown if math.isfinite(value) else "–")
    return [Markup("{}<br><small>{}</small>").format(name, text), *cells]


def _horizon(senses: Senses) -> str:
    cycles = [cycles for cycles in senses.horizon_cycles.values() if math.isfinite(cycles)]
    if not cycles:
        return ""
    ends = dict.fromkeys(figure(end, 2) for end in (min(cycles), max(cycles)))
    return f", {' … '.join(ends)} mesh cycles ahead, at most half a Lyapunov time"


def distances_values(senses: Senses | None) -> dict[str, object] | None:
    """Return the template values of the distance of each model's motion from the rig's, by run.

    None without any run.
    """
    runs = list(senses.numbers.get("floor", {})) if senses else []
    if senses is None or not runs:
        return None
    models = [(senses.numbers[key], title) for key, title in MODELS if key in senses.numbers]
    rows = [
        [run if i == 0 else "", title, *_distances(numbers[run])]
        for run in runs
        for i, (numbers, title) in enumerate(models)
    ]
    head = ["run", "", *(f"{title} [{unit}]" for _, title, unit in DISTANCES)]
    head.append("largest exponent [1/cycle]")
    return {"title": f"{len(runs)} runs", "table": Table(head, rows, numeric=range(2, len(head)))}


def _distances(motion: Mapping[str, Any]) -> list[str]:
    """Return the table cells of a model: distances, and largest exponent where known."""
    exponent = motion.get("exponent", {}).get("value", math.nan)
    cells = [figure(motion["distance"][name]) for name, _, _ in DISTANCES]
    return [*cells, figure(exponent, 2) if math.isfinite(exponent) else ""]


def verify_page(result: Repetition) -> str:
    """Return the HTML of the page: the gap on additional runs beside the gap in the report."""
    earlier, gap = result.earlier, result.senses.residual
    effects = "; and ".join(words.effect_words(effect) for effect in earlier.effects)
    here = gap.closed(role=None)
    if not math.isfinite(here):
        closes = ["how much of the gap closes here is not known"]
    elif here < 0.0:
        closes = ["the gap is larger with it here, not smaller"]
    else:
        closes = [f"{percent(min(here, 1.0))} of the gap closes here"]
    reported = earlier.numbers.get("residual")
    if reported and reported.metric == gap.metric and math.isfinite(reported.closure):
        before = percent(min(reported.closure, 1.0))
        closes.append(f"{before} in the report")
    title = words.capital(effects or earlier.verdict)
    numbers = {name: gap.numbers(None) for name, gap in result.senses.gaps.items()}
    return render(
        "verify.html",
        title=f"Gap: {result.campaign}",
        campaign=result.campaign,
        headline=f"{title}: {', '.join(closes)}",
        diagnosed=earlier.campaign,
        runs=len(gap.runs),
        here=numbers_table(numbers, _horizon(result.senses)),
        reported=numbers_table(earlier.numbers),
        attractor=distances_values(result.senses),
        undecidable=result.undecidable,
    )
