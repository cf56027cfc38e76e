"""First rows of torques and events in ``Work.constants``."""

from __future__ import annotations

from herringbone_sim.core.lanes.packed import (
    HARMONICS,
    ROWS_A_HARMONIC,
    ROWS_A_LOAD,
    ROWS_AN_EVENT,
)
from herringbone_sim.core.packed import inlined


@inlined
def load_row(w, j):
    """Return the first row of the constants of torque j."""
    return HARMONICS + ROWS_A_HARMONIC * w.sizes[0] + ROWS_A_LOAD * j


@inlined
def event_row(w, j):
    """Return the first row of the constants of event j."""
    return load_row(w, w.sizes[1]) + ROWS_AN_EVENT * j
