"""Integrate a gear in blocks of samples: from a state to samples in SI units and a new state.

The same stepper serves real time, sweeps, tangent flow and replay. Steps lie on a fixed grid of
the mesh phase, so the samples are bitwise independent of the division into blocks.

Over 300 lines: the stepper and the functions on it are one interface.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.model import (
    Model,
    body_displacements,
    carry_over,
    initial_state,
    with_added_states,
)
from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.core.run import Kernel, StateArrays
from herringbone_sim.core.sensitivity import Direction, Directions, need_series, need_tangents
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import DivergenceError, ParameterError

BATCHES = 10  # of mesh cycles, from whose spread the standard error of an exponent follows


@dataclass(frozen=True)
class State:
    """State of a simulation: all that its continuation by a stepper depends on.

    Attributes:
        y: (n_state,) displacements then velocities, dimensionless, see ``Model.n_state``.
        cycle: whole mesh cycles since the start.
        index: step within the cycle, on the grid of ``Parameters.steps``.
        t: simulation time [s].
        tangents: (k, n_state) tangent vectors, orthonormal at phase 0; k may be 0.
        growth: (k,) sums of the logarithms of their growth factors.
        columns: (p, n_state) derivatives of y with respect to the stepper's ``directions``.
    """

    y: Array
    cycle: int
    index: int
    t: float
    tangents: Array
    growth: Array
    columns: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def phase(self, steps: int) -> float:
        """Return the mesh phase [rad] within the cycle, for ``steps`` steps per cycle."""
        return TWO_PI * self.index / steps


@dataclass(frozen=True)
class Block:
    """Consecutive samples, with the states at both ends.

    Attributes:
        rows: (n, n_channels) as ``Layout.channels``, SI units.
        start: state at the first sample.
        end: state one sample period after the last sample.
        section: indices of the rows at phase 0.
        contact: (n_mesh, 3) number of samples in back contact, separated, in drive contact; for a
            gear by the laws of its effects the time there, in sample periods.
        switches: number of located switches: of contact, and of what effects switch; 0 with rk4.
        diverged: whether the state left the range of any physical motion; ``rows`` then end with
            the first sample out of range.
    """

    rows: Array
    start: State
    end: State
    section: Indices
    contact: NDArray[Any]
    switches: int
    diverged: bool


class Stepper:
    """Integrator of one model, from ``State`` to ``State``; holds work arrays, but no state.

    Base class and common interface of all steppers; this one uses the kernel of the core. Use
    ``stepper`` to get the stepper that a model needs.

    Args:
        model: see ``model.build``.
        directions: parameters to differentiate by, see ``sensitivity``.

    Raises:
        ParameterError: a gear by its effects' own laws, which this kernel can't represent, or a
            derivative that can't be computed, see ``sensitivity.Directions``.
    """

    def __init__(self, model: Model, directions: Sequence[Direction] = ()) -> None:
        if model.integrator is not None:
            raise ParameterError(
                "the kernel holds no gear by its effects' own laws: make its stepper by "
                "core.integrate.stepper(model)"
            )
        s = model.scales
        self.model = model
        self._directions = Directions(model, directions) if directions else None
        self._kernel = Kernel(model, self._directions)
        force = s.b_c * s.omega_n**2 / s.projection
        self._si = np.array([s.b_c, s.velocity_m_per_s, force, s.b_c / s.cos_beta])
        self._carrier = carrier_row(model) * s.b_c

    @property
    def is_compiled(self) -> bool:
        """Whether this process has compiled, or loaded, the kernel for this type of gear."""
        return self._kernel.is_compiled

    def alike(self, other: object) -> bool:
        """Whether another stepper uses the same compiled kernel."""
        return isinstance(other, Stepper) and bool(other._code == self._code)

    @property
    def _code(self) -> Any:
        return self._kernel.code

    def start(self, tangents: int = 0) -> State:
        """Return the initial state with ``tangents`` random orthonormal tangent vectors.

        States that effects add are at rest.
        """
        n = self.model.n_state
        frame = np.linalg.qr(np.random.default_rng(0).normal(size=(n, n)))[0][:tangents]
        y = with_added_states(self.model, initial_state(self.model))
        columns = np.zeros((len(self._directions.step) if self._directions else 0, n))
        return State(y, 0, 0, 0.0, frame.copy(), np.zeros(tangents), columns)

    def _head(self) -> Array:
        p = self.model.parameters
        return np.array([0.0, 0.0, p.K, p.delta_T, p.T_1])

    def advance(self, state: State, n_samples: int) -> Block:
        """Return the next samples as a block, the first sample at the state itself.

        The same state and model give bitwise the same samples, in blocks of any size.
        """
        p = self.model.parameters
        rows = np.empty((n_samples, len(self.model.layout.channels)))
        arrays = StateArrays(
            y=np.array(state.y, dtype=float),
            tangents=np.array(state.tangents, dtype=float, order="C"),
            columns=np.array(state.columns, dtype=float),
            growth=np.array(state.growth, dtype=float),
            grid_point=np.array([state.cycle, state.index], dtype=np.int64),
        )
        t, filled, switches, contact = self._sample(arrays, float(state.t), rows)
        y, tangents, columns, growth, grid_point = arrays
        stride = p.steps // p.samples_per_cycle
        end = State(y, int(grid_point[0]), int(grid_point[1]), float(t), tangents, growth, columns)
        moved = (end.cycle - state.cycle) * p.steps + end.index - state.index
        at = (state.index // stride + np.arange(filled)) % p.samples_per_cycle
        return Block(
            rows=rows[:filled],
            start=state,
            end=end,
            section=np.flatnonzero(at == 0),
            contact=contact,
            switches=int(switches),
            diverged=moved < n_samples * stride or not bool(np.all(np.isfinite(y))),
        )

    def _sample(
        self, arrays: StateArrays, t: float, rows: Array
    ) -> tuple[float, int, int, NDArray[Any]]:
        """Fill rows with samples and advance ``arrays`` in place.

        Returns the time of the next sample [s], rows filled, switches and ``Block.contact``.
        """
        contact = np.zeros((self.model.layout.n_mesh, 3), dtype=np.int64)
        rest = self._head(), self._si, self._carrier, rows, contact
        return (*self._kernel.run(arrays, t, rest), contact)

    def trace(self, state: State, n_samples: int) -> tuple[Array, Array, Array, Indices]:
        """Return states, tangents and columns at the next samples, the first at ``state`` itself.

        Returns:
            states (n, n_state), tangents (n, k, n_state) not orthonormalised, columns (n, p,
            n_state), and mesh cycle and step index (n, 2) of each sample, for ``read``.

        Raises:
            ParameterError: ``method: rk4``, or effects by their own laws.
        """
        need_series(self.model, "traces of derivatives")
        p = self.model.parameters
        grid_point = np.array([state.cycle, state.index], dtype=np.int64)
        columns = state.columns
        if self._directions and not len(columns):
            columns = np.zeros((len(self._directions.step), len(state.y)))
        found = self._kernel.trace(state.y, state.tangents, columns, grid_point, n_samples)
        passed = state.index + p.steps // p.samples_per_cycle * np.arange(n_samples)
        return *found, np.stack([state.cycle + passed // p.steps, passed % p.steps], axis=1)

    def read(self, states: Array, grid_points: Indices) -> Array:
        """Return the samples (n, n_channels), as ``Block.rows``, that given states show.

        The time is counted from mesh cycle 0.

        Args:
            states: (n, n_state), dimensionless.
            grid_points: (n, 2) mesh cycle and step index of each state, as from ``trace``.
        """
        model = self.model
        if model.integrator is not None:
            need_series(model, "samples of states")
        rows = self._kernel.read(states, grid_points, (self._head(), self._si, self._carrier))
        rows[:, 0] = rows[:, 1] / (model.packed.Omega * model.scales.omega_n)
        return rows

    def advance_cycles(
        self, y: Array, tangents: Array, cycle: int, cycles: int
    ) -> tuple[Array, Array]:
        """Return state (n,) and tangents (k, n) after whole mesh cycles, from phase 0 to phase 0.

        Tangents are neither scaled nor orthogonalised. Nothing is raised if the motion diverges:
        the state is then huge or not finite.

        Args:
            cycle: mesh cycles before y, which set the phase of the control and of effects.
            cycles: mesh cycles to integrate.
        """
        y, tangents = np.array(y, dtype=float), np.array(tangents, dtype=float, order="C")
        self._kernel.advance_cycles(y, tangents, cycle, cycles)
        return y, tangents

    def added_states(self, y: Array) -> dict[Hashable, Array]:
        """Return the states that effects add to ``y``, in SI, keyed as ``Model.added_sizes``.

        Args:
            y: (n_state,) dimensionless state vector.

        Returns:
            dict of (k,) arrays: displacement [m], velocity [m/s], alternating for each coordinate.
        """
        return {key: y[at] * unit for key, at, unit in self._added_indices()}

    def with_added_values(self, y: Array, added: Mapping[Hashable, Array]) -> Array:
        """Return a copy of y in which the states that effects add have the values in ``added``.

        Args:
            y: (n_state,) dimensionless state vector.
            added: as from the method ``added_states``, perhaps of another model; entries whose key
                or size this model does not have are ignored.
        """
        y = y.copy()
        for key, at, unit in self._added_indices():
            if key in added and added[key].shape == at.shape:
                y[at] = added[key] / unit
        return y

    def _added_indices(self) -> Iterator[tuple[Hashable, Indices, Array]]:
        """Yield key, indices in y, and SI units of the states that each effect adds."""
        model, s = self.model, self.model.scales
        order = model.layout.n_state + self._added_order()
        unit = np.resize([s.b_c, s.velocity_m_per_s], order.size)
        first = 0
        for key, size in model.added_sizes:
            yield key, order[first : first + size], unit[first : first + size]
            first += size

    def _added_order(self) -> Indices:
        """Return indices that put displacement and rate of each added coordinate side by side.

        They count from the first added state. Here the state holds all displacements of added
        coordinates, then all rates; a stepper with another order overrides this.
        """
        order: Indices = np.arange(2 * self.model.n_added_coordinates).reshape(2, -1).T.ravel()
        return order


def stepper(model: Model) -> Stepper:
    """Return the stepper of a model: ``Stepper``, or what ``Model.integrator`` makes."""
    made: Stepper = (model.integrator or Stepper)(model)
    return made


def carrier_row(model: Model) -> Array:
    """Return the row (n_coordinate,) that gives the displacement u_c of the carrier.

    u_c is the row times the first n_coordinate entries of y, both in units of b_c; the rigid
    rotation is removed as in ``body_displacements``.
    """
    m = model.layout.n_coordinate
    unit = np.eye(2 * m)[:m]
    return np.array([body_displacements(model, row)[2] for row in unit])


def change(old: Model, new: Model, state: State) -> State:
    """Return the state that continues a run after a change of live parameters, at the same phase.

    Relative displacements and velocities are continuous, see ``carry_over``. The step index is
    converted to the new grid; ``samples_per_cycle`` may change only at phase 0.
    """
    steps_old, steps_new = old.parameters.steps, new.parameters.steps
    y = carry_over(old, new, state.y, state.phase(steps_old))
    return replace(state, y=y, index=state.index * steps_new // steps_old)


def simulate(model: Model, cycles: int, state: State | None = None) -> tuple[TimeSeries, State]:
    """Return the samples of whole mesh cycles as a time series, and the state after them.

    Args:
        state: start state; None: the initial state.

    Raises:
        DivergenceError: the state left the range of any physical motion.
    """
    gear_stepper = stepper(model)
    block = gear_stepper.advance(
        state or gear_stepper.start(), cycles * model.parameters.samples_per_cycle
    )
    if block.diverged:
        causes = [*(active.effect.id for active in model.effects), str(model.parameters)]
        raise DivergenceError(
            f"the motion diverged at t = {block.rows[-1, 0]:.6g} s with {' and '.join(causes)}"
        )
    return TimeSeries(block.rows[:, 0].copy(), block.rows, model.layout.channels), block.end


def batch_edges(cycles: int) -> Indices:
    """Return the observed cycles at which batches begin and end, as in the lanes.

    Args:
        cycles: mesh cycles observed, at least 1.

    Returns:
        (batches + 1,) from 0 to ``cycles``; 10 batches, or of a cycle each if there are fewer.
    """
    n = min(BATCHES, cycles)
    edges: Indices = -(-np.arange(n + 1) * cycles // n)
    return edges


def largest_exponent(
    model: Model, cycles: int = 500, transient: int = 200, state: State | None = None
) -> tuple[float, float]:
    """Return the largest Lyapunov exponent per tau, from a tangent vector, and its standard error.

    Args:
        model: see ``build``.
        cycles: mesh cycles averaged over, at least 2, in 10 batches (of a cycle each if fewer).
        transient: mesh cycles integrated before and not evaluated.
        state: start state; None: the initial state.

    Raises:
        ParameterError: fewer than 2 cycles, of which there is no standard error, a negative
            transient, or ``method: rk4``, which has no tangents.
        DivergenceError: the state left the range of any physical motion.
    """
    if cycles < 2 or transient < 0:
        raise ParameterError(
            "an exponent and its standard error need at least 2 mesh cycles after a transient of "
            f"0 or more, got {cycles} after {transient}: take more"
        )
    need_tangents(model, "exponents")
    gear_stepper = stepper(model)
    n = model.parameters.samples_per_cycle
    now = gear_stepper.start(tangents=1)
    if state is not None:
        now = replace(state, tangents=now.tangents, growth=now.growth)
    growth = []
    lengths = np.diff(batch_edges(cycles))
    for length in (transient, *lengths):
        block = gear_stepper.advance(now, int(length) * n)
        if block.diverged:
            raise DivergenceError(f"the motion diverged at t = {block.rows[-1, 0]:.6g} s")
        growth.append(float(block.end.growth[0] - now.growth[0]))
        now = block.end
    rates = np.array(growth[1:]) / (lengths * TWO_PI / model.packed.Omega)
    error = rates.std(ddof=1) / np.sqrt(len(rates))
    return float(np.average(rates, weights=lengths)), float(error)


def warm_up(model: Model) -> Any:
    """Compile what ``Stepper.advance`` needs, or load it from the cache; returns one sample."""
    gear_stepper = stepper(model)
    return gear_stepper.advance(gear_stepper.start(tangents=1), 1)
