"""Phase portraits of attractors: the motion of a gear over 60 mesh cycles from a given state."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.integrate import stepper
from herringbone_sim.core.model import Model
from herringbone_sim.dynamics.attractors import Attractor
from herringbone_sim.effects.assemble import changed

CYCLES, PER_CYCLE = 60, 64  # mesh cycles; samples per cycle


@dataclass(frozen=True)
class Portrait:
    """Motion of the first left and the first right sun mesh.

    Attributes:
        left, right: (n, 2) displacement / b_c and rate / (b_c omega_n).
    """

    left: Array
    right: Array


def portraits(model: Model, attractors: Iterable[Attractor], cycle: int) -> list[Portrait]:
    """Phase portraits over ``CYCLES`` mesh cycles of attractors, from the last point of each.

    Args:
        model: the gear.
        attractors: their points are states at phase 0.
        cycle: mesh cycles elapsed before the last points, so that control and effects that don't
            repeat every mesh cycle continue from there.
    """
    return [portrait(model, attractor.points[-1], cycle) for attractor in attractors]


def portrait(model: Model, state: Array, cycle: int) -> Portrait:
    """Phase portrait from a state (n_state,) at phase 0, ``cycle`` mesh cycles after the start."""
    layout, scales = model.layout, model.scales
    gear = changed(model, model.parameters.changed({"samples_per_cycle": PER_CYCLE}))
    machine = stepper(gear)
    begin = replace(machine.start(), y=np.array(state), cycle=cycle)
    rows = machine.advance(begin, CYCLES * PER_CYCLE).rows
    units = np.array([scales.b_c, scales.velocity_m_per_s])

    def motion(mesh: str) -> Array:
        columns = [layout.channels.index(f"{quantity}_{mesh}") for quantity in "xv"]
        return np.asarray(rows[:, columns] / units)

    return Portrait(motion(layout.meshes[0]), motion(layout.meshes[layout.n_mesh // 4]))
