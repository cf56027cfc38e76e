"""The compiled run: step by step over a grid of the mesh phase, a row of samples at a time."""

from __future__ import annotations

from functools import cached_property
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
from herringbone_sim.core.sensitivity import Directions

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


@embedded
def sample(step, kernel, p, w, y, tangents, growth, place, t, grid, out):
    """Fill rows with samples ``stride`` steps apart; returns (time, rows filled, switches).

    The run stops after the row that is out of range.

    Args:
        step: the method, ``step(kernel, y, cycle, index)`` advances y by a step of the grid.
        place: (cycle, index), moves on.
        grid: omega_n, steps a mesh cycle, ``stride``.
        out: head, units and row of the carrier, as of ``write_row``; rows; contact (n_mesh, 3).
    """
    omega_n, steps, stride = grid
    head, si, carrier, rows, contact = out
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
def run_plain(kernel, p, w, y, tangents, growth, place, t, grid, out):
    """``sample`` of a gear without powers, by series."""
    return sample(plain_step, kernel, p, w, y, tangents, growth, place, t, grid, out)


@compiled
def run_any(kernel, p, w, y, tangents, growth, place, t, grid, out):
    """``sample`` of a gear with powers, by series."""
    return sample(any_step, kernel, p, w, y, tangents, growth, place, t, grid, out)


@compiled
def run_rk4(kernel, p, w, y, tangents, growth, place, t, grid, out):
    """``sample`` by the classical Runge-Kutta method."""
    return sample(slow_step, kernel, p, w, y, tangents, growth, place, t, grid, out)


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


@compiled
def read_rows(p, w, states, places, steps, head, si, carrier, rows):
    """Samples of given states (n, n_state) at places (n, 2), (cycle, index) each, into rows."""
    for i in range(states.shape[0]):
        phase = TWO_PI * places[i, 1] / steps
        mesh_forces(p, w, states[i], phase, places[i, 0])
        write_row(p, w, states[i], phase, places[i, 0], head, si, carrier, rows[i])


@inlined
def keep_columns(near, columns):
    """Columns as they are into an array (p, n_state), where any run along."""
    if near is not None:
        for row in range(columns.shape[0]):
            for j in range(columns.shape[1]):
                columns[row, j] = near.columns[row, j]


@embedded
def trace(step, orbit, place, steps, stride, states, columns):
    """State, tangents and columns at samples ``stride`` steps apart, as they are, into rows.

    Args:
        place: (cycle, index), moves on.
        states: (n, 1 + k, n_state).
        columns: (n, p, n_state).
    """
    y = orbit.work.y
    for i in range(states.shape[0]):
        for row in range(y.shape[0]):
            for j in range(y.shape[1]):
                states[i, row, j] = y[row, j]
        keep_columns(orbit.near, columns[i])
        for _ in range(stride):
            step(orbit, y[0], place[0], place[1])
            place[1] += 1
            if place[1] == steps:
                place[1] = 0
                place[0] += 1


@compiled
def trace_plain(orbit, place, steps, stride, states, columns):
    """``trace`` of a gear without powers."""
    trace(plain_step, orbit, place, steps, stride, states, columns)


@compiled
def trace_any(orbit, place, steps, stride, states, columns):
    """``trace`` of a gear with powers."""
    trace(any_step, orbit, place, steps, stride, states, columns)


class Kernel:
    """The compiled run of one orbit of a model; holds its scratch, nothing of the run.

    Args:
        model: see ``model.build``.
        along: parameters whose columns run along, or None.
    """

    def __init__(self, model: Model, along: Directions | None = None) -> None:
        layout = model.layout
        self.model = model
        self._along = along
        self._scratch = make_work(layout.n_mesh, layout.n_coordinate, model.n_own)
        self._slow, powers = model.parameters.method == "rk4", model.packed.powers
        self._run = run_rk4 if self._slow else run_any if powers else run_plain
        self._cross = cross_rk4 if self._slow else cross_any if powers else cross_plain
        self._trace = trace_any if powers else trace_plain
        self._orbits: dict[int, Orbit] = {}

    @cached_property
    def _kind(self) -> Any:
        return typeof(self.model.packed)

    @property
    def compiled(self) -> bool:
        """Whether this process has compiled ``run`` for such a gear."""
        made = getattr(self._run, "signatures", None)
        return made is None or any(one[1] == self._kind for one in made)

    @property
    def code(self) -> tuple[Any, Any]:
        """The compiled function of ``run``, and the type of gear that it is compiled for."""
        return self._run, self._kind

    def _begin(
        self, y: Array, tangents: Array, columns: Array | None = None
    ) -> tuple[Any, Array, Array]:
        """What the method takes, and the arrays of the state and of its tangents that it moves."""
        if self._slow:
            return (self.model.packed, self._scratch, self.model.parameters.steps), y, tangents
        k = len(tangents)
        if k not in self._orbits:
            others = self._along.models() if self._along else []
            self._orbits[k] = orbit_of(self.model, k, others)
        orbit = self._orbits[k]
        states = orbit.work.y
        states[0], states[1:] = y, tangents
        if self._along and columns is not None:
            orbit = orbit._replace(near=self._along.near(orbit.work, y, columns))
        return orbit, states[0], states[1:]

    def run(
        self,
        y: Array,
        tangents: Array,
        columns: Array,
        growth: Array,
        place: NDArray[np.int64],
        t: float,
        out: tuple[Any, ...],
    ) -> tuple[float, int, int]:
        """``sample`` from a state on; y, tangents, columns, growth and place move on."""
        p, model = self.model.parameters, self.model
        kernel, states, vectors = self._begin(y, tangents, columns)
        grid = model.scales.omega_n, p.steps, p.steps // p.samples_per_cycle
        gear = kernel, model.packed, self._scratch
        time, filled, switches = self._run(*gear, states, vectors, growth, place, t, grid, out)
        y[:], tangents[:] = states, vectors
        if self._along:
            columns[:] = self._along.told(y, kernel.near.columns)
        return float(time), int(filled), int(switches)

    def cross(self, y: Array, tangents: Array, cycle: int, cycles: int) -> None:
        """Advance y (n_state,) and tangents (k, n_state) over so many mesh cycles."""
        kernel, states, vectors = self._begin(y, tangents)
        self._cross(kernel, states, cycle, cycles, self.model.parameters.steps)
        y[:], tangents[:] = states, vectors

    def trace(
        self, y: Array, tangents: Array, columns: Array, place: NDArray[np.int64], n: int
    ) -> tuple[Array, Array, Array]:
        """States (n, n_state), tangents (n, k, n_state) and columns (n, p, n_state) at samples."""
        p = self.model.parameters
        orbit, _, _ = self._begin(y, tangents, columns)
        states = np.empty((n, 1 + len(tangents), len(y)))
        found = np.zeros((n, len(columns), len(y)))
        self._trace(orbit, place, p.steps, p.steps // p.samples_per_cycle, states, found)
        if self._along:
            found = self._along.told(states[:, 0], found)
        return states[:, 0], states[:, 1:], found

    def read(
        self, states: Array, places: NDArray[np.int64], rest: tuple[Array, Array, Array]
    ) -> Array:
        """Samples (n, n_channels) of states (n, n_state) at places (n, 2), cycle and index.

        Args:
            rest: head, units and row of the carrier, as of ``sample``.
        """
        rows = np.empty((len(states), len(self.model.layout.channels)))
        states = np.ascontiguousarray(states)
        gear = self.model.packed, self._scratch
        read_rows(*gear, states, places, self.model.parameters.steps, *rest, rows)
        return rows
