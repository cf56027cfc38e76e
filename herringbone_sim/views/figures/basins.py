"""Figure of basins of attraction: slice of the start states, fractions of starts, portraits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from herringbone_sim.arrays import Array
from herringbone_sim.dynamics.basins import Basins
from herringbone_sim.dynamics.portraits import Portrait
from herringbone_sim.views.figures.style import BLUE, GREEN, GREY, INK, ORANGE, STYLE

COLOURS = (BLUE, ORANGE, GREEN, "#CC79A7", "#E69F00", "#56B4E9", "#7f4f24", "#F0E442", INK)
PORTRAITS = 5


def basins_figure(
    portraits: Sequence[Portrait],
    names: Sequence[str],
    shared: Basins,
    plane: tuple[Array, Basins] | None = None,
) -> Figure:
    """Draw a slice of the basins, the fractions of random starts, and phase portraits.

    Args:
        portraits: of the attractors; the first five are drawn.
        names: of all attractors.
        shared: basins of random start states.
        plane: axis (n,) in b_c and basins of an (n, n) slice of start states at rest, with the
            attractors of ``shared`` first; None: no slice.
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
        panels = bottom.subplots(1, columns, sharex=True, sharey=True)
        for panel in panels[len(attractors) :]:
            panel.set_visible(False)
        for i, (panel, portrait) in enumerate(zip(panels, portraits, strict=False)):
            draw_portrait(panel, portrait, COLOURS[i], names[i])
        panels[0].set_ylabel(r"$\dot x$ / $b_c\,\omega_n$")
        return figure


def draw_slice(axes: Axes, axis: Array, basins: Basins) -> None:
    """Draw the slice of start states, coloured by attractor; white where the run failed."""
    half = 0.5 * (axis[1] - axis[0]) if len(axis) > 1 else 0.5
    extent = (axis[0] - half, axis[-1] + half) * 2
    count = len(basins.attractors)
    colours = ListedColormap([COLOURS[min(i, len(COLOURS) - 1)] for i in range(count)])
    axes.imshow(
        np.ma.masked_less(basins.labels, 0),
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
    """Draw the fraction of random starts that leads to each attractor, with its 95 % interval."""
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


def draw_portrait(axes: Axes, portrait: Portrait, colour: str, name: str) -> None:
    """Draw velocity over displacement of the first left sun mesh; grey beneath it: right mesh.

    The y axis gets no label: panels in a row share it.

    Args:
        axes: to draw on.
        portrait: dimensionless motion of both meshes.
        colour: of the left mesh.
        name: title of the panel; each ", " becomes a new line.
    """
    for motion, look, width in ((portrait.right, GREY, 0.9), (portrait.left, colour, 0.6)):
        axes.plot(*motion.T, color=look, linewidth=width, rasterized=True)
    axes.set_title(name.replace(", ", "\n"), fontsize=8)
    axes.set_xlabel(r"$x_\mathrm{sp}$ / $b_c$")
