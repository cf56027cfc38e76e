"""Figure of periodic orbits over a parameter: branches, boundaries, multipliers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from herringbone_sim.arrays import Array
from herringbone_sim.dynamics.boundaries import Boundary
from herringbone_sim.dynamics.cascade import Followed
from herringbone_sim.dynamics.curve import BranchPoint
from herringbone_sim.dynamics.turning import section
from herringbone_sim.views.figures.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    STYLE,
    parameter_label,
)
from herringbone_sim.views.figures.text import mesh_symbol

MARKERS = {
    "flip": ("o", BLUE, "flip: period doubles"),
    "fold": ("D", INK, "fold: branch turns back"),
    "crossing": ("P", INK, "crossing of branches"),
    "Neimark-Sacker": ("s", GREEN, "Neimark-Sacker"),
    "transverse": ("^", ORANGE, "transverse: sides part"),
    "grazing": ("|", GREY, "grazing of a border"),
}
SKY = "#56B4E9"
STABILITY = {
    (False, False): ("stable", BLUE, "-", 1.6),
    (True, False): ("unstable", INK, "--", 0.9),
    (False, True): ("transversally unstable", ORANGE, "-", 1.3),
    (True, True): ("unstable both ways", ORANGE, "--", 0.9),
}
SIDES_DIFFER = {
    (False, False): ("stable, left ≠ right", SKY, "-", 1.6),
    (True, False): ("unstable, left ≠ right", GREY, "--", 0.9),
}
PERIOD_LINES: dict[int, Any] = {1: "-", 2: "--", 4: "-.", 8: ":", 16: (0, (1, 3))}
ROOM = 0.03  # least distance of two boundary names, as a fraction of the axes' width
Kind = tuple[bool, bool]


def orbit_figure(followed: Sequence[Followed], parameter: str, mesh: int, name: str) -> Figure:
    """Draw two panels over a parameter: branches above, their largest multipliers below.

    Above: displacement of one mesh over b_c at phase 0, styled by stability, with the boundaries.
    Below: largest |mu|^(1/n) of each branch, n its period, for symmetric and for transverse
    (left-right antisymmetric) perturbations.

    Args:
        followed: branches with their boundaries, at least one.
        parameter: name of the parameter on the horizontal axis.
        mesh: index of the mesh in the panel above.
        name: name of the same mesh, such as ``sp1_L``.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 6.4))
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
        _draw_branches(above, followed, mesh)
        above.set_ylabel(f"{mesh_symbol('x', name)} / $b_c$ at phase 0")
        _draw_multipliers(below, followed)
        below.set_xlabel(parameter_label(parameter))
        family = followed[0].curve.family
        above.set_xlim(family.low, family.high)
        _name_boundaries(above, [b for traced in followed for b in traced.boundaries])
        handles = [*_stability_handles(followed), *_boundary_handles(followed)]
        style: Any = {"ncols": 4, "fontsize": 7.5, "columnspacing": 1.2, "handlelength": 1.6}
        figure.legend(handles=handles, loc="outside lower center", **style)
        return figure


def stability_of(point: BranchPoint) -> str:
    """Return the stability of an orbit in words, by its multipliers outside the unit circle.

    Returns:
        ``stable`` if there are none; ``unstable`` if only of ``multipliers.within``;
        ``transversally unstable`` if only of ``multipliers.transverse``; ``unstable both ways``.
    """
    return STABILITY[_kind(point)][0]


def _kind(point: BranchPoint) -> Kind:
    within, transverse = point.multipliers.unstable
    return within > 0, transverse > 0


def _look(traced: Followed, kind: Kind) -> tuple[str, str, str, float]:
    """Return label, colour, line style and line width of a branch with a kind of stability."""
    return (STABILITY if traced.symmetric else SIDES_DIFFER)[kind]


def section_displacements(traced: Followed, points: Sequence[BranchPoint], mesh: int) -> Array:
    """Return displacements (n, period) / b_c of mesh number ``mesh`` at phase 0 of n orbits."""
    flow_at = traced.curve.family.flow_at
    return np.array([section(flow_at(p.value), p.orbit.points)[0][:, mesh] for p in points])


def _draw_branches(axes: Axes, followed: Sequence[Followed], mesh: int) -> None:
    for traced in followed:
        for kind, points in _pieces(traced):
            _, colour, line, width = _look(traced, kind)
            values = [point.value for point in points]
            # An unstable stretch lies below a stable one where they meet.
            style: Any = {"color": colour, "ls": line, "lw": width, "zorder": 2 - any(kind)}
            axes.plot(values, section_displacements(traced, points, mesh), **style)
        for boundary in traced.boundaries:
            at = section_displacements(traced, [boundary.point], mesh)[0]
            marker, colour, _ = MARKERS[boundary.kind]
            face = "white" if boundary.kind != "grazing" else colour
            look: Any = {"ls": "", "marker": marker, "ms": 4.5, "mfc": face, "mec": colour}
            axes.plot(np.full(len(at), boundary.value), at, zorder=3, **look)


