"""Figures of a gap report: mesh forces, residual by mesh phase and operating point, contact."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from herringbone_sim.arrays import Array
from herringbone_sim.core.layout import KINDS, SIDES
from herringbone_sim.gap.observations.reconstructed_forces import ReconstructedForces
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures.gap_forces import forces_caption, forces_figure
from herringbone_sim.views.figures.style import BLUE, GREY, ORANGE, STYLE, save
from herringbone_sim.views.figures.text import plain_text
from herringbone_sim.views.gear_geometry import MESHES, PLANETS
from herringbone_sim.views.picture import Picture

STATES = (("driving flank", BLUE), ("apart", "#dde1e6"), ("back flank", ORANGE))


@dataclass(frozen=True)
class GapArrays:
    """Data of the figures of a gap report; a figure without data is not drawn.

    Attributes:
        phase: (n_phase,) mesh phase [rad].
        residual_n: (n_phase, 12) mean residual of the force at that phase [N], meshes in the
            order of the channels.
        contact: (12, 3) fraction of time on the driving flank, apart, on the back flank.
        shares: factor, such as the temperature rise -> its value as text -> fraction of the
            squared residual above noise that runs at this value have.
        forces: of the twelve meshes in a run, reconstructed from few channels.
    """

    phase: Array | None = None
    residual_n: Array | None = None
    contact: Array | None = None
    shares: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    forces: ReconstructedForces | None = None


def write_gap_figures(folder: Path, arrays: GapArrays) -> list[Picture]:
    """Write ``figures/gap_*.png`` and ``.svg`` of the data present; return the pictures.

    Raises:
        AnalysisError: the folder can't be written.
    """
    drawn: dict[str, tuple[Figure, str]] = {}
    with matplotlib.rc_context(STYLE):
        if (forces := arrays.forces) is not None:
            drawn["forces"] = forces_figure(forces), forces_caption(forces)
        if arrays.phase is not None and arrays.residual_n is not None:
            figure = residual_figure(arrays.phase, arrays.residual_n)
            drawn["residual"] = figure, "Mean residual of the force over the mesh phase, fit runs"
        if arrays.shares:
            figure = shares_figure(arrays.shares)
            drawn["shares"] = figure, "Share of the residual by operating point, fit runs"
        if arrays.contact is not None:
            drawn["contact"] = contact_figure(arrays.contact), "Contact of the flanks, fit runs"
        make_folder(folder / "figures")
        return [
            Picture(save(figure, folder / "figures", f"gap_{name}")[0], caption)
            for name, (figure, caption) in drawn.items()
        ]


def residual_figure(phase: Array, residual_n: Array) -> Figure:
    """Draw a residual (n, 12) [N] over the mesh phase (n,) [rad], a panel per planet and kind."""
    figure = Figure(figsize=(9.6, 4.2))
    panels = figure.subplots(len(KINDS), len(PLANETS), sharex=True, sharey=True)
    for row, kind in enumerate(KINDS):
        for column, planet in enumerate(PLANETS):
            axes = panels[row, column]
            axes.axhline(0.0, color=GREY, linewidth=0.6)
            for side, colour in zip(SIDES, (BLUE, ORANGE), strict=True):
                residual = residual_n[:, MESHES.index(f"{kind}{planet}_{side}")]
                axes.plot(phase / (2 * np.pi), residual, color=colour, label=side)
            axes.set_title(f"{kind}{planet}")
    panels[0, 0].legend(ncols=2)
    figure.supxlabel("mesh phase [cycles]", fontsize=9)
    figure.supylabel("mean residual [N]", fontsize=9)
    return figure


def shares_figure(shares: Mapping[str, Mapping[str, float]]) -> Figure:
    """Draw a panel of bars per factor: fraction of the residual at each value of the factor."""
    figure = Figure(figsize=(9.6, 2.4 * -(-len(shares) // 3)))
    panels = figure.subplots(-(-len(shares) // 3), 3, squeeze=False).ravel()
    for axes in panels[len(shares) :]:
        axes.set_visible(False)
    for axes, (factor, values) in zip(panels, shares.items(), strict=False):
        axes.bar(range(len(values)), list(values.values()), color=BLUE, width=0.7)
        axes.set_xticks(range(len(values)), list(map(plain_text, values)))
        axes.set_title(plain_text(factor.replace("_", " ")))
        axes.set_ylim(0.0, None)
    return figure


def contact_figure(contact: Array) -> Figure:
    """Draw ``GapArrays.contact`` (12, 3): a stacked bar per mesh, fractions of time by contact."""
    figure = Figure(figsize=(9.6, 2.4))
    axes = figure.subplots()
    below = np.zeros(len(MESHES))
    for column, (state, colour) in enumerate(STATES):
        axes.bar(MESHES, contact[:, column], bottom=below, color=colour, label=state, width=0.7)
        below = below + contact[:, column]
    axes.set_ylim(0.0, 1.0)
    axes.set_ylabel("share of time")
    axes.legend(ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure
