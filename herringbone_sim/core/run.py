"""Compiled integration of one orbit over the phase grid, with samples or without.

Over 300 lines: each compiled function stands beside the method that calls it.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numba import typeof
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.core.lanes.nonlinear_moves import move_nonlinear
from herringbone_sim.core.lanes.run import move_linear
from herringbone_sim.core.model import Model
from herringbone_sim.core.orbit import grid_step, orbit_of
from herringbone_sim.core.packed import (
    LIMIT,
    TWO_PI,
    Packed,
    Work,
    compiled,
    embedded,
    inlined,
    make_work,
    of_one_type,
)
from herringbone_sim.core.reference import Reference, call
from herringbone_sim.core.right_hand_side import hide_displacement, mesh_forces, rk4_step
from herringbone_sim.core.sensitivity import Directions


@compiled
def write_row(p, w, y, phase, cycle, head, si, carrier, row):
    """Write one sample: head, then x, v, F of the meshes, then u of the bodies, in SI units.

    Call ``mesh_forces`` before; x and v are written without the displacements by effects.

    Args:
        head: (5,) first values of the row, see ``layout.HEAD``; the phase is computed instead.
        si: (4,) SI units of x, v, F, and of x over cos beta.
        carrier: (n_coordinate,) row that gives u_c [m] from the coordinates.

    Returns:
        largest |x| in units of b_c, NaN if any x is.
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
    write_bodies(y, carrier, si[3], 5 + 3 * n, row)
    return largest


@inlined
def write_bodies(y, carrier, u_unit, first, row):
    """Write u [m] of the bodies into a row from index ``first`` on.

    ``u_unit`` is b_c over cos beta. All bodies contain the same u_c, so that left and right
    undergo the same operations.
    """
    u_c = 0.0
    for k in range(carrier.size):
        u_c += carrier[k] * y[k]
    for side in range(2):
        row[first + side] = y[side] * u_unit + 2.0 * u_c
    row[first + 2] = u_c
    for k in range(2, carrier.size):
        row[first + 1 + k] = y[k] * u_unit + u_c


@compiled
def orthonormalise(tangents, growth):
    """Orthonormalise tangents (k, n) in place by Gram-Schmidt; add the logarithms of the lengths
    to ``growth`` (k,).
    """
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
def sample(step, kernel, p, w, y, tangents, growth, grid_point, t, grid, out):
    """Fill rows with samples ``stride`` steps apart; returns (time, rows filled, switches).

    Stops after the first row that is out of range (``LIMIT``). y, tangents, growth and
    grid_point are advanced in place; tangents are orthonormalised at phase 0. The time is that of
    the next row.

    Args:
        step: the method; ``step(kernel, y, cycle, index)`` advances y by a step of the grid.
        grid_point: (2,) mesh cycle and step index.
        t: time [s] of the first row.
        grid: omega_n, steps per mesh cycle, ``stride``.
        out: head, si and carrier as for ``write_row``; rows; contact (n_mesh, 3), in which the
            samples in back contact, separated and in drive contact are counted.
    """
    omega_n, steps, stride = grid
    head, si, carrier, rows, contact = out
    dt = TWO_PI / (p.Omega * steps) / omega_n
    switches = 0
    for i in range(rows.shape[0]):
        phase = TWO_PI * grid_point[1] / steps
        head[0] = t
        mesh_forces(p, w, y, phase, grid_point[0])
        for m in range(contact.shape[0]):
            contact[m, 1 + (w.x[m] > p.b[m]) - (w.x[m] < -p.b[m])] += 1
        largest = write_row(p, w, y, phase, grid_point[0], head, si, carrier, rows[i])
        if not largest < LIMIT:
            return t, i + 1, switches
        for _ in range(stride):
            switches += step(kernel, y, grid_point[0], grid_point[1])
            t += dt
            grid_point[1] += 1
            if grid_point[1] == steps:
                grid_point[1] = 0
                grid_point[0] += 1
                orthonormalise(tangents, growth)
    return t, rows.shape[0], switches


