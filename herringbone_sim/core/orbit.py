"""Integrate one orbit with the kernel of ``core.lanes``, one step of the phase grid at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.lanes.columns import Neighbours
from herringbone_sim.core.lanes.packed import (
    DONE,
    MOVE,
    SHARE,
    SWITCHES,
    Work,
    constants,
    make_work,
    sizes_of,
)
from herringbone_sim.core.lanes.run import begin_cycle, begin_steps
from herringbone_sim.core.lanes.vector import load, store
from herringbone_sim.core.model import Model
from herringbone_sim.core.packed import embedded


class Orbit(NamedTuple):
    """Data of one orbit for the kernel; both halves are integrated.

    Attributes:
        unrolled: see ``lanes.packed``.
        work: constants and work arrays; ``work.y (1 + k, n_state)`` is the state and k tangents.
        neighbours: None, or derivatives by parameters to integrate too, see ``lanes.columns``.
        inverse: (order + 2,) 1 / i at index i, 1 at index 0.
        controlled: whether K != 0, or effects add torques.
    """

    unrolled: tuple[tuple[int, ...], ...]
    work: Work
    neighbours: Neighbours | None
    inverse: Array
    controlled: bool


def orbit_of(model: Model, tangents: int, others: Sequence[Model] = ()) -> Orbit:
    """Return the orbit data of a model with ``tangents`` tangent vectors; its state is zero.

    Args:
        others: gears whose constants the arrays must be able to hold as well.
    """
    p, layout, gears = model.parameters, model.layout, [model, *others]
    sizes = sizes_of(gears, model.n_added_coordinates)
    table = constants(gears, 2, sizes)
    work = make_work(table, sizes, layout.n_mesh, 2, p.order, tangents, lanes=())
    work.constants[:] = table[0]
    work.steps[0] = p.steps
    return Orbit(
        ((0,) * 2, (0,) * layout.n_classes, (0,) * sizes.extended),
        work,
        None,
        1.0 / np.maximum(np.arange(p.order + 2.0), 1.0),
        sizes.loads > 0 or any(gear.packed.K != 0.0 for gear in gears),
    )


@embedded
def grid_step(move, orbit, cycle, index):
    """Advance the state and its tangents by one step of the phase grid; returns the number of
    located switches.

    Args:
        move: advances to the next switch or the end, as for ``lanes.run.through_lanes``.
        cycle, index: mesh cycle and step in it at which the step begins.
    """
    w = orbit.work
    begin_cycle(w, 0, cycle)
    w.step_index[0] = index
    store(w.progress, DONE, 0, 0.0)
    store(w.progress, SWITCHES, 0, 0.0)
    switches = 0
    going = True
    while going:
        begin_steps(w, w.step_index, w.steps)
        move(orbit.unrolled, w, orbit.neighbours, orbit.inverse, orbit.controlled)
        done = load(w.progress, DONE, 0)
        part = load(w.progress, MOVE, 0) * load(w.progress, SHARE, 0)
        if load(w.progress, MOVE, 0) < 1.0:
            switches += 1
        done = done + part * (1.0 - done)
        store(w.progress, DONE, 0, done)
        store(w.progress, SWITCHES, 0, load(w.progress, SWITCHES, 0) + 1.0)
        going = part != 1.0 and done < 1.0
    return switches
