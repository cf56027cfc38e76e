"""Figures of the reproduction of the paper: published and obtained motions over each sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from herringbone_sim.analysis.pipeline import SegmentResult
from herringbone_sim.paper.regimes import Sweep, stretches
from herringbone_sim.paper.scenarios import CHAOS, FAILED, Scenario, motion_name
from herringbone_sim.views.figures.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    STYLE,
    parameter_label,
)

COLOURS = {CHAOS: ORANGE, 1: BLUE, 2: "#56B4E9", 3: GREEN, 4: "#CC79A7", FAILED: INK}
OTHER = "#F0E442"
STRIP = 0.16
SHOWN = 16
LEAST_HALF = 0.02
HEADROOM = 1.25
ENDS = np.array([-1.0, 1.0])
X_LABEL = r"$x_{\mathrm{sp}}^{\mathrm{L}}$ / $b_c$"


def colour(motion: int) -> str:
    """Return the colour of a motion, given by its period, 0 for chaos, -1 for a failed run."""
    return COLOURS.get(motion, OTHER)


def sweep_figure(scenario: Scenario, sweep: Sweep) -> Figure:
    """Draw published and obtained motions, bifurcation diagram and exponents of a sweep."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.6))
        strips, diagram, exponents = figure.subplots(
            3, 1, sharex=True, height_ratios=[2 * STRIP, 3, 2]
        )
        _strips(strips, scenario, sweep)
        _bifurcation(diagram, scenario, sweep)
        _exponents(exponents, sweep)
        exponents.set_xlabel(parameter_label(scenario.parameter))
        exponents.set_xlim(scenario.low, scenario.high)
        _legend(figure, [*sweep.motions, *published(scenario)])
        return figure


def pair_figure(pairs: Sequence[tuple[Scenario, Sweep]]) -> Figure:
    """Draw Fig. 20 of the paper: bifurcation diagrams of the controlled scenarios side by side."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 3.6))
        axes = figure.subplots(
            2, len(pairs), sharex="col", squeeze=False, height_ratios=[2 * STRIP, 3]
        )
        for column, (scenario, sweep) in enumerate(pairs):
            _strips(axes[0, column], scenario, sweep, names=column == 0)
            _bifurcation(axes[1, column], scenario, sweep)
            axes[0, column].set_title(f"$K$ = {scenario.fixed.get('K', 0.0):g}")
            axes[1, column].set_xlabel(parameter_label(scenario.parameter))
            axes[1, column].set_xlim(scenario.low, scenario.high)
            if column:
                axes[1, column].set_ylabel("")
        _legend(figure, [m for s, row in pairs for m in (*row.motions, *published(s))])
        return figure


def raster_figure(scenario: Scenario, rows: Mapping[str, Sweep]) -> Figure:
    """Draw the motions over a sweep: a row for the paper, and one per sweep of ``rows``.

    ``rows``: name of a start or step size -> sweep obtained with it.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 1.1 + 0.2 * (len(rows) + 1)))
        axes = figure.subplots()
        _published(axes, scenario, 0)
        for at, row in enumerate(rows.values(), start=1):
            _row(axes, row, at)
        names = ["the paper", *rows]
        axes.set_yticks(range(len(names)), names, fontsize=8)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.set(xlabel=parameter_label(scenario.parameter), xlim=(scenario.low, scenario.high))
        axes.tick_params(left=False)
        axes.spines["left"].set_visible(False)
        obtained = [motion for row in rows.values() for motion in row.motions]
        _legend(figure, [*obtained, *published(scenario)])
        return figure


def _strips(axes: Axes, scenario: Scenario, sweep: Sweep, names: bool = True) -> None:
    _published(axes, scenario, 0)
    _row(axes, sweep, 1)
    axes.set_yticks([0, 1], ["published", "obtained"] if names else ["", ""], fontsize=8)
    axes.set_ylim(1.45, -0.45)
    axes.tick_params(bottom=False, left=False)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _published(axes: Axes, scenario: Scenario, at: int) -> None:
    for window in scenario.windows:
        style: Any = {"alpha": 0.45, "hatch": "////"} if window.implied else {}
        width = window.high - window.low
        axes.barh(
            at,
            width,
            0.8,
            window.low,
            color=colour(window.motion),
            edgecolor="white",
            lw=0,
            **style,
        )


def _row(axes: Axes, sweep: Sweep, at: int) -> None:
    half = float(sweep.values[1] - sweep.values[0]) / 2.0
    for low, high, motion in stretches(sweep):
        left = max(low - half, float(sweep.values[0]))
        right = min(high + half, float(sweep.values[-1]))
        axes.barh(at, right - left, 0.8, left, color=colour(motion), lw=0)


def _bifurcation(axes: Axes, scenario: Scenario, sweep: Sweep) -> None:
    """Draw section points, the last 16 of periodic motions; dashed: published boundaries."""
    for periodic, size in ((False, 0.5), (True, 1.2)):
        at = np.flatnonzero((sweep.motions > 0) == periodic)
        x = sweep.x[at, -SHOWN:] if periodic else sweep.x[at]
        values = np.repeat(sweep.values[at], x.shape[1])
        axes.scatter(values, x.ravel(), s=size, color=INK, linewidths=0, rasterized=True)
    for left, right in pairwise(scenario.windows):
        axes.axvline((left.high + right.low) / 2.0, color=GREY, linewidth=0.7, ls=(0, (4, 3)))
    axes.set_ylabel(X_LABEL)


def _exponents(axes: Axes, sweep: Sweep) -> None:
    value, _, within, transverse = sweep.exponents.T
    axes.axhline(0, color=GREY, linewidth=0.8)
    axes.plot(sweep.values, within, color=BLUE, label="left and right alike")
    axes.plot(sweep.values, transverse, color=ORANGE, linewidth=0.7, label="across: parting them")
    if not np.isfinite(within).any():
        axes.plot(sweep.values, value, color=BLUE, label="largest")
    axes.set_ylabel(r"$\lambda_1$ per $\tau$")
    low = float(np.nanmin(np.fmax(value, -0.12))) if np.isfinite(value).any() else -0.1
    axes.set_ylim(bottom=min(low, -0.05) * 1.1)
    axes.set_ylim(top=HEADROOM * axes.get_ylim()[1])
    axes.legend(loc="upper right", fontsize=8, ncols=2)


def published(scenario: Scenario) -> list[int]:
    """Motions of the windows that the paper states."""
    return [window.motion for window in scenario.windows]


def _legend(figure: Figure, motions: Sequence[int]) -> None:
    kinds = sorted({int(m) if int(m) in COLOURS else 99 for m in motions})
    patches = [
        Patch(color=colour(kind), label="other period" if kind == 99 else motion_name(kind))
        for kind in kinds
    ]
    figure.legend(handles=patches, loc="outside upper right", ncols=len(patches), fontsize=8)


def widen_section(figure: Figure, result: SegmentResult) -> None:
    """Zoom the section in a ``motion_figure`` to its points if the motion is periodic.

    With the limits of the phase portrait the points could not be distinguished.
    """
    if not result.period.value:
        return
    axes = figure.axes[2]
    points = np.asarray(axes.collections[0].get_offsets(), dtype=float)
    middle = (points.max(axis=0) + points.min(axis=0)) / 2.0
    half = np.maximum(0.8 * np.ptp(points, axis=0), LEAST_HALF)
    axes.set(xlim=middle[0] + half[0] * ENDS, ylim=middle[1] + half[1] * ENDS)