@embedded
def over_cycles(step, kernel, y, cycle, cycles, steps):
    """Advance y, and the tangents in ``kernel``, over whole mesh cycles without samples.

    Tangents are not rescaled: the unit matrix becomes the transposed monodromy matrix. The steps,
    and therefore the state bit for bit, are those of ``sample``.
    """
    for c in range(cycle, cycle + cycles):
        for index in range(steps):
            step(kernel, y, c, index)


@inlined
def linear_step(orbit, y, cycle, index):
    """One grid step by Taylor series; forces linear between switches (not ``Packed.powers``)."""
    return grid_step(move_linear, orbit, cycle, index)


@inlined
def nonlinear_step(orbit, y, cycle, index):
    """One grid step by Taylor series; forces nonlinear between switches (``Packed.powers``)."""
    return grid_step(move_nonlinear, orbit, cycle, index)


@inlined
def rk4_grid_step(kernel, y, cycle, index):
    """One grid step by the classical Runge-Kutta method."""
    p, steps = kernel.gear, kernel.steps
    rk4_step(p, kernel.work, y, TWO_PI * index / steps, cycle, TWO_PI / (p.Omega * steps))
    return 0


# A function for each method: only those that are used are compiled.
@compiled
def run_linear(kernel, p, w, y, tangents, growth, grid_point, t, grid, out):
    """``sample`` by Taylor series; forces linear between switches (not ``Packed.powers``)."""
    return sample(linear_step, kernel, p, w, y, tangents, growth, grid_point, t, grid, out)


@compiled
def run_nonlinear(kernel, p, w, y, tangents, growth, grid_point, t, grid, out):
    """``sample`` by Taylor series; forces nonlinear between switches (``Packed.powers``)."""
    return sample(nonlinear_step, kernel, p, w, y, tangents, growth, grid_point, t, grid, out)


@compiled
def run_rk4(kernel, p, w, y, tangents, growth, grid_point, t, grid, out):
    """``sample`` by the classical Runge-Kutta method."""
    return sample(rk4_grid_step, kernel, p, w, y, tangents, growth, grid_point, t, grid, out)


@compiled
def cross_linear(kernel, y, cycle, cycles, steps):
    """``over_cycles`` by Taylor series; forces linear between switches (not ``Packed.powers``)."""
    over_cycles(linear_step, kernel, y, cycle, cycles, steps)


@compiled
def cross_nonlinear(kernel, y, cycle, cycles, steps):
    """``over_cycles`` by Taylor series; forces nonlinear between switches (``Packed.powers``)."""
    over_cycles(nonlinear_step, kernel, y, cycle, cycles, steps)


@compiled
def cross_rk4(kernel, y, cycle, cycles, steps):
    """``over_cycles`` by the classical Runge-Kutta method."""
    over_cycles(rk4_grid_step, kernel, y, cycle, cycles, steps)


@compiled
def read_rows(p, w, states, grid_points, steps, head, si, carrier, rows):
    """Write the samples of states (n, n_state) at ``grid_points`` (n, 2), mesh cycle and step
    index, into rows.
    """
    for i in range(states.shape[0]):
        phase = TWO_PI * grid_points[i, 1] / steps
        mesh_forces(p, w, states[i], phase, grid_points[i, 0])
        write_row(p, w, states[i], phase, grid_points[i, 0], head, si, carrier, rows[i])


@inlined
def keep_columns(neighbours, columns):
    """Copy ``neighbours.columns`` to ``columns`` (p, n_state); nothing without neighbours."""
    if neighbours is not None:
        for row in range(columns.shape[0]):
            for j in range(columns.shape[1]):
                columns[row, j] = neighbours.columns[row, j]


