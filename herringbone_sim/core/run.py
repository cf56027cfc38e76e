"""The compiled run: step by step over a grid of the mesh phase, a row of samples at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import typeof
from numpy.typing import NDArray

from herringbone_sim.core.lanes.any_moves import move_any
from herringbone_sim.core.lanes.run import move_plain
from herringbone_sim.core.model import Model
from herringbone_sim.core.orbit import Orbit, grid_step, orbit_of
from herringbone_sim.core.packed import LIMIT, TWO_PI, compiled, embedded, inlined, make_work
from herringbone_sim.core.right_hand_side import hide_displacement, mesh_forces, rk4_step

Array = NDArray[np.float64]


@compiled
def write_row(p, w, y, phase, cycle, head, si, carrier, row):
    """One sample: head, then x, v, F of the meshes, then u of the bodies; returns max |x|.

    ``w`` is as ``mesh_forces`` leaves it; x and v are shown without the displacement of effects.
    ``carrier (n_coordinate,)`` gives u_c, which all other bodies share: left and right see the
    same operations. The largest |x| is NaN when any is.
    """
    hide_displacement(p, w, y, phase, cycle)
    n = 4 * len(p.classes)
    for k in range(head.size):
        row[k] = head[k]
    row[1] = TWO_PI * cycle + phase
    largest = 0.0
    for m in range(n):
        row[5 + m] = w.x[m] * si[0]
        row[5 + n + m] = w.v[m] * si[1]
        row[5 + 2 * n + m] = w.force[m] * si[2]
        if abs(w.x[m]) > largest or np.isnan(w.x[m]):
            largest = abs(w.x[m])
    u_c = 0.0
    for k in range(carrier.size):
        u_c += carrier[k] * y[k]
    first = 5 + 3 * n
    for side in range(2):
        row[first + side] = y[side] * si[3] + 2.0 * u_c
    row[first + 2] = u_c
    for k in range(2, carrier.size):
        row[first + 1 + k] = y[k] * si[3] + u_c
    return largest


@compiled
def orthonormalise(tangents, growth):
    """Gram-Schmidt in place; adds the logarithms of the lengths to growth."""
    for i in range(tangents.shape[0]):
        for j in range(i):
            dot = 0.0
            for k in range(tangents.shape[1]):
                dot += tangents[i, k] * tangents[j, k]
            for k in range(tangents.shape[1]):
                tangents[i, k] -= dot * tangents[j, k]
        norm = 0.0
        for k in range(tangents.shape[1]):
            norm += tangents[i, k] * tangents[i, k]
        norm = np.sqrt(norm)
        growth[i] += np.log(norm)
        for k in range(tangents.shape[1]):
            tangents[i, k] /= norm


@inlined
def sample(
    step,
    kernel,
    p,
    w,
    y,
    tangents,
    growth,
    place,
    t,
    omega_n,
    steps,
    stride,
    head,
    si,
    carrier,
    rows,
    contact,
):
    """Fill rows with samples ``stride`` steps apart; returns (time, rows filled, switches).

    ``step(kernel, y, cycle, index)`` is the method. ``place`` is (cycle, index) and
    moves on. The run stops after the row that is out of range.
    """
    dt = TWO_PI / (p.Omega * steps) / omega_n
    switches = 0
    for i in range(rows.shape[0]):
        phase = TWO_PI * place[1] / steps
        head[0] = t
        mesh_forces(p, w, y, phase, place[0])
        for m in range(contact.shape[0]):
            contact[m, 1 + (w.x[m] > p.b[m]) - (w.x[m] < -p.b[m])] += 1
        largest = write_row(p, w, y, phase, place[0], head, si, carrier, rows[i])
        if not largest < LIMIT:
            return t, i + 1, switches
        for _ in range(stride):
            switches += step(kernel, y, place[0], place[1])
            t += dt
            place[1] += 1
            if place[1] == steps:
                place[1] = 0
                place[0] += 1
                orthonormalise(tangents, growth)
    return t, rows.shape[0], switches


@embedded
def over_cycles(step, kernel, y, cycle, cycles, steps):
    """Advance y, and the tangents beside it, over whole mesh cycles; no samples.

    Tangents keep their length: those of the unit matrix become the monodromy matrix, transposed.
    Same steps as ``sample``: the same state to the bit.
    """
    for c in range(cycle, cycle + cycles):
        for index in range(steps):
            step(kernel, y, c, index)


@inlined
def plain_step(orbit, y, cycle, index):
    """A step of the grid of a gear without powers, by series."""
    return grid_step(move_plain, orbit, cycle, index)


@inlined
def any_step(orbit, y, cycle, index):
    """A step of the grid of a gear with powers, by series."""
    return grid_step(move_any, orbit, cycle, index)


@inlined
def slow_step(kernel, y, cycle, index):
    """A step of the grid by the classical Runge-Kutta method."""
    p, w, steps = kernel
    rk4_step(p, w, y, TWO_PI * index / steps, cycle, TWO_PI / (p.Omega * steps))
    return 0


# Each method is compiled by itself, when it is first used.
@compiled
def run_plain(*args):
    """``sample`` of a gear without powers, by series."""
    return sample(plain_step, *args)


@compiled
def run_any(*args):
    """``sample`` of a gear with powers, by series."""
    return sample(any_step, *args)


@compiled
def run_rk4(*args):
    """``sample`` by the classical Runge-Kutta method."""
    return sample(slow_step, *args)


@compiled
def cross_plain(kernel, y, cycle, cycles, steps):
    """``over_cycles`` of a gear without powers, by series."""
    over_cycles(plain_step, kernel, y, cycle, cycles, steps)


@compiled
def cross_any(kernel, y, cycle, cycles, steps):
    """``over_cycles`` of a gear with powers, by series."""
    over_cycles(any_step, kernel, y, cycle, cycles, steps)


@compiled
def cross_rk4(kernel, y, cycle, cycles, steps):
    """``over_cycles`` by the classical Runge-Kutta method."""
    over_cycles(slow_step, kernel, y, cycle, cycles, steps)


class Kernel:
    """The compiled run of one orbit of a model; holds its scratch, nothing of the run."""

    def __init__(self, model: Model) -> None:
        layout, p = model.layout, model.parameters
        self.model = model
        self._scratch = make_work(layout.n_mesh, layout.n_coordinate, model.n_own)
        self._slow = p.method == "rk4"
        self._run, self._cross = (
            (run_rk4, cross_rk4)
            if self._slow
            else (run_plain, cross_plain)
            if not model.packed.powers
            else (run_any, cross_any)
        )
        self._kind = typeof(model.packed)
        self._orbits: dict[int, Orbit] = {}

    @property
    def compiled(self) -> bool:
        """Whether this process has compiled ``run`` for such a gear."""
        made = getattr(self._run, "signatures", None)
        return made is None or any(one[1] == self._kind for one in made)

    @property
    def code(self) -> tuple[Any, Any]:
        """The compiled function of ``run``, and the type of gear that it is compiled for."""
        return self._run, self._kind

    def _begin(self, y: Array, tangents: Array) -> tuple[Any, Array, Array]:
        """What the method takes, and the arrays of the state and of its tangents that it moves."""
        if self._slow:
            return (self.model.packed, self._scratch, self.model.parameters.steps), y, tangents
        k = len(tangents)
        if k not in self._orbits:
            self._orbits[k] = orbit_of(self.model, k)
        states = self._orbits[k].work.y
        states[0], states[1:] = y, tangents
        return self._orbits[k], states[0], states[1:]

    def run(
        self,
        y: Array,
        tangents: Array,
        growth: Array,
        place: NDArray[np.int64],
        t: float,
        rest: tuple[Any, ...],
    ) -> tuple[float, int, int]:
        """``sample`` from a state on; y, tangents, growth and place move on.

        Args:
            rest: of ``sample``, from ``head`` on.
        """
        p, model = self.model.parameters, self.model
        kernel, states, vectors = self._begin(y, tangents)
        moved = growth, place, t, model.scales.omega_n
        grid = p.steps, p.steps // p.samples_per_cycle
        found = self._run(
            kernel, model.packed, self._scratch, states, vectors, *moved, *grid, *rest
        )
        y[:], tangents[:] = states, vectors
        time, filled, switches = found
        return float(time), int(filled), int(switches)

    def cross(self, y: Array, tangents: Array, cycle: int, cycles: int) -> None:
        """Advance y (n_state,) and tangents (k, n_state) over so many mesh cycles."""
        kernel, states, vectors = self._begin(y, tangents)
        self._cross(kernel, states, cycle, cycles, self.model.parameters.steps)
        y[:], tangents[:] = states, vectors
