"""Integrate a batch of gears by the laws of their effects in lanes."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import NamedTuple

import numpy as np

from herringbone_sim.arrays import Array, Flags, Indices
from herringbone_sim.core.model import Model
from herringbone_sim.effects.dormand_prince import CompiledGear
from herringbone_sim.effects.gear import pointers_allowed
from herringbone_sim.effects.lanes.gear import lane_gear
from herringbone_sim.effects.lanes.machine import Queue, run_queue
from herringbone_sim.effects.law_stepper import LawStepper


class LaneStepper(LawStepper):
    """``LawStepper`` for laws written for lanes: ``core.batch`` calls its ``run_batch``."""

    run_batch = staticmethod(lambda *args: run_batch(*args))


class Found(NamedTuple):
    """Results of ``run_batch`` for n gears; s = number of state variables, times in tau."""

    sections: Array  # (n, points, s) states at phase 0 of the last cycles, NaN if not reached
    end: Array  # (n, s) last state
    growth: Array  # (n, cycles, tangents) log growth of the tangents per cycle, 0 if not reached
    contact: Array  # (n, n_mesh, 3) observed time in back contact, separated, drive contact
    failed: Flags  # (n,) whether the motion diverged


def run_batch(
    models: Sequence[Model],
    starts: Array,
    before: Indices,
    length: tuple[int, int, int],
    tangents: int,
) -> Found:
    """Integrate n gears of one layout, sixteen at a time, in lanes with gears of the same laws.

    Args:
        models: the n gears; gears with other effects, or with another number of harmonics or of
            events, run one group after another.
        starts: (n, s) dimensionless states at phase 0.
        before: (n,) number of the mesh cycle in which each starts.
        length: number of mesh cycles left out, then observed, and of section points returned.
        tangents: number of tangent vectors, 0 or 1.
    """
    machines = [LawStepper(model) for model in models]
    transient, cycles, points = length
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
    groups: dict[Hashable, list[int]] = {}
    for i, (model, machine) in enumerate(zip(models, machines, strict=True)):
        groups.setdefault(_kind(model, machine.gear), []).append(i)
    for rows in groups.values():
        gears = [machines[i].gear for i in rows]
        m, table = lane_gear([models[i] for i in rows], gears, tangents)
        orbits = Found._make(values[rows] for values in found)
        queue = Queue(
            table, steps[rows], np.ascontiguousarray(starts[rows]), frame, before[rows], *orbits
        )
        with pointers_allowed():
            run_queue(m, queue, (transient, cycles))
        for values, of_group in zip(found, orbits, strict=True):
            values[rows] = of_group
    return found


def _kind(model: Model, gear: CompiledGear) -> Hashable:
    """Return what gears side by side in lanes share: their laws, and the sizes of constants."""
    effects = [active.effect for active in model.effects]
    laws = tuple((one.excite, one.react, one.drive, one.lanes) for one in effects)
    constants = (*gear.theta, *gear.site, gear.gear, gear.p.events)
    return laws, tuple(gear.e.first), tuple(part.shape for part in constants)
