"""Tables of a gap report: residual by run, numbers of the attractor, noise of the channels."""

from __future__ import annotations

from html import escape

from herringbone_sim.views.pages.gap.words import (
    METRICS,
    NOT_KNOWN,
    ROLES,
    UNITS,
    Part,
    closure_words,
    figure,
    known,
    mapping,
    percent,
    plain,
    sequence,
    word,
)
from herringbone_sim.views.pages.html import folded, table

FOLDED = 24  # rows of the attractor above which the table is folded
KEY = (
    '<p class="key lead">Bars, each to the scale of its run:'
    '<i style="background:#f3c9a5"></i>before'
    '<i style="background:#0072B2"></i>after'
    '<i style="background:#22262c;width:2px;height:14px"></i>noise floor</p>'
)


def runs_table(gap: Part, verdict: str) -> str:
    """Table of a gap by run: before, after, noise floor and closure, held-out runs first.

    Args:
        gap: object ``gap`` of a report.
        verdict: kind of its verdict, see ``verdict.kind``.
    """
    if not gap:
        return f"<p>The size of the gap is {NOT_KNOWN}.</p>"
    metric = word(gap.get("metric"), f"a metric that is {NOT_KNOWN}")
    what = METRICS.get(metric, metric)
    lead = f"Measured by the {what}; {closure_words(gap.get('closure'), verdict)}."
    runs = [mapping(run) for run in sequence(gap.get("runs"))]
    runs.sort(key=lambda run: run.get("role") != "held_out")
    rows = "".join(_run(run) for run in runs)
    if not rows:
        return f"<p>{escape(lead)}</p>{_total(gap)}<p>Numbers by run are {NOT_KNOWN}.</p>"
    unit = word(gap.get("unit"), UNITS.get(metric, ""))
    more = f" [{escape(unit)}]" if unit else ""
    titles = (f"before{more}", f"after{more}", f"noise floor{more}", "closure")
    header = "<th>run</th><th>role</th><th></th>"
    header += "".join(f'<th class="n">{title}</th>' for title in titles)
    note = "Held-out runs entered neither the choice nor the fit."
    content = f'<div class="scroll"><table><tr>{header}</tr>{rows}</table></div>'
    return f"<p>{escape(lead)} {note}</p>{KEY}{content}"


def _total(gap: Part) -> str:
    parts = (("before", "nominal"), ("after", "augmented"), ("noise floor", "noise_floor"))
    return f"<p>{escape('; '.join(f'{name} {figure(gap.get(key))}' for name, key in parts))}.</p>"


def _run(run: Part) -> str:
    role = word(run.get("role"))
    values = [figure(run.get(key)) for key in ("nominal", "augmented", "noise_floor")]
    cells = "".join(f'<td class="n">{escape(v)}</td>' for v in [*values, percent(closure(run))])
    held = ' class="held"' if role == "held_out" else ""
    path = escape(word(run.get("path")))
    role_text = escape(ROLES.get(role, role))
    head = f'<td>{path}</td><td class="role">{role_text}</td><td>{_track(run)}</td>'
    return f"<tr{held}>{head}{cells}</tr>"


def closure(run: Part) -> float | None:
    """(before - after) / (before - floor); None without a gap above the floor."""
    before, after, floor = (known(run.get(k)) for k in ("nominal", "augmented", "noise_floor"))
    if before is None or after is None or floor is None or before <= floor:
        return None
    return (before - after) / (before - floor)


def _track(run: Part) -> str:
    before, after, floor = (known(run.get(k)) for k in ("nominal", "augmented", "noise_floor"))
    top = max((v for v in (before, after, floor) if v is not None), default=0.0)
    if top <= 0:
        return ""
    parts = [
        f'<span class="{name}" style="{edge}:{100 * max(value, 0.0) / top:.1f}%"></span>'
        for name, edge, value in (
            ("before", "width", before),
            ("after", "width", after),
            ("floor", "left", floor),
        )
        if value is not None
    ]
    return f'<div class="track">{"".join(parts)}</div>'


def attractor_table(attractor: Part) -> str:
    """Table of all numbers on the attractor, a column per model."""
    columns = {str(name): dict(flat(mapping(part))) for name, part in attractor.items()}
    columns = {name: part for name, part in columns.items() if part}
    names = list(dict.fromkeys(key for part in columns.values() for key in part))
    if not names:
        return ""
    rows = [
        [
            escape(name.replace("_", " ")),
            *(escape(plain(part.get(name))) for part in columns.values()),
        ]
        for name in names
    ]
    content = table(["", *map(escape, columns)], rows, numeric=range(1, len(columns) + 1))
    return content if len(names) <= FOLDED else folded(f"{len(names)} numbers", content)


def flat(part: Part, prefix: str = "") -> list[tuple[str, object]]:
    """Pairs (name, value) of all leaves of nested mappings; keys are joined by dots."""
    leaves: list[tuple[str, object]] = []
    for key, value in part.items():
        name = f"{prefix}{key}"
        leaves += flat(value, f"{name} · ") if isinstance(value, dict) else [(name, value)]
    return leaves


def noise_table(noise: Part) -> str:
    """Folded table of the noise by channel: RMS, quantisation step, delay, colour, lines."""
    if not noise:
        return ""
    head = ["channel", "RMS", "step", "delay [s]", "unit", "colour", "lines [Hz]"]
    rows = []
    for name, entry in noise.items():
        part = mapping(entry)
        lines = ", ".join(figure(f) for f in sequence(part.get("lines_hz"))) or "-"
        numbers = [figure(part.get(key)) for key in ("rms", "step", "delay_s")]
        texts = [word(part.get("unit")), word(part.get("colour")), lines]
        rows.append([escape(cell) for cell in (name, *numbers, *texts)])
    return folded(f"{len(rows)} channels", table(head, rows, numeric=(1, 2, 3)))
