"""Maps of two parameters: period, largest exponent and loss of contact as pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colorbar import Colorbar
from matplotlib.colors import ListedColormap, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from herringbone_sim.arrays import Array
from herringbone_sim.control.runs import LEAST_EXPONENT
from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps.store import Result
from herringbone_sim.views.figures.style import (
    FRAMED_STYLE,
    INK,
    parameter_label,
    save,
)

DPI = 220
NO_LOSS = "#e9eaec"
LOSSES = {1: ("Blues", "one\nflank"), 2: ("Oranges", "both\nflanks")}
FAILED = "#ffffff"
APERIODIC = "#1d2027"
NEITHER = "#8d93a0"  # neither aperiodic nor of a period that has a colour
# Hue by the odd part of the period, darker with each doubling.
PERIOD_COLOURS = {
    1: "#dce9f5",
    2: "#86b8df",
    4: "#3a83c1",
    8: "#10579c",
    16: "#0a3566",
    3: "#fdca85",
    6: "#f28e2b",
    12: "#b85c0b",
    5: "#98d6a6",
    10: "#2f9e5e",
    7: "#cdb5e8",
    14: "#8656b9",
    9: "#f5a9b8",
    11: "#c8443c",
    13: "#c9b21d",
    15: "#7a5546",
}
HATCH = "//////"
LISTED = 1e-3  # least fraction of the cells at which a period is in the legend
STRETCH = 99.0  # percentile of the exponents at which the colours saturate


def period_places(period: Array) -> Array:
    """Return the index of each period in (0, *PERIOD_COLOURS); NaN for any other period."""
    places = np.full(period.shape, np.nan)
    for place, value in enumerate([0, *PERIOD_COLOURS]):
        places[period == value] = place
    return places


def write_maps(folder: Path, result: Result) -> list[Path]:
    """Write the maps ``period``, ``exponent``, ``contact``, and all side by side as ``map``.

    Each as PNG and SVG; without exponents there is no map ``exponent``. Returns the paths.

    Raises:
        AnalysisError: the sweep has not two axes of two values or more, or no run succeeded.
    """
    if len(result.axes) != 2 or min(result.sweep.shape) < 2:
        raise AnalysisError(
            f"a map needs two axes of two values or more, got {result.sweep.shape}: give --over "
            "twice"
        )
    if not np.isfinite(result["asymmetry"]).any():
        reasons = "; ".join(map(str, result.failures()))
        raise AnalysisError(f"no value of this map came out: {reasons}")
    parts = _parts(result)
    written = []
    for name, draw in parts.items():
        written += save_map(_figure([draw], result, (4.9, 3.7)), folder, name)
    whole = _figure(list(parts.values()), result, (4.5 * len(parts), 3.7))
    return written + save_map(whole, folder, "map")


def save_map(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write a figure as ``name.png`` and ``name.svg`` into a folder; return both paths."""
    return [*save(figure, folder, name, DPI, FRAMED_STYLE)]


def draw_period(axes: Axes, result: Result) -> None:
    """Draw the period by colour, aperiodic motions dark, longer periods grey, failed runs white.

    Hatched: periodic motions with a positive exponent, which are reached only because left and
    right start equal.
    """
    period = result["period"]
    colours = ListedColormap([APERIODIC, *PERIOD_COLOURS.values(), NEITHER])
    limits: Any = {"vmin": -0.5, "vmax": len(PERIOD_COLOURS) + 1.5}
    places, longer = period_places(period), period > max(PERIOD_COLOURS)
    places[longer] = len(PERIOD_COLOURS) + 1
    cells(axes, *_places(result), places, cmap=colours, **limits)
    axes.set_title("period of the motion, mesh cycles")
    handles = [
        Patch(facecolor=PERIOD_COLOURS[n], edgecolor=INK, linewidth=0.4, label=f"P{n}")
        for n in sorted(PERIOD_COLOURS)
        if (period == n).mean() >= LISTED
    ]
    if longer.any():
        handles.append(Patch(facecolor=NEITHER, label=f"above P{max(PERIOD_COLOURS)}"))
    if (period == 0).any():
        handles.append(Patch(facecolor=APERIODIC, label="aperiodic"))
    if np.isnan(period).any():
        handles.append(Patch(facecolor=FAILED, edgecolor=INK, linewidth=0.4, label="none"))
    if _hatch_unstable(axes, result):
        handles.append(
            Patch(facecolor="none", edgecolor=INK, lw=0.0, hatch=HATCH, label="sides would part")
        )
    look: Any = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "borderaxespad": 0.0}
    axes.legend(handles=handles, handlelength=1.0, handleheight=1.0, fontsize=8, **look)


