"""Figure of the mesh forces that a diagnosis reconstructs from few channels."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from herringbone_sim.core.layout import KINDS, SIDES
from herringbone_sim.gap.observations.reconstructed_forces import ReconstructedForces
from herringbone_sim.views.figures.style import BLUE, GREY, ORANGE
from herringbone_sim.views.gear_geometry import PLANETS

SHOWN_CYCLES = 4.0  # mesh cycles drawn, the last of the fitted windows


def forces_figure(forces: ReconstructedForces) -> Figure:
    """Draw the forces of both sides with 90 % band, a panel per planet and mesh kind.

    Titles give the median half-width of the band.
    """
    cycles = (forces.phase - forces.phase[0]) / (2.0 * np.pi)
    shown = cycles >= cycles[-1] - SHOWN_CYCLES
    figure = Figure(figsize=(9.6, 4.6))
    panels = figure.subplots(len(KINDS), len(PLANETS), sharex=True, sharey=True)
    for row, kind in enumerate(KINDS):
        for column, planet in enumerate(PLANETS):
            axes = panels[row, column]
            axes.axhline(0.0, color=GREY, linewidth=0.6)
            title = f"{kind}{planet}:  band"
            for side, colour in zip(SIDES, (BLUE, ORANGE), strict=True):
                j = forces.meshes.index(f"{kind}{planet}_{side}")
                force, half = 1e-3 * forces.force[shown, j], 1e-3 * forces.half[shown, j]
                axes.fill_between(
                    cycles[shown], force - half, force + half, color=colour, alpha=0.35, lw=0
                )
                axes.plot(cycles[shown], force, color=colour, linewidth=0.7, label=side)
                title += f"  {side} ±{np.median(half):.2g}"
            axes.set_title(f"{title} kN")
    panels[0, 0].legend(ncols=2)
    figure.supxlabel("mesh cycles since the first fitted window", fontsize=9)
    figure.supylabel("mesh force [kN]", fontsize=9)
    return figure


def forces_caption(forces: ReconstructedForces) -> str:
    """Return the caption: run, effects of the gear, and whether planets are interchangeable."""
    gear = " and ".join(forces.effects)
    gear = f"the gear with {gear}" if gear else "the calibrated gear"
    alike = "; which planet is which can't be told" if forces.planets_alike else ""
    return (
        f"Mesh forces of {forces.run}, worked out from its recorded channels by the law of {gear},"
        f" with their 90 % band{alike}"
    )