@embedded
def trace(step, orbit, grid_point, steps, stride, states, columns):
    """Advance an orbit and record state, tangents and columns at samples ``stride`` steps apart.

    Args:
        grid_point: (2,) mesh cycle and step index, advanced in place.
        states: (n, 1 + k, n_state) output: state, then k tangents.
        columns: (n, p, n_state) output; left as it is if ``orbit.neighbours`` is None.
    """
    y = orbit.work.y
    for i in range(states.shape[0]):
        for row in range(y.shape[0]):
            for j in range(y.shape[1]):
                states[i, row, j] = y[row, j]
        keep_columns(orbit.neighbours, columns[i])
        for _ in range(stride):
            step(orbit, y[0], grid_point[0], grid_point[1])
            grid_point[1] += 1
            if grid_point[1] == steps:
                grid_point[1] = 0
                grid_point[0] += 1


@compiled
def trace_linear(orbit, grid_point, steps, stride, states, columns):
    """``trace`` for a gear whose forces are linear between switches (not ``Packed.powers``)."""
    trace(linear_step, orbit, grid_point, steps, stride, states, columns)


@compiled
def trace_nonlinear(orbit, grid_point, steps, stride, states, columns):
    """``trace`` for a gear whose forces are nonlinear between switches (``Packed.powers``)."""
    trace(nonlinear_step, orbit, grid_point, steps, stride, states, columns)


class Rk4(NamedTuple):
    """Data of one orbit for the classical Runge-Kutta method."""

    gear: Packed
    work: Work
    steps: int  # of a mesh cycle


class StateArrays(NamedTuple):
    """Arrays of a ``State`` that ``Kernel.run`` advances in place.

    Attributes:
        y: (n_state,) state.
        tangents: (k, n_state) tangent vectors.
        columns: (p, n_state) derivatives with respect to parameters.
        growth: (k,) sums of the logarithms of the tangents' growth factors.
        grid_point: (2,) mesh cycle and step within it.
    """

    y: Array
    tangents: Array
    columns: Array
    growth: Array
    grid_point: NDArray[np.int64]


