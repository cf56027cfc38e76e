"""Tables of the gap by residual, prediction and attractor, and ``verify.html``."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.pages.gap import words
from herringbone_sim.views.pages.gap.style import STYLE
from herringbone_sim.views.pages.gap.words import Part, figure, known, mapping, percent, sequence
from herringbone_sim.views.pages.html import bullets, folded, html_page, section, table

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
DISPLAY_UNITS = {"m": (1e6, "µm"), "sigma": (1.0, "σ"), "m/s^2": (1.0, "m/s²")}
MODELS = (
    ("nominal", "before"),
    ("augmented", "after"),
    ("floor", "floor"),
    ("runner_up", "runner-up"),
)


def senses_table(gap: Part) -> str:
    """Table of a gap: before, after, floor and runner-up by measure; empty without ``senses``."""
    senses = mapping(gap.get("senses"))
    measures = {name: mapping(senses.get(name)) for name in NAMES if name in senses}
    if not measures:
        return ""
    control = any(known(sense.get("runner_up")) is not None for sense in measures.values())
    columns = [c for c in COLUMNS if control or "runner_up" not in c[0]]
    rows = [_row(name, sense, columns) for name, sense in measures.items()]
    head = ["in the sense of", "unit", *(title for _, title in columns)]
    others = " and ".join(str(effect) for effect in sequence(gap.get("runner_up_effects")))
    note = f"<p><small>The runner-up: {escape(others)}.</small></p>" if control and others else ""
    return table(head, rows, numeric=range(1, len(head))) + note


def _row(name: str, sense: Part, columns: Sequence[tuple[str, str]]) -> list[str]:
    factor, unit = DISPLAY_UNITS.get(
        str(sense.get("unit")), (1.0, words.word(sense.get("unit"), ""))
    )
    cells = [unit]
    for key, _ in columns:
        value = sense.get(key)
        cells.append(_closure(value) if "closure" in key else _scaled(value, factor))
    text = TEXTS[name] + (_horizon(sense) if name == "prediction" else "")
    return [f"{NAMES[name]}<br><small>{escape(text)}</small>", *map(escape, cells)]


def _horizon(sense: Part) -> str:
    runs = [mapping(run) for run in sequence(sense.get("runs"))]
    horizons = (known(run.get("horizon_cycles")) for run in runs)
    cycles = [horizon for horizon in horizons if horizon is not None]
    if not cycles:
        return ""
    ends = dict.fromkeys(figure(end, 2) for end in (min(cycles), max(cycles)))
    return f", {' … '.join(ends)} mesh cycles ahead, at most half a Lyapunov time"


def _scaled(value: object, factor: float) -> str:
    number = known(value)
    return "–" if number is None else figure(factor * number)


def _closure(value: object) -> str:
    return "–" if known(value) is None else percent(value)


def _closed(value: object) -> str:
    """Closure in percent, at most 100."""
    closure = known(value)
    return percent(None if closure is None else min(closure, 1.0))


def distances_table(attractor: Part) -> str:
    """Table: distance of each model's motion from that of the rig, by run; empty without any."""
    runs = list(mapping(attractor.get("floor")))
    models = [(key, title) for key, title in MODELS if mapping(attractor.get(key))]
    rows = [row for run in runs for row in _distance_rows(attractor, run, models)]
    if not rows:
        return ""
    head = ["run", "", *(f"{title} [{unit}]" for _, title, unit in DISTANCES)]
    head.append("largest exponent [1/cycle]")
    lead = (
        "Distance of each model's motion from the rig's, over as many cycles as were recorded; "
        "the floor is one half of the recording against the other."
    )
    content = table(head, rows, numeric=range(2, len(head)))
    return folded(f"{len(runs)} runs", f"<p>{lead}</p>{content}")


def _distance_rows(attractor: Part, run: str, models: list[tuple[str, str]]) -> list[list[str]]:
    rows = []
    for i, (key, title) in enumerate(models):
        motion = mapping(mapping(attractor.get(key)).get(run))
        distance = mapping(motion.get("distance"))
        exponent = known(mapping(motion.get("exponent")).get("value"))
        cells = [figure(distance.get(name)) for name, _, _ in DISTANCES]
        cells.append("" if exponent is None else figure(exponent, 2))
        rows.append([escape(run) if i == 0 else "", title, *map(escape, cells)])
    return rows


def write_verify_page(result: Part, folder: Path) -> Path:
    """Write ``verify.html`` from the content of ``verify.json``; returns its path.

    Raises:
        AnalysisError: the folder can't be written.
    """
    make_folder(folder)
    page = folder / "verify.html"
    page.write_text(verify_page(result), encoding="utf-8")
    return page


def verify_page(result: Part) -> str:
    """Page with the gap on further runs beside that of the report; from ``verify.json``."""
    name = words.word(result.get("campaign"), "campaign of unknown name")
    gap = mapping(result.get("gap"))
    effects = "; and ".join(words.effect_words(e) for e in sequence(result.get("effects")))
    verdict = words.word(result.get("verdict"))
    closes = [f"{_closed(gap.get('closure'))} of the gap closes here"]
    before = known(mapping(mapping(result.get("reported")).get("residual")).get("closure"))
    closes += [f"{_closed(before)} in the report"] if before is not None else []
    undecidable = bullets(words.plain(text) for text in sequence(result.get("undecidable")))
    body = [
        f'<p class="kicker">Gap verdict on further runs &nbsp;·&nbsp; {escape(name)}</p>',
        f"<h1>{escape(words.capital(effects or verdict))}: {escape(', '.join(closes))}</h1>",
        f"<p>Verdict of the diagnosis of {escape(words.word(result.get('diagnosed')))}; all "
        f"{len(sequence(gap.get('runs')))} runs count here, nothing was fitted to them.</p>",
        f"<h2>On these runs</h2>{senses_table(gap)}",
        f"<h2>As reported</h2>{senses_table({'senses': result.get('reported')})}",
        f"<h2>Attractor</h2>{distances_table(mapping(result.get('attractor')))}",
        section("What is not decidable", undecidable),
        "<footer>The same in numbers: verify.json, beside this page.</footer>",
    ]
    return html_page(f"Gap: {name}", body, STYLE)
