"""Style, labels and units of all figures; writes figures to files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from herringbone_sim.analysis.segments import FREQUENCY
from herringbone_sim.arrays import Array
from herringbone_sim.core.parameters import meaning, names
from herringbone_sim.views.figures.text import mesh_symbol, plain_text

BLUE, ORANGE, GREEN, INK, GREY = "#0072B2", "#D55E00", "#009E73", "#22262c", "#9aa1ab"
STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "mathtext.fontset": "dejavusans",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "lines.linewidth": 0.9,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
    "figure.facecolor": "white",
    "svg.fonttype": "path",
    "svg.hashsalt": "herringbone_sim",
}
FRAMED_STYLE = STYLE | {  # of maps
    "axes.spines.top": True,
    "axes.spines.right": True,
    "hatch.linewidth": 0.5,
    "hatch.color": INK,
}
DPI = 150
SHOWN_CYCLES, PORTRAIT_CYCLES, PER_CYCLE = 24, 160, 96
DENSE = 3000  # vertices above which a curve is rasterised in an SVG

PARAMETER_LABELS = {
    "K": "control amplitude $K$",
    "delta_T": r"temperature rise $\Delta T$ [K]",
    "T_1": "input torque $T_1$ [N m]",
    "xi": r"mesh damping ratio $\xi$",
    "control_phase": "phase of the control [rad]",
    "Omega": r"mesh frequency $\Omega=\omega/\omega_n$",
    FREQUENCY: "mesh frequency [Hz]",
}
PARAMETER_SYMBOLS = {
    "K": "$K$",
    "delta_T": r"$\Delta T$/K",
    "T_1": "$T_1$/(N m)",
    "xi": r"$\xi$",
    FREQUENCY: "mesh frequency/Hz",
}


@dataclass(frozen=True)
class Scale:
    """Units of the axes: µm, m/s and ms, or dimensionless, see ``of``.

    Attributes:
        x: metres in one unit of displacement.
        v: metres per second in one unit of velocity.
        time: seconds in one unit of time.
        x_unit, v_unit: ends of the axis labels.
        time_label: label of the time axis.
    """

    x: float = 1e-6
    v: float = 1.0
    time: float = 1e-3
    x_unit: str = " [µm]"
    v_unit: str = " [m/s]"
    time_label: str = "time [ms]"

    @classmethod
    def of(cls, b_c_m: float | None, omega_n: float | None) -> Scale:
        """Dimensionless units of a gear; µm, m/s and ms if one of its scales is unknown.

        Args:
            b_c_m: displacement scale [m], or None.
            omega_n: natural frequency [rad/s], or None.
        """
        if not (b_c_m and omega_n):
            return cls()
        units = r" / $b_c$", r" / $b_c\,\omega_n$", r"time $\tau = \omega_n t$"
        return cls(b_c_m, b_c_m * omega_n, 1 / omega_n, *units)

    def x_label(self, mesh: str) -> str:
        return mesh_symbol("x", mesh) + self.x_unit

    def v_label(self, mesh: str) -> str:
        return mesh_symbol(r"\dot x", mesh) + self.v_unit


def parameter_label(name: str) -> str:
    """Return the axis label of a parameter: symbol or name, with its unit if it has one."""
    if name in PARAMETER_LABELS:
        return PARAMETER_LABELS[name]
    unit = meaning(name).unit if name in names() else "-"
    return plain_text(name if unit == "-" else f"{name} [{unit}]")


def cell_edges(values: Array) -> Array:
    """Return edges (n + 1,) of cells around n >= 2 values: midpoints, and half a step outside."""
    half = np.diff(values) / 2.0
    ends = [values[0] - half[0]], [values[-1] + half[-1]]
    return np.concatenate([ends[0], values[:-1] + half, ends[1]])


def save(
    figure: Figure, folder: Path, name: str, dpi: int = DPI, style: Any = STYLE
) -> tuple[Path, Path]:
    """Write ``name.png`` and ``name.svg`` into a folder; returns both paths.

    Args:
        dpi: of the PNG file, and of what is rasterised in the SVG file.
        style: Matplotlib rc parameters of the figure; some are read only when it is written.
    """
    paths = folder / f"{name}.png", folder / f"{name}.svg"
    with matplotlib.rc_context(style):
        for path in paths:
            metadata = {"Date": None} if path.suffix == ".svg" else None
            figure.savefig(path, dpi=dpi, metadata=metadata)
    return paths
