"""Figures of the laws that a diagnosis estimated: curve and 90 % band."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

from herringbone_sim.gap.learned_law import LearnedLaw
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures.style import BLUE, GREY, STYLE, save
from herringbone_sim.views.figures.text import plain_text
from herringbone_sim.views.picture import Picture

LOG_RATIO = 30.0  # of largest and smallest value, above which the axis is logarithmic


def write_law_figures(folder: Path, laws: Sequence[LearnedLaw]) -> list[Picture]:
    """Write ``figures/gap_law_*.png`` and ``.svg``, a figure per law; return the pictures.

    Raises:
        AnalysisError: the folder can't be written.
    """
    drawn = []
    make_folder(folder / "figures")
    with matplotlib.rc_context(STYLE):
        for i, law in enumerate(laws):
            figure = law_figure(law)
            picture = save(figure, folder / "figures", f"gap_law_{i}")[0]
            caption = f"The law of {law.effect} that the runs show, with its 90 % band"
            drawn.append(Picture(picture, caption))
    return drawn


def law_figure(law: LearnedLaw) -> Figure:
    """Draw the curve of a law with its 90 % band."""
    figure = Figure(figsize=(6.4, 3.4))
    axes = figure.subplots()
    axes.fill_between(law.x, law.low, law.high, color=BLUE, alpha=0.25, linewidth=0)
    axes.plot(law.x, law.y, color=BLUE)
    if law.x.min() > 0.0 and law.x.max() > LOG_RATIO * law.x.min():
        axes.set_xscale("log")
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.set_xlabel(plain_text(f"{law.x_name} [{law.x_unit}]"))
    axes.set_ylabel(plain_text(f"{law.y_name} [{law.y_unit}]"))
    return figure
