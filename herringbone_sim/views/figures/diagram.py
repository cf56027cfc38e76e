"""Bifurcation diagrams of sweeps: section points above exponents, a colour per start."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from herringbone_sim.arrays import Flags
from herringbone_sim.sweeps.diagram import Branch, Diagram
from herringbone_sim.views.figures.maps import DPI
from herringbone_sim.views.figures.style import (
    BLUE,
    GREY,
    INK,
    ORANGE,
    STYLE,
    cell_edges,
    parameter_label,
    save,
)
from herringbone_sim.views.figures.text import mesh_symbol

LOOKS = {
    "fixed": (INK, "from the initial state"),
    "up": (ORANGE, "continued upwards"),
    "down": (BLUE, "continued downwards"),
    "ramp_up": (ORANGE, "rising"),
    "ramp_down": (BLUE, "falling"),
}
PANELS = {
    "each value from the initial state of the gear": ("fixed",),
    "each value from where its neighbour ended": ("up", "down"),
    "slow ramp, a point a mesh cycle": ("ramp_up", "ramp_down"),
}


def write_diagram(folder: Path, diagram: Diagram) -> list[Path]:
    """Write ``bifurcation.png`` and ``.svg`` into an existing folder; returns both paths."""
    return [*save(diagram_figure(diagram), folder, "bifurcation", DPI)]


def diagram_figure(diagram: Diagram) -> Figure:
    """Draw a panel of section points for each group of ``PANELS``, above a panel of exponents.

    Grey: parameter values at which sweeps with different starts end in different motions.
    """
    groups = [(title, _chosen(diagram, starts)) for title, starts in PANELS.items()]
    groups = [(title, branches) for title, branches in groups if branches]
    known = [branch for branch in diagram.branches if np.isfinite(branch.exponent).any()]
    ratios = [3.0] * len(groups) + [2.0] * bool(known)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 0.6 + 0.95 * sum(ratios)))
        rows = figure.subplots(len(ratios), 1, sharex=True, squeeze=False, height_ratios=ratios)
        for axes, (title, branches) in zip(rows[:, 0], groups, strict=False):
            draw_branches(axes, diagram, branches, title)
        if known:
            draw_exponents(rows[-1, 0], known)
        last = rows[-1, 0]
        last.set_xlabel(parameter_label(diagram.axis.name))
        last.set_xlim(diagram.axis.values[0], diagram.axis.values[-1])
        return figure


def draw_branches(axes: Axes, diagram: Diagram, branches: list[Branch], title: str) -> None:
    """Draw the section points of branches; grey where the diagram shows hysteresis."""
    for low, high in _spans(diagram.axis.values, diagram.hysteresis()):
        axes.axvspan(low, high, color=GREY, alpha=0.18, linewidth=0, zorder=0)
    for branch in branches:
        colour, label = LOOKS[branch.start]
        periodic = branch.period > 0
        # Points of all but the last branch are larger: they show as a rim where it covers them.
        rim = 8.0 if branch is not branches[-1] else 1.6
        for rows, size in ((~periodic, 0.35), (periodic, rim)):
            x, y = branch.point_values[rows].ravel(), branch.points[rows].ravel()
            axes.scatter(x, y, s=size, color=colour, linewidths=0, rasterized=True)
        axes.scatter([], [], s=12, color=colour, linewidths=0, label=label)
    axes.set(title=title, ylabel=f"{mesh_symbol('x', diagram.mesh)} / $b_c$")
    if len(branches) > 1:
        _legend(axes, ncols=len(branches))


def draw_exponents(axes: Axes, branches: list[Branch]) -> None:
    """Draw the largest exponents of left-right symmetric and of antisymmetric perturbations.

    Where the first is not known, the largest exponent of all perturbations is drawn instead.
    """
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    alone = len(branches) == 1
    for branch in branches:
        colour, label = LOOKS[branch.start]
        alike = np.where(np.isfinite(branch.within), branch.within, branch.exponent)
        name = "left = right" if np.isfinite(branch.within).any() else "of all perturbations"
        axes.plot(branch.values, alike, color=colour, label=name if alone else label)
        look: Any = {"color": ORANGE} if alone else {"color": colour, "linestyle": ":"}
        parts = "parts left and right" if branch is branches[-1] else None
        if np.isfinite(branch.transverse).any():
            axes.plot(branch.values, branch.transverse, label=parts, **look)
    axes.set(title="largest Lyapunov exponent", ylabel=r"$\lambda_1$ per $\tau$")
    axes.legend(fontsize=8, loc="best", ncols=2, handletextpad=0.4, columnspacing=1.2)


def _chosen(diagram: Diagram, starts: tuple[str, ...]) -> list[Branch]:
    return [branch for branch in diagram.branches if branch.start in starts]


def _legend(axes: Axes, ncols: int) -> None:
    look: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.98), "borderaxespad": 0.0}
    axes.legend(fontsize=8, ncols=ncols, handletextpad=0.4, columnspacing=1.2, **look)


def _spans(values: tuple[float, ...], chosen: Flags) -> list[tuple[float, float]]:
    """Return the ends of each stretch of chosen values, widened by half of the steps beside it."""
    places = np.array(values)
    ends = cell_edges(places) if len(places) > 1 else np.repeat(places, 2)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(np.int8), [0]])))
    return [(float(ends[a]), float(ends[b])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
