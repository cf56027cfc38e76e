"""Tables of a gap report: residual by run, noise of the channels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape

from herringbone_sim.gap.observations.recorded_noise import ChannelNoise
from herringbone_sim.gap.verification.verify import Gap, RunGap
from herringbone_sim.views.pages.gap.words import (
    METRICS,
    ROLES,
    closure_words,
    figure,
    percent,
)
from herringbone_sim.views.pages.html import folded, table

KEY = (
    '<p class="key lead">Bars, each to the scale of its run:'
    '<i style="background:#f3c9a5"></i>before'
    '<i style="background:#0072B2"></i>after'
    '<i style="background:#22262c;width:2px;height:14px"></i>noise floor</p>'
)


def runs_table(gap: Gap, verdict: str) -> str:
    """Table of a gap by run: before, after, noise floor and closure, held-out runs first.

    Args:
        gap: of all runs.
        verdict: kind of the verdict, see ``verdict.kind``.
    """
    lead = f"Measured by the {METRICS[gap.metric]}; {closure_words(gap.closure, verdict)}."
    rows = "".join(_run(run) for run in sorted(gap.runs, key=lambda run: run.role != "held_out"))
    names = ("before", "after", "noise floor")
    titles = (*(f"{name} [{escape(gap.unit)}]" for name in names), "closure")
    header = "<th>run</th><th>role</th><th></th>"
    header += "".join(f'<th class="n">{title}</th>' for title in titles)
    note = "Held-out runs entered neither the choice nor the fit."
    content = f'<div class="scroll"><table><tr>{header}</tr>{rows}</table></div>'
    return f"<p>{escape(lead)} {note}</p>{KEY}{content}"


def _run(run: RunGap) -> str:
    values = [figure(value) for value in (run.nominal, run.augmented, run.floor)]
    cells = "".join(f'<td class="n">{escape(v)}</td>' for v in [*values, percent(closure(run))])
    held = ' class="held"' if run.role == "held_out" else ""
    role = escape(ROLES.get(run.role, run.role))
    head = f'<td>{escape(run.name)}</td><td class="role">{role}</td><td>{_track(run)}</td>'
    return f"<tr{held}>{head}{cells}</tr>"


def closure(run: RunGap) -> float:
    """(before - after) / (before - floor); NaN without a gap above the floor."""
    above = run.nominal - run.floor
    return (run.nominal - run.augmented) / above if above > 0.0 else math.nan


def _track(run: RunGap) -> str:
    parts = (
        ("before", "width", run.nominal),
        ("after", "width", run.augmented),
        ("floor", "left", run.floor),
    )
    known = [part for part in parts if math.isfinite(part[2])]
    top = max((value for _, _, value in known), default=0.0)
    if top <= 0:
        return ""
    bars = (
        f'<span class="{name}" style="{edge}:{100 * max(value, 0.0) / top:.1f}%"></span>'
        for name, edge, value in known
    )
    return f'<div class="track">{"".join(bars)}</div>'


def noise_table(noise: Mapping[str, ChannelNoise]) -> str:
    """Folded table of the noise by channel: RMS, quantisation step, delay, colour, lines."""
    if not noise:
        return ""
    head = ["channel", "RMS", "step", "delay [s]", "unit", "colour", "lines [Hz]"]
    rows = []
    for name, one in noise.items():
        lines = ", ".join(figure(f) for f in one.lines_hz) or "-"
        numbers = [figure(value) for value in (one.rms, one.step, one.delay_s)]
        cells = (name, *numbers, one.unit, one.colour, lines)
        rows.append([escape(cell) for cell in cells])
    return folded(f"{len(rows)} channels", table(head, rows, numeric=(1, 2, 3)))
