"""A batch of gears by their laws: through the lanes, and what comes of it as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model
from herringbone_sim.effects.gear import pointers_allowed
from herringbone_sim.effects.lanes.gear import lane_gear
from herringbone_sim.effects.lanes.machine import Queue, run_queue
from herringbone_sim.effects.law_stepper import LawStepper


class LaneStepper(LawStepper):
    """Of a gear whose own laws are written for lanes: one orbit, or a batch by ``run_batch``."""

    run_batch = staticmethod(lambda *args: run_batch(*args))


class Found(NamedTuple):
    """What comes of n values; s numbers of a state."""

    sections: Array  # (n, points, s) states at phase 0 of the last cycles
    end: Array  # (n, s)
    growth: Array  # (n, cycles, tangents) logarithms of the growth in each cycle
    contact: Array  # (n, n_mesh, 3) time in back contact, separated, in drive contact
    failed: NDArray[np.bool_]  # (n,)


def run_batch(
    models: Sequence[Model],
    starts: Array,
    before: NDArray[np.int64],
    length: tuple[int, int, int],
    tangents: int,
) -> Found:
    """Run n gears of one layout with the same effects, sixteen at a time.

    Args:
        starts: (n, s) states at phase 0.
        before: (n,) mesh cycles that each has run earlier.
        length: mesh cycles left out, those observed, and section points kept.
        tangents: 0 or 1.
    """
    machines = [LawStepper(model) for model in models]
    transient, cycles, points = length
    m, table = lane_gear(models, [one.gear for one in machines], tangents)
    n, s = starts.shape
    found = Found(
        np.full((n, points, s), np.nan),
        np.full((n, s), np.nan),
        np.zeros((n, cycles, tangents)),
        np.zeros((n, models[0].layout.n_mesh, 3)),
        np.zeros(n, dtype=np.bool_),
    )
    steps = np.array([model.parameters.steps for model in models])
    frame = machines[0].start(tangents).tangents
    queue = Queue(table, steps, np.ascontiguousarray(starts), frame, before, *found)
    with pointers_allowed():
        run_queue(m, queue, (transient, cycles))
    return found
