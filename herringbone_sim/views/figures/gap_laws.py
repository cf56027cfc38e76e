"""Figures of the laws that a diagnosis estimated: curve and 90 % band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.figures.style import BLUE, STYLE, save
from herringbone_sim.views.figures.text import plain_text
from herringbone_sim.views.pages.html import Picture

LOG_RATIO = 30.0  # of largest and smallest value, above which the axis is logarithmic


def write_law_figures(folder: Path, laws: Sequence[Mapping[str, Any]]) -> list[Picture]:
    """Write ``figures/gap_law_*.png`` and ``.svg`` of the laws of a report.

    Raises:
        AnalysisError: the folder can't be written.
    """
    drawn = []
    make_folder(folder / "figures")
    with matplotlib.rc_context(STYLE):
        for i, law in enumerate(laws):
            figure = law_figure(law)
            picture = save(figure, folder / "figures", f"gap_law_{i}")[0]
            caption = f"The law of {law['effect']} that the runs show, with its 90 % band"
            drawn.append(Picture(picture, caption))
    return drawn


def law_figure(law: Mapping[str, Any]) -> Figure:
    """Curve of an entry of ``law`` of a report."""
    x, y = law["x"], law["y"]
    values = np.array(x["values"], dtype=float)
    figure = Figure(figsize=(6.4, 3.4))
    axes = figure.subplots()
    axes.fill_between(values, y["low"], y["high"], color=BLUE, alpha=0.25, linewidth=0)
    axes.plot(values, y["values"], color=BLUE)
    if values.min() > 0.0 and values.max() > LOG_RATIO * values.min():
        axes.set_xscale("log")
    axes.axhline(0.0, color="#9aa3ad", linewidth=0.8)
    axes.set_xlabel(plain_text(f"{x['name']} [{x['unit']}]"))
    axes.set_ylabel(plain_text(f"{y['name']} [{y['unit']}]"))
    return figure
