"""Figure of ``survival``: final motions of random starts, exponents of the motion from rest."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from herringbone_sim.arrays import Array
from herringbone_sim.dynamics.survival import FATES, Survival
from herringbone_sim.views.figures.exponents import SIGMAS
from herringbone_sim.views.figures.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    STYLE,
    cell_edges,
    parameter_label,
)

COLOURS = (BLUE, GREEN, "#E8C468", ORANGE)
LETTER = 0.013  # width of a letter over that of the axes


def survival_figure(name: str, values: Array, results: Sequence[Survival]) -> Figure:
    """Draw the final motions of random starts, and exponents of the motion from rest.

    Args:
        name: of the parameter.
        values: (n,) ascending.
        results: one per value.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.2))
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
        draw_fates(above, values, results)
        draw_stability(below, values, results)
        below.set_xlabel(parameter_label(name))
        edges = cell_edges(values)
        below.set_xlim(edges[0], edges[-1])
        return figure


def draw_fates(axes: Axes, values: Array, results: Sequence[Survival]) -> None:
    """Draw the stacked fractions of starts by final motion; the rest to 100 % failed."""
    shares = 100.0 * np.array([result.counts / result.starts for result in results])
    edges, base = cell_edges(values), np.zeros(len(values))
    for share, colour, fate in zip(shares.T, COLOURS, FATES, strict=True):
        axes.stairs(base + share, edges, baseline=base, fill=True, color=colour, label=fate)
        base = base + share
    _name_motions(axes, edges, [result.motion for result in results])
    axes.set(ylim=(0.0, 100.0), ylabel=f"share of {results[0].starts} starts [%]")
    look: Any = {"bbox_to_anchor": (0.0, 1.09), "borderaxespad": 0.0, "handlelength": 1.2}
    axes.legend(fontsize=8, loc="lower left", ncols=4, columnspacing=1.4, **look)


def draw_stability(axes: Axes, values: Array, results: Sequence[Survival]) -> None:
    """Draw the symmetric and transverse exponents of the motion from rest, ± 2 standard errors."""
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    rows = (
        (np.array([result.within for result in results]), BLUE, "left and right alike"),
        (np.array([result.transverse for result in results]), ORANGE, "left and right part"),
    )
    for data, colour, label in rows:
        look: Any = {"fmt": ".-", "ms": 4, "color": colour, "elinewidth": 0.8}
        axes.errorbar(values, data[:, 0], SIGMAS * data[:, 1], label=label, **look)
    axes.set(title="of the motion from rest", ylabel=r"largest exponent per $\tau$")
    axes.legend(fontsize=8, loc="best")


def _name_motions(axes: Axes, edges: Array, names: Sequence[str]) -> None:
    first = 0
    for name, group in groupby(names):
        last = first + len(list(group))
        low, high = edges[first], edges[last]
        if first:
            axes.axvline(low, color=INK, linewidth=0.6, linestyle=":")
        if high - low >= LETTER * (len(name) + 0.5) * (edges[-1] - edges[0]):
            middle = 0.5 * (low + high)
            axes.text(middle, 101.5, name, fontsize=8, ha="center", va="bottom")
        first = last
