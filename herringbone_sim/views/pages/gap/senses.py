"""The gap in three senses as a table, and the page of ``gap verify``."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.pages.gap import words
from herringbone_sim.views.pages.gap.style import STYLE
from herringbone_sim.views.pages.gap.words import Part, figure, known, mapping, percent, sequence
from herringbone_sim.views.pages.report import CSS

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
SHOWN = {"m": (1e6, "µm"), "sigma": (1.0, "σ"), "m/s^2": (1.0, "m/s²")}
MODELS = (
    ("nominal", "before"),
    ("augmented", "after"),
    ("floor", "floor"),
    ("runner_up", "runner-up"),
)


def senses_table(gap: Part) -> str:
    """Before, after, floor and the runner-up in each sense; empty without senses."""
    senses = mapping(gap.get("senses"))
    told = {name: mapping(senses.get(name)) for name in NAMES if name in senses}
    if not told:
        return ""
    control = any(known(sense.get("runner_up")) is not None for sense in told.values())
    columns = [one for one in COLUMNS if control or "runner_up" not in one[0]]
    rows = [_row(name, sense, columns) for name, sense in told.items()]
    header = '<th>in the sense of</th><th class="n">unit</th>'
    header += "".join(f'<th class="n">{title}</th>' for _, title in columns)
    others = " and ".join(str(one) for one in sequence(gap.get("runner_up_effects")))
    told_of = (
        f"<p><small>The runner-up: {escape(others)}.</small></p>" if control and others else ""
    )
    table = f'<div class="scroll"><table><tr>{header}</tr>{"".join(rows)}</table></div>'
    return table + told_of


def _row(name: str, sense: Part, columns: Sequence[tuple[str, str]]) -> str:
    factor, unit = SHOWN.get(str(sense.get("unit")), (1.0, words.word(sense.get("unit"), "")))
    cells = [unit]
    for key, _ in columns:
        value = sense.get(key)
        cells.append(_closure(value) if "closure" in key else _scaled(value, factor))
    told = TEXTS[name] + (_horizon(sense) if name == "prediction" else "")
    shown = "".join(f'<td class="n">{escape(cell)}</td>' for cell in cells)
    return f"<tr><td>{NAMES[name]}<br><small>{escape(told)}</small></td>{shown}</tr>"


def _horizon(sense: Part) -> str:
    runs = [mapping(run) for run in sequence(sense.get("runs"))]
    found = [known(run.get("horizon_cycles")) for run in runs]
    cycles = [one for one in found if one is not None]
    if not cycles:
        return ""
    ends = dict.fromkeys(figure(one, 2) for one in (min(cycles), max(cycles)))
    return f", {' … '.join(ends)} mesh cycles ahead, at most half a Lyapunov time"


def _scaled(value: object, factor: float) -> str:
    number = known(value)
    return "–" if number is None else figure(factor * number)


def _closure(value: object) -> str:
    return "–" if known(value) is None else percent(value)


def _closed(value: object) -> str:
    """In a headline no more than all of it closes."""
    closure = known(value)
    return percent(None if closure is None else min(closure, 1.0))


def distances_table(attractor: Part) -> str:
    """How far each model's motion lies from the rig's, by run; empty without distances."""
    runs = list(mapping(attractor.get("floor")))
    models = [(key, title) for key, title in MODELS if mapping(attractor.get(key))]
    rows = "".join(_distance_rows(attractor, run, models) for run in runs)
    if not rows:
        return ""
    header = "<th>run</th><th></th>"
    header += "".join(f'<th class="n">{title} [{unit}]</th>' for _, title, unit in DISTANCES)
    header += '<th class="n">largest exponent [1/cycle]</th>'
    table = f'<div class="scroll"><table><tr>{header}</tr>{rows}</table></div>'
    lead = (
        "Distance of each model's motion from the rig's, over as many cycles as were recorded; "
        "the floor is one half of the recording against the other."
    )
    return f"<details><summary>{len(runs)} runs</summary><p>{lead}</p>{table}</details>"


def _distance_rows(attractor: Part, run: str, models: list[tuple[str, str]]) -> str:
    rows = []
    for i, (key, title) in enumerate(models):
        told = mapping(mapping(attractor.get(key)).get(run))
        distance = mapping(told.get("distance"))
        exponent = known(mapping(told.get("exponent")).get("value"))
        cells = [figure(distance.get(name)) for name, _, _ in DISTANCES]
        cells.append("" if exponent is None else figure(exponent, 2))
        shown = "".join(f'<td class="n">{escape(cell)}</td>' for cell in cells)
        rows.append(f"<tr><td>{escape(run) if i == 0 else ''}</td><td>{title}</td>{shown}</tr>")
    return "".join(rows)


def write_verify_page(told: Part, folder: Path) -> Path:
    """Write ``verify.html``; returns it.

    Raises:
        AnalysisError: the folder can't be written.
    """
    make_folder(folder)
    page = folder / "verify.html"
    page.write_text(verify_page(told), encoding="utf-8")
    return page


def verify_page(told: Part) -> str:
    """The numbers of a verdict on further runs, beside those of its report."""
    name = words.word(told.get("campaign"), "campaign of unknown name")
    gap = mapping(told.get("gap"))
    effects = "; and ".join(words.effect_words(one) for one in sequence(told.get("effects")))
    verdict = words.word(told.get("verdict"))
    closes = [f"{_closed(gap.get('closure'))} of the gap closes here"]
    before = known(mapping(mapping(told.get("reported")).get("residual")).get("closure"))
    closes += [f"{_closed(before)} in the report"] if before is not None else []
    open_ = "".join(
        f"<li>{escape(words.plain(one))}</li>" for one in sequence(told.get("undecidable"))
    )
    body = [
        f'<p class="kicker">Gap verdict on further runs &nbsp;·&nbsp; {escape(name)}</p>',
        f"<h1>{escape(words.capital(effects or verdict))}: {escape(', '.join(closes))}</h1>",
        f"<p>Verdict of the diagnosis of {escape(words.word(told.get('diagnosed')))}; all "
        f"{len(sequence(gap.get('runs')))} runs count here, nothing was fitted to them.</p>",
        f"<h2>On these runs</h2>{senses_table(gap)}",
        f"<h2>As reported</h2>{senses_table({'senses': told.get('reported')})}",
        f"<h2>Attractor</h2>{distances_table(mapping(told.get('attractor')))}",
        f"<h2>What is not decidable</h2><ul>{open_}</ul>" if open_ else "",
        "<footer>The same in numbers: verify.json, beside this page.</footer>",
    ]
    head = f'<meta charset="utf-8"><title>Gap: {escape(name)}</title><style>{CSS}{STYLE}</style>'
    return f'<!doctype html><html lang="en"><head>{head}</head><body>{"".join(body)}</body></html>'