def _pieces(traced: Followed) -> Iterator[tuple[Kind, list[BranchPoint]]]:
    """Split a branch into stretches of one kind of stability that end at its boundaries."""
    changes = {boundary.index: boundary.point for boundary in traced.boundaries}
    piece: list[BranchPoint] = []
    for i, point in enumerate(traced.branch.points):
        if piece and _kind(point) != _kind(piece[-1]):
            edge = changes.get(i - 1, point)
            yield _kind(piece[-1]), [*piece, edge]
            piece = [edge] if edge is not point and _kind(edge) == _kind(point) else []
        piece.append(point)
    yield _kind(piece[-1]), piece


def _draw_multipliers(axes: Axes, followed: Sequence[Followed]) -> None:
    """Draw the largest |mu|^(1/n), symmetric and transverse: growth per period of the forcing."""
    for traced in followed:
        values = [point.value for point in traced.branch.points]
        line = PERIOD_LINES.get(traced.period, ":")
        for part, colour in (("transverse", ORANGE), ("within", BLUE)):
            multipliers = [getattr(point.multipliers, part) for point in traced.branch.points]
            if len(multipliers[0]):
                moduli = np.array([np.abs(mu[0]) for mu in multipliers]) ** (1.0 / traced.period)
                axes.plot(values, moduli, color=colour, ls=line, lw=1.0)
    axes.axhline(1.0, color=INK, lw=0.7)
    axes.set_ylabel(r"largest $|\mu|^{1/n}$")
    axes.set_ylim(bottom=0.0)
    handles = [Line2D([], [], color=BLUE), Line2D([], [], color=ORANGE)]
    labels = ["within", "transverse"]
    for period in sorted({traced.period for traced in followed}):
        handles.append(Line2D([], [], color=INK, ls=PERIOD_LINES.get(period, ":")))
        labels.append(f"P{period}")
    axes.legend(handles, labels, loc="lower right", ncols=len(labels), fontsize=8)


def _name_boundaries(axes: Axes, boundaries: Sequence[Boundary]) -> None:
    """Write the boundary names above the axes without overlap, with a line to each value."""
    low, high = axes.get_xlim()
    named = {(b.kind, b.period, round(b.value, 6)): b for b in boundaries}
    ordered = sorted(named.values(), key=lambda b: b.value)
    places = _apart(np.array([(b.value - low) / (high - low) for b in ordered]), ROOM)
    across = axes.get_xaxis_transform()
    for boundary, place in zip(ordered, places, strict=True):
        _, colour, _ = MARKERS[boundary.kind]
        text = f"{boundary.kind} P{boundary.period} {boundary.value:.5g}"
        x = low + place * (high - low)
        axes.axvline(boundary.value, color=colour, lw=0.4, alpha=0.6, zorder=0)
        line: Any = {"color": colour, "lw": 0.5, "clip_on": False, "transform": across}
        axes.plot([boundary.value, x], [1.0, 1.04], **line)
        style: Any = {"rotation": 90, "ha": "center", "va": "bottom", "fontsize": 7}
        axes.text(x, 1.05, text, color=colour, transform=across, **style)


def _apart(places: Array, room: float) -> Array:
    """Shift ascending positions (n,) as little as needed for distances of ``room`` or more."""
    groups: list[tuple[float, int]] = []
    for place in places:
        group = (float(place), 1)
        while groups and groups[-1][0] + 0.5 * room * (groups[-1][1] + group[1]) > group[0]:
            centre, count = groups.pop()
            total = count + group[1]
            group = ((centre * count + group[0] * group[1]) / total, total)
        groups.append(group)
    spread = [c + room * (np.arange(n) - 0.5 * (n - 1)) for c, n in groups]
    return np.concatenate(spread) if spread else places


def _stability_handles(followed: Sequence[Followed]) -> list[Line2D]:
    used = {_look(traced, _kind(point)) for traced in followed for point in traced.branch.points}
    every = [*STABILITY.values(), *SIDES_DIFFER.values()]
    rows = [look for look in every if look in used]
    return [Line2D([], [], color=c, ls=line, lw=w, label=label) for label, c, line, w in rows]


def _boundary_handles(followed: Sequence[Followed]) -> list[Line2D]:
    kinds = {boundary.kind for traced in followed for boundary in traced.boundaries}
    rows = [MARKERS[kind] for kind in MARKERS if kind in kinds]
    return [
        Line2D([], [], ls="", marker=m, ms=4.5, mfc="white", mec=c, label=label)
        for m, c, label in rows
    ]
