"""Figures of the study ``control``: least amplitudes; phase and frequency of the control."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from herringbone_sim.arrays import Array, Flags
from herringbone_sim.control.amplitude import LeastAmplitude, Survey, Target
from herringbone_sim.control.runs import LEAST_EXPONENT
from herringbone_sim.control.shape import ShapeMap, zero_start_periods
from herringbone_sim.views.figures.maps import (
    APERIODIC,
    NEITHER,
    PERIOD_COLOURS,
    cells,
    draw_rates,
    period_places,
)
from herringbone_sim.views.figures.style import FRAMED_STYLE, GREEN, INK, ORANGE, parameter_label

REACHED = ("#1d2027", "#7d8794", "#86b8df", "#dce9f5")
REACHED_NAMES = ("none: P1 or P2", "some: P1 or P2", "all: P1 or P2", "all: P1")
OUTLINE = [withStroke(linewidth=3.0, foreground="white")]
TURN = ([-np.pi, -np.pi / 2, 0.0, np.pi / 2, np.pi], ["-π", "-π/2", "0", "π/2", "π"])


def amplitude_figure(
    survey: Survey, amplitudes: Sequence[LeastAmplitude], torque_n_m: float
) -> Figure:
    """Draw the periods and the least amplitudes of a survey over a parameter and K.

    Left: period from the zero start. Right: whether some or all starts reach P1 and P2.

    Args:
        survey: over another parameter and K.
        amplitudes: least amplitudes of the survey from the start groups ``zero`` and ``all``.
        torque_n_m: amplitude on the carrier at K = 1 [N m], for the scale on the right; NaN if the
            carrier alone can't be the control.
    """
    with matplotlib.rc_context(FRAMED_STYLE):
        figure = Figure(figsize=(9.2, 4.2))
        left, right = figure.subplots(1, 2, sharey=True)
        values = survey.axis.values
        draw_periods(left, values, survey.K, zero_start_periods(survey), below=True)
        unit = "mesh cycles" if np.all(survey.forcing_cycles == 1) else "periods of the forcing"
        left.set_title(f"period from the zero start, {unit}")
        _draw_reached(right, survey)
        for axes, starts in ((left, "zero"), (right, "all")):
            _draw_least(axes, amplitudes, starts)
            axes.set(xlabel=parameter_label(survey.axis.name), ylim=(0.0, survey.K[-1]))
        left.set_ylabel(parameter_label("K"))
        if torque_n_m > 0.0:
            scale = right.secondary_yaxis(
                "right", functions=(lambda K: K * torque_n_m / 1e3, lambda t: 1e3 * t / torque_n_m)
            )
            scale.set_ylabel("torque on the carrier alone [kN m]")
        return figure


def draw_periods(
    axes: Axes,
    values: Sequence[float],
    K: Array,
    period: Array,
    chaotic: Flags | None = None,
    below: bool = False,
) -> None:
    """Draw cells coloured by period, with a legend of the periods that occur.

    Args:
        values: (n,) of the horizontal axis.
        K: (m,) of the vertical axis.
        period: (n, m); 0 is not periodic.
        chaotic: (n, m) whether the motion is chaotic; a motion neither periodic nor chaotic has
            another colour. None: all motions without a period are drawn alike.
        below: whether the legend stands below the axes.
    """
    colours = [APERIODIC, *PERIOD_COLOURS.values(), NEITHER]
    places = period_places(period)
    names = [(PERIOD_COLOURS[n], f"P{n}") for n in sorted(PERIOD_COLOURS) if (period == n).any()]
    names.append((APERIODIC, "aperiodic" if chaotic is None else "chaotic"))
    longer = period > max(PERIOD_COLOURS)
    other = longer if chaotic is None else longer | ((period == 0) & ~chaotic)
    if other.any():
        places[other] = len(PERIOD_COLOURS) + 1
        names.append((NEITHER, "neither"))
    options: Any = {"cmap": ListedColormap(colours), "vmin": -0.5, "vmax": len(colours) - 0.5}
    cells(axes, values, K, places, **options)
    _legend(axes, names, below)


def _draw_reached(axes: Axes, survey: Survey) -> None:
    level = survey.repeats(2).any(axis=2).astype(float)
    level[survey.reached(Target(2, "all"))] = 2.0
    level[survey.reached(Target(1, "all"))] = 3.0
    options: Any = {"cmap": ListedColormap(REACHED), "vmin": -0.5, "vmax": 3.5}
    cells(axes, survey.axis.values, survey.K, level, **options)
    axes.set_title(f"reached from {len(survey.starts.names)} starts of four kinds")
    _legend(axes, list(zip(REACHED, REACHED_NAMES, strict=True))[::-1], below=True)


def _draw_least(axes: Axes, amplitudes: Sequence[LeastAmplitude], starts: str) -> None:
    """Draw ``Staircase.firm`` of P1 (solid) and of P2 or P1 (dashed) from a group of starts."""
    styles: Any = ((1, "-"), (2, (0, (3, 1.5))))
    for period, style in styles:
        rows = [a for a in amplitudes if a.target == Target(period, starts)]
        K = [a.staircase.firm for a in rows]
        options: Any = {"color": ORANGE, "linewidth": 1.6, "linestyle": style}
        axes.plot([a.value for a in rows], K, path_effects=OUTLINE, **options)
    title = "from the zero start" if starts == "zero" else "from all starts"
    handles = [
        Line2D([], [], color=ORANGE, lw=1.6, label="P1 above"),
        Line2D([], [], color=ORANGE, lw=1.6, ls=(0, (3, 1.5)), label="P2 or P1 above"),
    ]
    options = {"fontsize": 8, "title_fontsize": 8, "frameon": True, "framealpha": 0.9}
    axes.legend(handles=handles, title=title, loc="upper right", **options)


def shape_figure(
    by_phase: ShapeMap,
    by_order: ShapeMap,
    least: Sequence[LeastAmplitude],
    cancelling: tuple[float, float] | None,
) -> Figure:
    """Draw period and largest exponent over phase and K, and over frequency order and K.

    Args:
        by_phase, by_order: maps over ``control_phase`` and ``control_order``.
        least: least amplitudes over the phase.
        cancelling: K and phase [rad] at which the control cancels the mesh error; None: at none.
    """
    with matplotlib.rc_context(FRAMED_STYLE):
        figure = Figure(figsize=(9.2, 7.0))
        (a, b), (c, d) = figure.subplots(2, 2)
        turn = [*by_phase.axis.values, np.pi]
        _draw_pair(a, b, turn, by_phase, [*range(len(turn) - 1), 0])
        _phase_curves(a, least)
        for axes in (a, b):
            ring: Any = {"mfc": "none", "mec": GREEN, "ms": 8, "mew": 2.0}
            if cancelling:
                axes.plot(cancelling[1], cancelling[0], "o", path_effects=OUTLINE, **ring)
            axes.set_xticks(*TURN)
            axes.set(xlabel="phase of the control [rad]", xlim=(-np.pi, np.pi))
        known = "; ring: error cancelled" if cancelling else ""
        a.set_title(f"period; hatched: halves part{known}")
        places = list(range(len(by_order.axis)))
        _draw_pair(c, d, places, by_order, places)
        c.set_title("period, of mesh and control together")
        for axes in (c, d):
            _order_ticks(axes, by_order.axis.values)
        for axes in (a, b, c, d):
            axes.set(ylabel=parameter_label("K"), ylim=(0.0, by_phase.K[-1]))
        return figure


def _draw_pair(
    left: Axes, right: Axes, values: Sequence[float], shape: ShapeMap, rows: Sequence[int]
) -> None:
    """Draw period (hatched: halves part) and exponent of map rows at values of the axis."""
    at = list(rows)
    period: Array = shape.period[at]
    draw_periods(left, values, shape.K, period, shape.chaotic[at])
    parting = (period > 0) & (shape.transverse[at] > LEAST_EXPONENT)
    if parting.any():
        options: Any = {"levels": [0.5, 1.5], "colors": "none", "hatches": ["////"]}
        left.contourf(values, shape.K, parting.T.astype(float), **options)
    draw_rates(right, values, shape.K, shape.exponent[at], r"$\lambda_1$ per $\tau$")
    right.set_title("largest Lyapunov exponent")


def _phase_curves(axes: Axes, amplitudes: Sequence[LeastAmplitude]) -> None:
    """Draw ``Staircase.firm`` of P1 over the phase, from the zero start and from all starts."""
    for starts, style, label in (
        ("zero", "-", "zero start"),
        ("all", (0, (3, 1.5)), "starts of all kinds"),
    ):
        rows = [a for a in amplitudes if a.target == Target(1, starts)]
        K, places = [a.staircase.firm for a in rows], [a.value for a in rows]
        options: Any = {"color": ORANGE, "linewidth": 1.6, "linestyle": style}
        axes.plot([*places, np.pi], [*K, *K[:1]], path_effects=OUTLINE, label=label, **options)
    lines = axes.get_lines()[:2]
    options = {"fontsize": 8, "title_fontsize": 8, "frameon": True, "framealpha": 0.9}
    box = axes.legend(handles=lines, title="P1 above, from the", loc="upper right", **options)
    axes.add_artist(box)


def _order_ticks(axes: Axes, orders: Sequence[float]) -> None:
    labelled = [i for i, x in enumerate(orders) if len(orders) < 8 or 2 * x == round(2 * x)]
    axes.set_xticks(labelled, [f"{orders[i]:.3g}" for i in labelled])
    irrational = [i for i, x in enumerate(orders) if 8 * x != round(8 * x)]
    for i in irrational:
        axes.annotate(
            "▴",
            (i, 0.0),
            (0, -6),
            textcoords="offset points",
            ha="center",
            va="top",
            fontsize=6,
            color=ORANGE,
            annotation_clip=False,
        )
    axes.set_xlabel("control frequency over mesh frequency (▴: irrational)")


def _legend(axes: Axes, names: Sequence[tuple[str, str]], below: bool = False) -> None:
    """Add a legend of (colour, name) beside or below the axes; later ones don't replace it."""
    handles = [Patch(facecolor=c, edgecolor=INK, linewidth=0.4, label=name) for c, name in names]
    options: Any = {"handlelength": 1.0, "handleheight": 1.0, "fontsize": 8, "borderaxespad": 0.0}
    if below:
        options |= {"loc": "upper center", "bbox_to_anchor": (0.5, -0.17), "ncols": len(names)}
        options |= {"columnspacing": 1.2}
    else:
        options |= {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0)}
    box = axes.legend(handles=handles, **options)
    axes.add_artist(box)
    box.set_clip_on(False)  # else the layout leaves no room for it