class Kernel:
    """Compiled integration of one orbit of a model; holds work arrays, but no state.

    Args:
        model: see ``model.build``.
        along: parameters to differentiate by, or None.
    """

    def __init__(self, model: Model, along: Directions | None = None) -> None:
        layout = model.layout
        self.model = model
        self._along = along
        self._scratch = Reference(
            make_work(layout.n_mesh, layout.n_coordinate, model.n_added_coordinates)
        )
        self._by_rk4, powers = model.parameters.method == "rk4", model.packed.powers
        self._gear = Reference(of_one_type(model.packed) if self._by_rk4 else model.packed)
        self._run = run_rk4 if self._by_rk4 else run_nonlinear if powers else run_linear
        self._cross = cross_rk4 if self._by_rk4 else cross_nonlinear if powers else cross_linear
        self._trace = trace_nonlinear if powers else trace_linear
        self._orbits: dict[int, Reference] = {}

    @cached_property
    def _rk4(self) -> Reference:
        """Data of ``rk4_grid_step``."""
        return Reference(Rk4(self._gear.fields, self._scratch.fields, self.model.parameters.steps))

    @cached_property
    def _to_read(self) -> Reference:
        """Constants of the gear for ``read_rows``."""
        return Reference(of_one_type(self.model.packed))

    @cached_property
    def _kind(self) -> Any:
        """Numba type of the packed model."""
        return typeof(self._gear)

    @property
    def is_compiled(self) -> bool:
        """Whether this process has compiled, or loaded, ``run`` for this type of gear."""
        signatures = getattr(self._run, "signatures", None)
        return signatures is None or any(signature[1] == self._kind for signature in signatures)

    @property
    def code(self) -> tuple[Any, Any]:
        """The compiled function of ``run``, and the type of gear that it is compiled for."""
        return self._run, self._kind

    def _begin(
        self, y: Array, tangents: Array, columns: Array | None = None
    ) -> tuple[Reference, Array, Array]:
        """Return the argument ``kernel`` of compiled functions, and the arrays of state and
        tangents that they advance, with the given values.
        """
        if self._by_rk4:
            return self._rk4, y, tangents
        k = len(tangents)
        if k not in self._orbits:
            others = self._along.models() if self._along else []
            self._orbits[k] = Reference(orbit_of(self.model, k, others))
        orbit = self._orbits[k]
        states = orbit.work.y
        states[0], states[1:] = y, tangents
        if self._along and columns is not None:
            neighbours = self._along.neighbours(orbit.work, y, columns)
            orbit = Reference(orbit.fields._replace(neighbours=neighbours))
        return orbit, states[0], states[1:]

    def run(self, arrays: StateArrays, t: float, out: tuple[Any, ...]) -> tuple[float, int, int]:
        """Fill rows with samples and advance ``arrays`` in place, see ``sample``.

        Args:
            arrays, t: state and time [s] of the first sample.
            out: as for ``sample``; its contact counts are incremented.

        Returns:
            time [s] of the next sample (of the last row if it is out of range), number of rows
            filled, number of located switches (0 with rk4).
        """
        p, model = self.model.parameters, self.model
        kernel, states, vectors = self._begin(arrays.y, arrays.tangents, arrays.columns)
        grid = model.scales.omega_n, p.steps, p.steps // p.samples_per_cycle
        gear = kernel, self._gear, self._scratch
        time, filled, switches = call(
            self._run, *gear, states, vectors, arrays.growth, arrays.grid_point, t, grid, out
        )
        arrays.y[:], arrays.tangents[:] = states, vectors
        if self._along:
            arrays.columns[:] = self._along.from_kernel(arrays.y, kernel.neighbours.columns)
        return float(time), int(filled), int(switches)

    def advance_cycles(self, y: Array, tangents: Array, cycle: int, cycles: int) -> None:
        """Advance y (n_state,) and tangents (k, n_state) over whole mesh cycles, in place."""
        kernel, states, vectors = self._begin(y, tangents)
        call(self._cross, kernel, states, cycle, cycles, self.model.parameters.steps)
        y[:], tangents[:] = states, vectors

    def trace(
        self, y: Array, tangents: Array, columns: Array, grid_point: NDArray[np.int64], n: int
    ) -> tuple[Array, Array, Array]:
        """Return states (n, n_state), tangents (n, k, n_state) and columns (n, p, n_state) at n
        samples, the first at the given state; ``grid_point`` is advanced in place.
        """
        p = self.model.parameters
        orbit, _, _ = self._begin(y, tangents, columns)
        states = np.empty((n, 1 + len(tangents), len(y)))
        sampled_columns = np.zeros((n, len(columns), len(y)))
        stride = p.steps // p.samples_per_cycle
        call(self._trace, orbit, grid_point, p.steps, stride, states, sampled_columns)
        if self._along:
            sampled_columns = self._along.from_kernel(states[:, 0], sampled_columns)
        return states[:, 0], states[:, 1:], sampled_columns

    def read(
        self, states: Array, grid_points: NDArray[np.int64], rest: tuple[Array, Array, Array]
    ) -> Array:
        """Return the samples (n, n_channels) of given states, in SI units.

        The time is not computed: every row has that of ``head``.

        Args:
            states: (n, n_state), dimensionless.
            grid_points: (n, 2) mesh cycle and step of the phase grid at each state.
            rest: head, si and carrier, as for ``write_row``.
        """
        rows = np.empty((len(states), len(self.model.layout.channels)))
        states = np.ascontiguousarray(states, dtype=float)
        grid_points = np.ascontiguousarray(grid_points, dtype=np.int64)
        gear = self._to_read, self._scratch
        call(read_rows, *gear, states, grid_points, self.model.parameters.steps, *rest, rows)
        return rows
