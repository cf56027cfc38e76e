"""Tables of a gap report: residual by run, noise of the channels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from herringbone_sim.gap.observations.calibration.noise_report import ChannelNoise
from herringbone_sim.gap.verification.residual_gap import Gap, RunGap
from herringbone_sim.views.numbers import figure, percent
from herringbone_sim.views.pages.gap.words import METRICS, ROLES, closure_words
from herringbone_sim.views.pages.html import Table


def runs_values(gap: Gap, verdict: str) -> dict[str, object]:
    """Return the template values of the gap by run: before, after, noise floor and closure.

    Args:
        gap: of all runs.
        verdict: kind of the verdict, see ``verdict.kind``.
    """
    names = ("before", "after", "noise floor")
    return {
        "lead": f"Measured by the {METRICS[gap.metric]}; {closure_words(gap.closure, verdict)}.",
        "titles": [*(f"{name} [{gap.unit}]" for name in names), "closure"],
        "rows": [_run(gap, run) for run in sorted(gap.runs, key=lambda r: r.role != "held_out")],
    }


def _run(gap: Gap, run: RunGap) -> dict[str, object]:
    values = [figure(value) for value in (run.nominal, run.augmented, run.floor)]
    return {
        "name": run.name,
        "role": ROLES.get(run.role, run.role),
        "held_out": run.role == "held_out",
        "bars": _bars(run),
        "numbers": [*values, percent(replace(gap, runs=(run,)).closed(role=None))],
    }


def _bars(run: RunGap) -> list[tuple[str, str, str]]:
    """Return (CSS class, CSS property, size) of each bar of a run; empty without known values."""
    parts = (
        ("before", "width", run.nominal),
        ("after", "width", run.augmented),
        ("floor", "left", run.floor),
    )
    known = [part for part in parts if math.isfinite(part[2])]
    top = max((value for _, _, value in known), default=0.0)
    if top <= 0:
        return []
    return [(name, edge, f"{100 * max(value, 0.0) / top:.1f}%") for name, edge, value in known]


def noise_table(noise: Mapping[str, ChannelNoise]) -> Table | None:
    """Return the table of noise by channel: RMS, quantisation step, delay, colour, mains lines.

    None without channels.
    """
    if not noise:
        return None
    head = ["channel", "RMS", "step", "delay [s]", "unit", "colour", "lines [Hz]"]
    rows = []
    for name, channel in noise.items():
        lines = ", ".join(figure(f) for f in channel.lines_hz) or "-"
        numbers = [figure(value) for value in (channel.rms, channel.step, channel.delay_s)]
        rows.append([name, *numbers, channel.unit, channel.colour, lines])
    return Table(head, rows, numeric=(1, 2, 3))
