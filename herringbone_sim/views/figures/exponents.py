"""Figure of the exponents of one motion: convergence, two trajectories, symmetry, 0-1 test."""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from herringbone_sim.analysis.zero_one import ZeroOne, walks
from herringbone_sim.arrays import Array
from herringbone_sim.dynamics.exponent_methods import ExponentComparison
from herringbone_sim.dynamics.growth import Growth
from herringbone_sim.views.figures.style import BLUE, GREY, INK, ORANGE, STYLE

UNIT = r"$\lambda$ per $\tau$"
STRETCH = 25  # periods of one finite-time exponent
FROM = 10  # period from which convergence is drawn
SIGMAS = 2.0


def exponents_figure(comparison: ExponentComparison, title: str) -> Figure:
    """Draw the Lyapunov exponents of one motion by several methods in four panels.

    The lower left panel compares symmetric and antisymmetric perturbations; for a motion without
    left-right symmetry it shows the spectrum instead.

    Args:
        comparison: results of all methods.
        title: operating point as text.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.6))
        panels = figure.subplots(2, 2)
        draw_convergence(panels[0, 0], comparison.spectrum)
        draw_distances(panels[0, 1], comparison)
        if comparison.symmetric is None:
            draw_spectrum(panels[1, 0], comparison.spectrum)
        else:
            draw_finite_time(
                panels[1, 0], comparison.symmetric.within, comparison.symmetric.transverse
            )
        draw_zero_one(panels[1, 1], comparison)
        for axes, letter in zip(panels.flat, "abcd", strict=True):
            axes.set_title(f"({letter}) {axes.get_title('left')}", loc="left")
        figure.suptitle(f"{comparison.motion}      {title}", x=0.01, ha="left", fontsize=9)
        return figure


def draw_convergence(axes: Axes, spectrum: Growth) -> None:
    """Draw running means of all exponents; bands: final values ± two standard errors."""
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    cycles = np.arange(1, len(spectrum.running) + 1)
    colours = _shades(len(spectrum.exponents))
    for j, colour in enumerate(colours):
        value, band = spectrum.exponents[j], SIGMAS * spectrum.errors[j]
        axes.plot(cycles[FROM:], spectrum.running[FROM:, j], color=colour)
        axes.axhspan(value - band, value + band, color=colour, alpha=0.15, linewidth=0)
    axes.set(title="spectrum, running mean", xlabel="periods", ylabel=UNIT, xscale="log")
    axes.set_xlim(FROM, len(cycles))


def draw_distances(axes: Axes, comparison: ExponentComparison) -> None:
    """Draw the largest exponent by two trajectories over their distance, and by tangent flow."""
    value, error = comparison.spectrum.exponents[0], SIGMAS * comparison.spectrum.errors[0]
    axes.axhspan(value - error, value + error, color=BLUE, alpha=0.2, linewidth=0)
    axes.axhline(value, color=BLUE, label="tangent flow")
    known = np.isfinite(comparison.two_trajectories[:, 0])
    means, errors = comparison.two_trajectories[known].T
    look: Any = {"fmt": "o", "ms": 3.5, "color": ORANGE, "elinewidth": 0.8}
    axes.errorbar(
        comparison.distances[known], means, SIGMAS * errors, label="two trajectories", **look
    )
    axes.set(title="largest exponent", xlabel=r"distance / $b_c$", ylabel=UNIT, xscale="log")
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.legend(fontsize=8, loc="best")


def draw_finite_time(axes: Axes, within: Growth, transverse: Growth) -> None:
    """Draw histograms of finite-time exponents of symmetric and of antisymmetric perturbations."""
    values = [part.finite_time(STRETCH)[:, 0] for part in (within, transverse)]
    edges = _edges(np.concatenate(values))
    names = ("left and right alike", "left and right part")
    for exponents, growth, colour, name in zip(
        values, (within, transverse), (BLUE, ORANGE), names, strict=True
    ):
        label = f"{name}: {growth.exponents[0]:+.4f}"
        axes.hist(exponents, list(edges), color=colour, alpha=0.45, label=label)
        axes.axvline(growth.exponents[0], ymax=0.72, color=colour)
    axes.axvline(0.0, ymax=0.72, color=INK, linewidth=0.8, linestyle=":")
    axes.set(title=f"left against right, {STRETCH} periods each", xlabel=UNIT, ylabel="stretches")
    axes.set_ylim(top=axes.get_ylim()[1] / 0.72)
    axes.legend(fontsize=8, loc="upper left")


def draw_spectrum(axes: Axes, spectrum: Growth) -> None:
    """Draw all Lyapunov exponents with two standard errors."""
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    index = np.arange(1, len(spectrum.exponents) + 1)
    look: Any = {"fmt": "o", "ms": 4, "color": BLUE, "elinewidth": 0.8}
    axes.errorbar(index, spectrum.exponents, SIGMAS * spectrum.errors, **look)
    axes.set(title="spectrum", xlabel="number", ylabel=UNIT, xticks=index)


def draw_zero_one(axes: Axes, comparison: ExponentComparison) -> None:
    """Draw the correlation at each frequency of the 0-1 test: near 1 chaotic, near 0 regular."""
    test = comparison.zero_one
    for level in (0.0, 1.0):
        axes.axhline(level, color=GREY, linewidth=0.8)
    axes.plot(test.frequencies / np.pi, test.correlations, ".", ms=4, color=INK)
    axes.axhline(test.K, color=ORANGE, label=f"median K = {test.K:.2f}")
    axes.set(title="0-1 test", xlabel=r"$c\,/\,\pi$", ylabel="$K_c$", ylim=(-1.1, 1.25))
    axes.legend(fontsize=8, loc="lower right")
    _draw_walk(axes, comparison.section[:, 0], test)


def _draw_walk(axes: Axes, series: Array, test: ZeroOne) -> None:
    """Draw an inset with the walk at the frequency whose correlation is nearest to the median."""
    nearest = int(np.argmin(np.abs(test.correlations - test.K)))
    walk = walks(series - series.mean(), test.frequencies[nearest : nearest + 1])[:, 0]
    inset = axes.inset_axes((0.1, 0.05, 0.4, 0.36) if test.K < 0.5 else (0.1, 0.05, 0.4, 0.78))
    inset.plot(walk.real, walk.imag, color=BLUE, linewidth=0.4)
    inset.set_aspect("equal", adjustable="datalim")
    inset.set(xticks=[], yticks=[])
    for spine in inset.spines.values():
        spine.set(visible=True, color=GREY)
    inset.set_ylabel("walk $(p, q)$", fontsize=8, labelpad=2)


def _edges(values: Array) -> Array:
    low, high = float(values.min()), float(values.max())
    room = max(0.05 * (high - low), 1e-4)
    edges: Array = np.linspace(low - room, high + room, 41, dtype=np.float64)
    return edges


def _shades(n: int) -> list[Any]:
    return [matplotlib.colormaps["viridis"](0.85 * i / max(n - 1, 1)) for i in range(n)]
