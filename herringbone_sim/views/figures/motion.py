"""Figures of recorded motions: four panels of a segment; bifurcation diagram, exponents."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.interpolate import CubicHermiteSpline

from herringbone_sim.analysis.bifurcation import BifurcationDiagram
from herringbone_sim.analysis.motion import Motion
from herringbone_sim.analysis.pipeline import SegmentResult
from herringbone_sim.arrays import Array
from herringbone_sim.views.figures.style import (
    BLUE,
    DENSE,
    GREY,
    INK,
    ORANGE,
    PARAMETER_SYMBOLS,
    PER_CYCLE,
    PORTRAIT_CYCLES,
    SHOWN_CYCLES,
    STYLE,
    Scale,
    parameter_label,
)
from herringbone_sim.views.figures.text import plain_text


def motion_figure(result: SegmentResult, mesh: str, scale: Scale) -> Figure:
    """Draw time course, phase portrait, Poincaré section and spectrum of a mesh in one segment."""
    known = result.half_backlash_m or {}
    half_backlash_m = known.get(mesh, known.get(mesh[:2]))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.4))
        axes = figure.subplots(2, 2)
        draw_time_course(axes[0, 0], result, mesh, scale, half_backlash_m)
        draw_phase_portrait(axes[0, 1], result, mesh, scale, half_backlash_m)
        draw_poincare(axes[1, 0], result, mesh, scale)
        draw_spectrum(axes[1, 1], result, mesh, scale)
        if result.period.value:
            axes[1, 0].set(xlim=axes[0, 1].get_xlim(), ylim=axes[0, 1].get_ylim())
        for axis, letter in zip(axes.flat, "abcd", strict=True):
            axis.set_title(f"({letter}) {axis.get_title('left')}", loc="left")
        figure.suptitle(motion_title(result), x=0.01, ha="left", fontsize=9)
        return figure


def motion_title(result: SegmentResult) -> str:
    """Return segment number, kind of motion and operating point as one line of text."""
    point = [
        f"{PARAMETER_SYMBOLS.get(name, plain_text(name))} = {value:.5g}"
        for name, value in result.segment.point.items()
        if np.isfinite(value) and not (name == "control_phase" and value == 0)
    ]
    return f"Segment {result.number}: {result.label}      {',  '.join(point)}"


def draw_time_course(
    axes: Axes, result: SegmentResult, mesh: str, scale: Scale, half_backlash_m: float | None
) -> None:
    """Draw the displacement over 24 mesh cycles, or 3 periods if longer; grey: flanks apart."""
    cycles = max(SHOWN_CYCLES, 3 * (result.period.value or 0))
    times, x, _ = _interpolated(result.motion, mesh, cycles)
    axes.plot((times - times[0]) / scale.time, x / scale.x, color=BLUE)
    _band(axes.axhspan, half_backlash_m, scale)
    axes.set(title="time course", xlabel=scale.time_label, ylabel=scale.x_label(mesh))
    axes.margins(x=0)


def draw_phase_portrait(
    axes: Axes, result: SegmentResult, mesh: str, scale: Scale, half_backlash_m: float | None
) -> None:
    """Draw velocity over displacement in the last 2 periods, or 160 cycles; grey: flanks apart."""
    cycles = 2 * result.period.value if result.period.value else PORTRAIT_CYCLES
    _, x, v = _interpolated(result.motion, mesh, cycles)
    width = 1.2 if result.period.value else 0.35
    line = axes.plot(x / scale.x, v / scale.v, color=BLUE, linewidth=width)[0]
    line.set_rasterized(len(x) > DENSE)
    _band(axes.axvspan, half_backlash_m, scale)
    axes.set(title="phase portrait", xlabel=scale.x_label(mesh), ylabel=scale.v_label(mesh))


def draw_poincare(axes: Axes, result: SegmentResult, mesh: str, scale: Scale) -> None:
    """Draw the Poincaré section of a mesh, one point per mesh cycle."""
    column = result.motion.meshes.index(mesh)
    x, v = result.section.x[:, column] / scale.x, result.section.v[:, column] / scale.v
    size = 14.0 if result.period.value else 1.2 if len(x) > 1000 else 4.0
    axes.scatter(x, v, s=size, color=ORANGE, linewidths=0, rasterized=len(x) > DENSE)
    title = f"Poincaré section, {len(x)} cycles"
    axes.set(title=title, xlabel=scale.x_label(mesh), ylabel=scale.v_label(mesh))


def draw_spectrum(axes: Axes, result: SegmentResult, mesh: str, scale: Scale) -> None:
    """Draw the amplitude over mesh order up to 5; marks at the foot: orders h / n, period n."""
    spectrum = result.spectrum
    axes.set(title="spectrum", xlabel=r"frequency / mesh frequency", ylabel=scale.x_label(mesh))
    amplitudes = np.zeros(0)
    if spectrum is not None:
        amplitudes = spectrum.amplitudes[:, result.motion.meshes.index(mesh)] / scale.x
    if spectrum is None or not amplitudes.any():
        why = "too few cycles" if spectrum is None else "no motion"
        axes.text(0.5, 0.5, why, transform=axes.transAxes, ha="center", color=GREY)
        return
    top = min(5.0, float(spectrum.orders[-1]))
    drawn = (spectrum.orders > 0.02) & (spectrum.orders <= top)
    axes.semilogy(spectrum.orders[drawn], np.maximum(amplitudes[drawn], 1e-300), color=BLUE)
    peak = float(amplitudes[drawn].max())
    axes.set(xlim=(0, top), ylim=(peak * 3e-6, peak * 3))
    n = result.period.value or 1
    marks = np.arange(1, int(top * n) + 1) / n
    axes.plot(
        marks,
        np.full(len(marks), 0.015),
        "^",
        ms=3,
        color=ORANGE,
        transform=axes.get_xaxis_transform(),
        label=f"$h\\,\\Omega/{n}$" if n > 1 else r"$h\,\Omega$",
    )
    axes.legend(loc="upper right", handletextpad=0.1)


def bifurcation_figure(diagram: BifurcationDiagram, scale: Scale) -> Figure:
    """Draw a bifurcation diagram above its largest exponents, if any is known."""
    with matplotlib.rc_context(STYLE):
        parts = 2 if has_exponents(diagram) else 1
        figure = Figure(figsize=(7.2, 3.0 + 2.2 * (parts - 1)))
        ratios = [3, 2][:parts]
        axes = figure.subplots(parts, 1, sharex=True, squeeze=False, height_ratios=ratios)[:, 0]
        draw_bifurcation(axes[0], diagram, scale)
        if parts == 2:
            draw_exponents(axes[1], diagram)
        axes[-1].set_xlabel(parameter_label(diagram.parameter))
        return figure


def has_exponents(diagram: BifurcationDiagram) -> bool:
    """Return whether any exponent, from data or model, is known."""
    both = np.concatenate((diagram.exponents[:, 0], diagram.model_exponents[:, 0]))
    return bool(np.isfinite(both).any())


def draw_bifurcation(axes: Axes, diagram: BifurcationDiagram, scale: Scale) -> None:
    """Draw section displacements over the parameter; blue where the parameter was falling."""
    size = 1.5 if sum(map(len, diagram.points)) > 4000 else 3.0
    for falling, colour, label in ((False, INK, "rising"), (True, BLUE, "falling")):
        at = np.flatnonzero(diagram.falling == falling)
        if not len(at):
            continue
        values = np.concatenate([diagram.point_values[i] for i in at])
        x = np.concatenate([diagram.points[i] for i in at]) / scale.x
        dense = len(x) > DENSE
        axes.scatter(values, x, s=size, color=colour, linewidths=0, rasterized=dense, label=label)
    axes.set(title="bifurcation diagram", ylabel=scale.x_label(diagram.mesh))
    if diagram.falling.any():
        axes.legend(loc="lower left", fontsize=8, markerscale=3)


def draw_exponents(axes: Axes, diagram: BifurcationDiagram) -> None:
    """Draw exponents from data, with 90 % intervals, and of the model.

    Per tau if omega_n is known in all segments, else per mesh cycle.
    """
    per_tau = bool(np.isfinite(diagram.cycles_per_tau).all())
    rate = diagram.cycles_per_tau if per_tau else np.ones(len(diagram.values))
    falling = diagram.falling
    value, low, high = (diagram.exponents * rate[:, None]).T
    axes.axhline(0, color=GREY, linewidth=0.8)
    if np.isfinite(diagram.model_exponents[:, 0]).any():
        model = diagram.model_exponents[:, 0] * rate
        for way, line, label in ((False, "-", "model, tangent flow"), (True, ":", "falling")):
            at = np.flatnonzero(falling == way)
            order = at[np.argsort(diagram.values[at], kind="stable")]
            style: Any = {"color": BLUE, "ls": line, "marker": ".", "ms": 3, "label": label}
            if len(at):
                axes.plot(diagram.values[order], model[order], **style)
    if np.isfinite(value).any():
        look: Any = {"fmt": "o", "ms": 2.5, "color": ORANGE, "elinewidth": 0.7}
        spread = np.array([value - low, high - value])
        axes.errorbar(diagram.values, value, spread, label="data, 90 % interval", **look)
    unit = r"$\lambda_1$ per $\tau$" if per_tau else r"$\lambda_1$ per mesh cycle"
    axes.set(title="largest Lyapunov exponent", ylabel=unit)
    axes.legend(loc="best", fontsize=8)


def representatives(results: Sequence[SegmentResult]) -> list[SegmentResult]:
    """Choose up to six segments to draw: the longest of each period, then the longest others.

    They have a spectrum; ramps are chosen only if no other segment has one.
    """
    drawable = [r for r in results if r.spectrum is not None and not r.segment.ramp]
    drawable = drawable or [r for r in results if r.spectrum is not None]
    longest = sorted(drawable, key=lambda r: -r.segment.cycles)
    first_of_kind = {r.period.label: r for r in reversed(longest)}
    others = [r for r in longest if r is not first_of_kind[r.period.label]]
    chosen = [*first_of_kind.values(), *others][:6]
    return sorted(chosen, key=lambda r: r.number)


def _interpolated(motion: Motion, mesh: str, cycles: int) -> tuple[Array, Array, Array]:
    """Return times [s], x [m] and v [m/s] of a mesh over the last ``cycles`` mesh cycles.

    ``PER_CYCLE`` points a cycle, by cubic Hermite interpolation of x and v; the samples
    themselves if they are more than half as dense.
    """
    column = motion.meshes.index(mesh)
    rows = min(len(motion), int(cycles * motion.samples_per_cycle) + 1)
    times, x, v = motion.times[-rows:], motion.x[-rows:, column], motion.v[-rows:, column]
    if rows < 2 or motion.samples_per_cycle > PER_CYCLE / 2:
        return times, x, v
    fine = np.linspace(times[0], times[-1], int(cycles * PER_CYCLE) + 1)
    spline = CubicHermiteSpline(times, x, v)
    return fine, spline(fine), spline.derivative()(fine)


def _band(span: Any, half_backlash_m: float | None, scale: Scale) -> None:
    if half_backlash_m is not None and np.isfinite(half_backlash_m):
        b = half_backlash_m / scale.x
        span(-b, b, color=GREY, alpha=0.16, linewidth=0, zorder=0)