def _hatch_unstable(axes: Axes, result: Result) -> bool:
    """Hatch periodic motions with a positive exponent; returns whether there are any."""
    positive = result["exponent"] > np.maximum(2.0 * result["exponent_error"], LEAST_EXPONENT)
    unstable = (result["period"] > 0) & positive
    if unstable.any():
        share = unstable.T.astype(float)
        axes.contourf(*_places(result), share, levels=[0.5, 1.5], colors="none", hatches=[HATCH])
    return bool(unstable.any())


def draw_exponent(axes: Axes, result: Result) -> None:
    """Draw the largest exponent by colour: white at zero, red above, blue below."""
    bar = draw_rates(axes, *_places(result), result["exponent"], r"$\lambda_1$ per $\tau$")
    axes.set_title("largest Lyapunov exponent")
    low, high = bar.norm.vmin or 0.0, bar.norm.vmax or 0.0
    halves = [MaxNLocator(4).tick_values(*ends) for ends in ((low, 0.0), (0.0, high))]
    bar.set_ticks([t for half in halves for t in half if low <= t <= high])
    bar.ax.axhline(0.0, color=INK, linewidth=0.8)


def draw_rates(
    axes: Axes, x: Sequence[float] | Array, y: Array, rates: Array, label: str
) -> Colorbar:
    """Draw exponents (n, m) over x (n,) and y (m,); return their colour bar, with the label.

    White at zero, red above, blue below, each with a scale of its own.
    """
    image = cells(axes, x, y, rates, cmap="RdBu_r", norm=exponent_norm(rates))
    assert axes.figure is not None
    bar = axes.figure.colorbar(image, ax=axes, extend="both", pad=0.02, aspect=28)
    bar.set_label(label)
    return bar


def exponent_norm(exponents: Array) -> TwoSlopeNorm:
    """Return a colour scale centred at 0 from the 1st to the 99th percentile of the exponents."""
    known = exponents[np.isfinite(exponents)]
    low, high = np.percentile(known, [100.0 - STRETCH, STRETCH]) if known.size else (0.0, 0.0)
    return TwoSlopeNorm(0.0, min(float(low), -1e-3), max(float(high), 1e-3))


def draw_contact(axes: Axes, result: Result) -> None:
    """Draw loss of contact: hue by number of flanks, depth by the fraction of time apart."""
    apart = (result["sun_separated"] + result["ring_separated"]) / 2.0
    loss = result["contact_loss"]
    places = _places(result)
    cells(axes, *places, np.where(loss == 0, 0.0, np.nan), cmap=ListedColormap([NO_LOSS]))
    axes.set_title("loss of contact: share of the time apart")
    assert axes.figure is not None
    for level, (colours, label) in reversed(LOSSES.items()):
        if (loss == level).any():
            share = np.where(loss == level, apart, np.nan)
            image = cells(axes, *places, share, cmap=colours, vmin=-0.15, vmax=1.0)
            bar = axes.figure.colorbar(image, ax=axes, pad=0.02, aspect=28)
            bar.ax.set_ylim(0.0, 1.0)
            bar.ax.set_title(label, fontsize=7, pad=4.0, loc="center")
    if (loss == 0).any():
        handle = Patch(facecolor=NO_LOSS, edgecolor=INK, linewidth=0.4, label="never lost")
        axes.legend(handles=[handle], handlelength=1.0, handleheight=1.0, fontsize=8, loc="best")


def _places(result: Result) -> tuple[Array, Array]:
    """Values (n,) and (m,) of the two axes of a sweep."""
    first, second = result.axes
    return np.array(first.values), np.array(second.values)


def _parts(result: Result) -> dict[str, Callable[[Axes, Result], None]]:
    parts: dict[str, Callable[[Axes, Result], None]] = {"period": draw_period}
    if np.isfinite(result["exponent"]).any():
        parts["exponent"] = draw_exponent
    return parts | {"contact": draw_contact}


def _figure(
    draws: list[Callable[[Axes, Result], None]], result: Result, size: tuple[float, float]
) -> Figure:
    with matplotlib.rc_context(FRAMED_STYLE):
        figure = Figure(figsize=size)
        for axes, draw in zip(
            figure.subplots(1, len(draws), squeeze=False)[0], draws, strict=True
        ):
            draw(axes, result)
            axes.set_xlabel(parameter_label(result.axes[0].name))
            axes.set_ylabel(parameter_label(result.axes[1].name))
        return figure


def cells(axes: Axes, x: Sequence[float] | Array, y: Array, data: Array, **look: Any) -> Any:
    """Draw cells coloured by data (n, m) over x (n,) and y (m,); return their collection."""
    return axes.pcolormesh(x, y, data.T, shading="nearest", rasterized=True, **look)
