"""Figures of ``compare``: bifurcation diagrams, exponents and contact of two gears."""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from herringbone_sim.sweeps.compare import APERIODIC, NOT_KNOWN, GearSweeps
from herringbone_sim.sweeps.diagram import diagram_of
from herringbone_sim.views.figures import maps
from herringbone_sim.views.figures.style import (
    BLUE,
    GREY,
    ORANGE,
    STYLE,
    cell_edges,
    parameter_label,
)
from herringbone_sim.views.figures.text import mesh_symbol

COLOURS = {"nominal": BLUE, "augmented": ORANGE}
OTHER = "#d9c7b8"  # a period that has no colour of its own


def compare_figure(nominal: GearSweeps, augmented: GearSweeps, way: str) -> Figure:
    """Draw section points, exponents and time without contact of both gears.

    Args:
        nominal, augmented: sweeps of the gears over the same parameter values.
        way: which sweeps to draw, a key of ``GearSweeps.results`` such as ``up``.
    """
    sides = nominal, augmented
    known = any(np.isfinite(side.results[way]["exponent"]).any() for side in sides)
    ratios = [3.4, *([2.0] if known else []), 1.8]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.6, 0.6 + 1.0 * sum(ratios)))
        rows = figure.subplots(len(ratios), 1, sharex=True, squeeze=False, height_ratios=ratios)
        for side in sides:
            _draw_points(rows[0, 0], side, way)
            if known:
                _draw_exponents(rows[1, 0], side, way)
            _draw_contact(rows[-1, 0], side, way)
        _finish(rows[:, 0], nominal, way, known)
        return figure


def starts_figure(nominal: GearSweeps, augmented: GearSweeps) -> Figure:
    """Draw the motion at each parameter value by colour, a row per gear and start of a sweep."""
    rows = [(side, way) for side in (nominal, augmented) for way in side.results]
    names = [side.motions(way) for side, way in rows]
    kinds = sorted({name for row in names for name in row}, key=_order)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.6, 1.2 + 0.24 * len(rows)))
        axes = figure.subplots()
        picture = np.array([[to_rgb(colour(name)) for name in row] for row in names])
        values = np.array(nominal.axis.values)
        edges = cell_edges(values) if len(values) > 1 else np.array(_ends(nominal.axis.values))
        axes.pcolormesh(edges, np.arange(len(rows) + 1.0), picture, rasterized=True)
        axes.set(xlim=(edges[0], edges[-1]), ylim=(len(rows), 0.0))
        axes.axhline(len(nominal.results), color="white", linewidth=3.0)
        axes.set_yticks(np.arange(len(rows)) + 0.5, [f"{side.name}, {way}" for side, way in rows])
        axes.set_xlabel(parameter_label(nominal.axis.name))
        handles = [Patch(facecolor=colour(k), edgecolor=GREY, label=k) for k in kinds]
        look: Any = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5), "fontsize": 8}
        axes.legend(handles=handles, **look)
        return figure


def colour(name: str) -> str:
    """Return the colour of a motion, such as ``P2`` or ``aperiodic``, as on two-parameter maps."""
    fixed = {APERIODIC: maps.APERIODIC, NOT_KNOWN: maps.FAILED}
    number = int(name[1:]) if name[:1] == "P" and name[1:].isdigit() else 0
    return fixed.get(name) or maps.PERIOD_COLOURS.get(number, OTHER)


def _order(name: str) -> tuple[int, int, str]:
    number = int(name[1:]) if name[:1] == "P" and name[1:].isdigit() else 0
    return (0 if number else 1, number, name)


def _ends(values: tuple[float, ...]) -> tuple[float, float]:
    half = (values[-1] - values[0]) / (2.0 * max(len(values) - 1, 1)) or 0.5
    return values[0] - half, values[-1] + half


def _draw_points(axes: Axes, side: GearSweeps, way: str) -> None:
    branch = diagram_of([side.results[way]]).branches[0]
    periodic = branch.period > 0
    for rows, size in ((~periodic, 0.3), (periodic, 3.0)):
        x, y = branch.point_values[rows].ravel(), branch.points[rows].ravel()
        axes.scatter(x, y, s=size, color=COLOURS[side.name], linewidths=0, rasterized=True)
    axes.scatter([], [], s=14, color=COLOURS[side.name], linewidths=0, label=side.name)


def _draw_exponents(axes: Axes, side: GearSweeps, way: str) -> None:
    result = side.results[way]
    alike = np.where(np.isfinite(result["within"]), result["within"], result["exponent"])
    axes.plot(side.axis.values, alike, color=COLOURS[side.name])
    axes.plot(side.axis.values, result["transverse"], color=COLOURS[side.name], linestyle=":")


def _draw_contact(axes: Axes, side: GearSweeps, way: str) -> None:
    result = side.results[way]
    for kind, style in (("sun", "-"), ("ring", ":")):
        share = 100.0 * result[f"{kind}_separated"]
        axes.plot(side.axis.values, share, color=COLOURS[side.name], linestyle=style)


def _finish(rows: Any, nominal: GearSweeps, way: str, known: bool) -> None:
    mesh = nominal.results[way].sweep.observation.mesh
    rows[0].set(title="section points", ylabel=f"{mesh_symbol('x', mesh)} / $b_c$")
    rows[0].legend(fontsize=8, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 0.98))
    if known:
        rows[1].axhline(0.0, color=GREY, linewidth=0.8)
        title = "largest Lyapunov exponent; dotted: of what parts left and right"
        rows[1].set(title=title, ylabel=r"$\lambda_1$ per $\tau$")
    title = "time without contact, sun meshes; dotted: ring meshes"
    rows[-1].set(title=title, ylabel="share [%]", ylim=(0.0, None))
    rows[-1].set_xlabel(parameter_label(nominal.axis.name))
    rows[-1].set_xlim(*_ends(nominal.axis.values))
