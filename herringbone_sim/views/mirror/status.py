"""Parameters and regime of a block as a page of Markdown."""

from __future__ import annotations

from math import isfinite

from herringbone_sim.core.layout import UNITS
from herringbone_sim.views.mirror.block import MirrorBlock

EXTRA_UNITS = {"control_phase": "rad"}


def status_text(block: MirrorBlock) -> str:
    """Return Markdown: regime as a headline, a table of time, contact and parameters."""
    exponent = f"largest exponent {block.exponent:+.4f}" if isfinite(block.exponent) else ""
    headline = ", ".join(part for part in (block.regime, exponent) if part)
    cells = [f"time | {block.column('t')[-1]:.6g} s"]
    cells += [f"{name} | {share:.1%}" for name, share in (block.contact_shares or {}).items()]
    cells += [f"{name} | {with_unit(name, value)}" for name, value in block.parameters.items()]
    lines = [f"### {headline}", ""] if headline else []
    return "\n".join([*lines, *table(cells)])


def table(cells: list[str]) -> list[str]:
    """Return a Markdown table of cells ``name | value`` in two columns, filled downwards."""
    half = (len(cells) + 1) // 2
    right = [*cells[half:], *[" | "] * (2 * half - len(cells))]
    rows = [f"| {a} | {b} |" for a, b in zip(cells[:half], right, strict=True)]
    return [rows[0], "| --- | --- | --- | --- |", *rows[1:]]


def with_unit(name: str, value: float) -> str:
    """Return the value of a parameter as text, with its unit if it has one."""
    unit = {**UNITS, **EXTRA_UNITS}.get(name, "-")
    return f"{value:.6g}" if unit == "-" else f"{value:.6g} {unit}"
