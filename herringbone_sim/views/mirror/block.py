"""Input of the mirror: blocks of samples, and how they are drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan

import numpy as np

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.layout import Layout
from herringbone_sim.errors import ParameterError

DRIVE, SEPARATED, BACK = "drive", "separated", "back"
STATES = (DRIVE, SEPARATED, BACK)


@dataclass(frozen=True)
class Scale:
    """Units of the phase plane and the borders between contact states.

    Attributes:
        b_c: displacement scale b_c [m].
        b_half: mesh kind (``sp``, ``rp``) -> half backlash b' [m]; a missing kind has no
            contact state.
        omega_n: frequency scale [rad/s], 0 when unknown: velocities are then shown in m/s.
    """

    b_c: float
    b_half: Mapping[str, float] = field(default_factory=dict)
    omega_n: float = 0.0

    @property
    def velocity(self) -> tuple[float, str]:
        """Unit of velocity [m/s], and the text of that unit at the end of an axis label."""
        return (self.b_c * self.omega_n, " / (b_c ω_n)") if self.omega_n > 0 else (1.0, " [m/s]")


@dataclass(frozen=True)
class Drawing:
    """Settings of the mirror: what is drawn of each block, and in which units.

    Attributes:
        layout: names of the meshes.
        scale: units and backlash; without it displacements are in micrometres and there is no
            contact state.
        burst_cycles: mesh cycles at the end of each block that are shown at full rate.
        mesh: mesh of the phase plane; empty: the first of the layout that has data.

    Raises:
        ParameterError: an unknown mesh, or ``burst_cycles`` below 1.
    """

    layout: Layout
    scale: Scale | None = None
    burst_cycles: int = 20
    mesh: str = ""

    def __post_init__(self) -> None:
        if self.burst_cycles < 1:
            raise ParameterError(
                f"burst_cycles must be at least 1, got {self.burst_cycles}: choose a larger one"
            )
        if self.mesh:
            self.layout.mesh_index(self.mesh)


@dataclass(frozen=True)
class MirrorBlock:
    """Samples since the previous block, with results on the motion.

    Attributes:
        wall_ns: wall-clock stamp of the last row [ns since 1970].
        names: c channel names as in ``Layout.channels``, any subset that has ``t``.
        rows: (n, c) samples at full rate, SI.
        sections: (m, c) samples at mesh phase 0, SI.
        contact_shares: mesh -> fraction of time in drive contact, or None when unknown.
        parameters: name -> value in force at the end of the block.
        events: lines of text, oldest first.
        regime: ``P1``, ``P2``, ..., ``chaotic``, or empty when unknown.
        exponent: running largest Lyapunov exponent per tau, NaN when unknown.
        b_half: mesh kind -> half backlash [m], which overrides that of ``Scale``.
    """

    wall_ns: int
    names: tuple[str, ...]
    rows: Array
    sections: Array
    contact_shares: Mapping[str, float] | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    events: tuple[str, ...] = ()
    regime: str = ""
    exponent: float = nan
    b_half: Mapping[str, float] | None = None

    def column(self, name: str) -> Array:
        """Samples (n,) of a channel at full rate; ValueError when it is missing."""
        return self.rows[:, self.names.index(name)]

    def at_section(self, name: str) -> Array:
        """Samples (m,) of a channel at phase 0; ValueError when it is missing."""
        return self.sections[:, self.names.index(name)]


def contact_states(x: Array, b_half: float) -> Indices:
    """Return contact states (n,), indices into ``STATES``, their number where x is not known.

    ``x`` (n,) and ``b_half`` in one unit.
    """
    states = np.where(x > b_half, 0, np.where(x < -b_half, 2, 1))
    return np.where(np.isfinite(x), states, len(STATES))
