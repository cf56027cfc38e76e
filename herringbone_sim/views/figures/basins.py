"""Figure of basins of attraction: slice, shares of the starts, phase portraits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from herringbone_sim.core.integrate import stepper
from herringbone_sim.core.model import Model
from herringbone_sim.dynamics.basins import Basins
from herringbone_sim.effects.assemble import changed
from herringbone_sim.views.figures.style import BLUE, GREEN, GREY, INK, ORANGE, STYLE

Array = NDArray[np.float64]

COLOURS = (BLUE, ORANGE, GREEN, "#CC79A7", "#E69F00", "#56B4E9", "#7f4f24", "#F0E442", INK)
PORTRAITS, PER_CYCLE, CYCLES = 5, 64, 60


def basins_figure(
    model: Model,
    names: Sequence[str],
    shared: Basins,
    plane: tuple[Array, Basins] | None = None,
    at: int = 0,
) -> Figure:
    """Slice beside the shares, above a phase portrait of each attractor.

    Args:
        model: of the gear; runs a few cycles for the portraits.
        names: of the attractors.
        shared: of random starts.
        plane: axis and basins of a slice, with the attractors of ``shared`` first.
        at: mesh cycles that had passed at the last point of each attractor.
    """
    attractors = (plane[1] if plane else shared).attractors
    columns = max(min(len(attractors), PORTRAITS), 3)
    names = [f"{i}: {name}" for i, name in enumerate(names, start=1)]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 6.2 if plane else 4.2))
        ratios = [3.6 if plane else 1.6, 2.0]
        top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=ratios)[:, 0]
        axes = top.subplots(1, 2 if plane else 1, squeeze=False)[0]
        if plane:
            draw_slice(axes[0], *plane)
        draw_shares(axes[-1], names, shared)
        portraits = bottom.subplots(1, columns, sharex=True, sharey=True)
        for portrait in portraits[len(attractors) :]:
            portrait.set_visible(False)
        for i, (portrait, one) in enumerate(zip(portraits, attractors, strict=False)):
            draw_portrait(portrait, model, (one.points[-1], at), COLOURS[i], names[i])
        portraits[0].set_ylabel(r"$\dot x$ / $b_c\,\omega_n$")
        return figure


def draw_slice(axes: Axes, axis: Array, basins: Basins) -> None:
    """Attractor of each start of the slice by colour; white where the run failed."""
    half = 0.5 * (axis[1] - axis[0]) if len(axis) > 1 else 0.5
    extent = (axis[0] - half, axis[-1] + half) * 2
    labels = np.ma.masked_less(basins.labels, 0)
    count = len(basins.attractors)
    colours = ListedColormap([COLOURS[min(i, len(COLOURS) - 1)] for i in range(count)])
    axes.imshow(
        np.ma.masked_invalid(labels),
        cmap=colours,
        vmin=-0.5,
        vmax=count - 0.5,
        origin="lower",
        extent=extent,
        interpolation="nearest",
    )
    axes.set(
        title="starts at rest",
        xlabel=r"$(x^\mathrm{L} + x^\mathrm{R})/2$ / $b_c$",
        ylabel=r"$x^\mathrm{L} - x^\mathrm{R}$ / $b_c$",
    )
    axes.locator_params(nbins=5)


def draw_shares(axes: Axes, names: Sequence[str], basins: Basins) -> None:
    """Share of the random starts of each attractor, with its 95 % interval."""
    places = np.arange(len(basins.attractors))
    share, low, high = 100.0 * basins.shares().T
    colours = [COLOURS[min(i, len(COLOURS) - 1)] for i in range(len(places))]
    axes.barh(places, share, height=0.5, color=colours)
    look: Any = {"fmt": "none", "ecolor": INK, "elinewidth": 1.0, "capsize": 2.5}
    errors = np.maximum([share - low, high - share], 0.0)
    axes.errorbar(share, places, xerr=errors, **look)
    for place, name, value in zip(places, names, share, strict=False):
        axes.text(0.0, place - 0.36, f"{name}: {value:.1f} %", fontsize=8, va="bottom")
    axes.set(title=f"{len(basins.labels)} random starts", xlabel="share of the starts [%]")
    axes.set(yticks=[], xlim=(0.0, 100.0), ylim=(len(places) - 0.4, -0.75))
    axes.spines["left"].set_visible(False)


def draw_portrait(
    axes: Axes, model: Model, start: tuple[Array, int], colour: str, name: str
) -> None:
    """Rate over displacement of the left sun mesh, grey beneath it the right one.

    Args:
        start: state (n_state,) at phase 0, and mesh cycles that have passed there.
    """
    layout, scales = model.layout, model.scales
    fine = changed(model, model.parameters.changed({"samples_per_cycle": PER_CYCLE}))
    machine = stepper(fine)
    begin = replace(machine.start(), y=np.array(start[0]), cycle=start[1])
    rows = machine.advance(begin, CYCLES * PER_CYCLE).rows
    left, right = layout.meshes[0], layout.meshes[layout.n_mesh // 4]
    for mesh, look, width in ((right, GREY, 0.9), (left, colour, 0.6)):
        x = rows[:, layout.channels.index(f"x_{mesh}")] / scales.b_c
        v = rows[:, layout.channels.index(f"v_{mesh}")] / scales.velocity_m_per_s
        axes.plot(x, v, color=look, linewidth=width, rasterized=True)
    axes.set_title(name.replace(", ", "\n"), fontsize=8)
    axes.set_xlabel(r"$x_\mathrm{sp}$ / $b_c$")
