"""Integrate a batch of gears by the laws of their effects in lanes."""

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
    """``LawStepper`` for laws written for lanes: ``core.batch`` calls its ``run_batch``."""

    run_batch = staticmethod(lambda *args: run_batch(*args))


class Found(NamedTuple):
    """Results of n gears; s = size of a state, times in tau."""

    sections: Array  # (n, points, s) states at phase 0 of the last cycles, NaN if not reached
    end: Array  # (n, s) last state
    growth: Array  # (n, cycles, tangents) logarithms of the tangents' growth in each cycle
    contact: Array  # (n, n_mesh, 3) observed time in back contact, separated, drive contact
    failed: NDArray[np.bool_]  # (n,) whether the motion diverged


def run_batch(
    models: Sequence[Model],
    starts: Array,
    before: NDArray[np.int64],
    length: tuple[int, int, int],
    tangents: int,
) -> Found:
    """Integrate n gears of one layout with the same effects, sixteen at a time.

    Args:
        models: the n gears; values of their parameters and effects may differ.
        starts: (n, s) dimensionless states at phase 0.
        before: (n,) number of the mesh cycle in which each starts.
        length: number of mesh cycles left out, then observed, and of section points returned.
        tangents: number of tangent vectors, 0 or 1.
    """
    machines = [LawStepper(model) for model in models]
    transient, cycles, points = length
    m, table = lane_gear(models, [machine.gear for machine in machines], tangents)
    n, s = starts.shape
    orbits = Found(
        np.full((n, points, s), np.nan),
        np.full((n, s), np.nan),
        np.zeros((n, cycles, tangents)),
        np.zeros((n, models[0].layout.n_mesh, 3)),
        np.zeros(n, dtype=np.bool_),
    )
    steps = np.array([model.parameters.steps for model in models])
    frame = machines[0].start(tangents).tangents
    queue = Queue(table, steps, np.ascontiguousarray(starts), frame, before, *orbits)
    with pointers_allowed():
        run_queue(m, queue, (transient, cycles))
    return orbits
