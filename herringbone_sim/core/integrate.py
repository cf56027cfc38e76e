"""Integration in blocks of samples: state goes in and comes out, samples in SI units beside it.

The same stepper serves real time, sweeps, tangent flow and replay. Steps lie on a fixed grid of
the mesh phase, so a run does not depend on how it was cut into blocks: same input, same output,
bit for bit.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model, body_displacements, carry_over, initial_state
from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.core.run import Kernel
from herringbone_sim.core.sensitivity import Direction, Directions, need_series
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import DivergenceError, ParameterError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class State:
    """Where a run stands: all that the future depends on.

    Attributes:
        y: (n_state,) displacements then velocities, dimensionless.
        cycle: whole mesh cycles since the start.
        index: steps into the cycle, on the grid of ``Parameters.steps``.
        t: simulation time [s].
        tangents: (k, n_state) orthonormal tangent vectors that run along, or none.
        growth: (k,) sums of the logarithms of their growth.
        columns: (p, n_state) derivatives by the parameters that the stepper was given.
    """

    y: Array
    cycle: int
    index: int
    t: float
    tangents: Array
    growth: Array
    columns: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def phase(self, steps: int) -> float:
        """Mesh phase [rad] within the cycle."""
        return TWO_PI * self.index / steps


@dataclass(frozen=True)
class Block:
    """Consecutive samples.

    Attributes:
        rows: (n, n_channels) as ``Layout.channels``, SI units.
        start: state at the first sample.
        end: state at the sample after the last one.
        section: indices of the rows at phase 0.
        contact: (n_mesh, 3) samples in back contact, separated, in drive contact; of a gear by
            the laws of its effects the time there, in sample periods.
        switches: contact switches located.
        diverged: whether the last row left the range of any physical motion; ``end`` is there.
    """

    rows: Array
    start: State
    end: State
    section: NDArray[np.int64]
    contact: NDArray[Any]
    switches: int
    diverged: bool


class Stepper:
    """Advances states of one model; holds the scratch, nothing of the run.

    What a gear is run by: everything takes this class. This one runs the kernel of the core, and
    is the base of those that run a gear by another method; ``stepper`` makes the right one.

    Args:
        model: see ``model.build``.
        directions: parameters whose columns run along, see ``sensitivity``.

    Raises:
        ParameterError: a gear by its effects' own laws, which this would leave out.
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
    def compiled(self) -> bool:
        """Whether this process has the kernel of such a gear ready."""
        return self._kernel.compiled

    def alike(self, other: object) -> bool:
        """Whether another stepper runs on the same kernel."""
        return isinstance(other, Stepper) and bool(other._code == self._code)

    @property
    def _code(self) -> Any:
        return self._kernel.code

    def start(self, tangents: int = 0) -> State:
        """Initial state, with so many tangent vectors; own states of effects at rest."""
        n, m = self.model.n_state, self.model.layout.n_state
        frame = np.linalg.qr(np.random.default_rng(0).normal(size=(n, n)))[0][:tangents]
        y = np.concatenate([initial_state(self.model), np.zeros(n - m)])
        columns = np.zeros((len(self._directions.step) if self._directions else 0, n))
        return State(y, 0, 0, 0.0, frame.copy(), np.zeros(tangents), columns)

    def _head(self) -> Array:
        p = self.model.parameters
        return np.array([0.0, 0.0, p.K, p.delta_T, p.T_1])

    def advance(self, state: State, n_samples: int) -> Block:
        """The next samples from a state on, the first one at the state itself.

        Same state, same model: same samples to the bit, in blocks of whatever size.
        """
        p = self.model.parameters
        rows = np.empty((n_samples, len(self.model.layout.channels)))
        place = np.array([state.cycle, state.index], dtype=np.int64)
        y, tangents, growth = state.y.copy(), state.tangents.copy(), state.growth.copy()
        columns = state.columns.copy()
        t, filled, switches, contact = self._sample(
            y, tangents, columns, growth, place, state.t, rows
        )
        stride = p.steps // p.samples_per_cycle
        end = State(y, int(place[0]), int(place[1]), float(t), tangents, growth, columns)
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
        self,
        y: Array,
        tangents: Array,
        columns: Array,
        growth: Array,
        place: Indices,
        t: float,
        rows: Array,
    ) -> tuple[float, int, int, NDArray[Any]]:
        """Fill rows and move all else in place; time, rows filled, switches and contact."""
        contact = np.zeros((self.model.layout.n_mesh, 3), dtype=np.int64)
        rest = self._head(), self._si, self._carrier, rows, contact
        return (*self._kernel.run(y, tangents, columns, growth, place, t, rest), contact)

    def trace(self, state: State, n_samples: int) -> tuple[Array, Array, Array, Indices]:
        """States, tangents and columns at the next samples, the first one at the state itself.

        Returns:
            (n, n_state), (n, k, n_state) tangents as they have grown, (n, p, n_state), and the
            place (n, 2) of each sample, its mesh cycle and step, for ``read``.

        Raises:
            ParameterError: ``method: rk4``, or effects by their own laws.
        """
        need_series(self.model, "traces of derivatives")
        p = self.model.parameters
        place = np.array([state.cycle, state.index], dtype=np.int64)
        columns = state.columns
        if self._directions and not len(columns):
            columns = np.zeros((len(self._directions.step), len(state.y)))
        found = self._kernel.trace(state.y, state.tangents, columns, place, n_samples)
        passed = state.index + p.steps // p.samples_per_cycle * np.arange(n_samples)
        return *found, np.stack([state.cycle + passed // p.steps, passed % p.steps], axis=1)

    def read(self, states: Array, places: Indices) -> Array:
        """Samples (n, n_channels) of states (n, n_state) at places (n, 2), as in ``Block``.

        The time is counted from mesh cycle 0.
        """
        model = self.model
        rows = self._kernel.read(states, places, (self._head(), self._si, self._carrier))
        rows[:, 0] = rows[:, 1] / (model.packed.Omega * model.scales.omega_n)
        return rows

    def cross(self, y: Array, tangents: Array, cycle: int, cycles: int) -> tuple[Array, Array]:
        """State (n,) and tangents (k, n) after whole mesh cycles, from phase 0 to phase 0.

        Tangents are neither scaled nor turned. A motion that leaves all range ends in numbers
        that do.
        """
        y, tangents = np.array(y, dtype=float), np.array(tangents, dtype=float)
        self._kernel.cross(y, tangents, cycle, cycles)
        return y, tangents

    def own(self, y: Array) -> dict[Hashable, Array]:
        """States that effects add to ``y``, in SI units, keyed as in ``Model.own``.

        Args:
            y: (n_state,) dimensionless state vector.

        Returns:
            dict of (k,) arrays: displacement [m], velocity [m/s], alternating for each coordinate.
        """
        return {key: y[at] * unit for key, at, unit in self._places()}

    def with_own(self, y: Array, own: Mapping[Hashable, Array]) -> Array:
        """A state (n,) with other own states in it, where it has any of that key and size."""
        y = y.copy()
        for key, at, unit in self._places():
            if key in own and own[key].shape == at.shape:
                y[at] = own[key] / unit
        return y

    def _places(self) -> Iterator[tuple[Hashable, Indices, Array]]:
        """Keys of the own states, their indices in a state and units."""
        model, s = self.model, self.model.scales
        order = model.layout.n_state + self._own_order()
        unit = np.resize([s.b_c, s.velocity_m_per_s], order.size)
        first = 0
        for key, size in model.own:
            yield key, order[first : first + size], unit[first : first + size]
            first += size

    def _own_order(self) -> Indices:
        """Order of the further states in which displacement and rate of a coordinate meet."""
        order: Indices = np.arange(2 * self.model.n_own).reshape(2, -1).T.ravel()
        return order


def stepper(model: Model) -> Stepper:
    """The stepper of a gear: that of the core, or what its effects ask for."""
    made: Stepper = (model.integrator or Stepper)(model)
    return made


def carrier_row(model: Model) -> Array:
    """Row (n_coordinate,) that gives the carrier's displacement from the coordinates."""
    m = model.layout.n_coordinate
    unit = np.eye(2 * m)[:m]
    return np.array([body_displacements(model, row)[2] for row in unit])


def change(old: Model, new: Model, state: State) -> State:
    """State with which a run goes on after a change of live parameters, at the same phase.

    The grid may change only at phase 0 (``samples_per_cycle``); the index is kept otherwise.
    """
    steps_old, steps_new = old.parameters.steps, new.parameters.steps
    y = carry_over(old, new, state.y, state.phase(steps_old))
    return replace(state, y=y, index=state.index * steps_new // steps_old)


def simulate(model: Model, cycles: int, state: State | None = None) -> tuple[TimeSeries, State]:
    """Samples of whole mesh cycles, as a time series, and the state after them.

    Raises:
        DivergenceError: the motion left the range of any gear.
    """
    machine = stepper(model)
    block = machine.advance(state or machine.start(), cycles * model.parameters.samples_per_cycle)
    if block.diverged:
        raise DivergenceError(
            f"the motion diverged at t = {block.rows[-1, 0]:.6g} s with {model.parameters}"
        )
    return TimeSeries(block.rows[:, 0].copy(), block.rows, model.layout.channels), block.end


def largest_exponent(
    model: Model, cycles: int = 500, transient: int = 200, state: State | None = None
) -> tuple[float, float]:
    """Largest Lyapunov exponent per dimensionless time, by the tangent flow, and its error.

    Args:
        cycles: mesh cycles averaged over, in 10 batches; the error is that of their mean.
        transient: mesh cycles left out before.

    Raises:
        DivergenceError: the motion left the range of any gear.
    """
    machine = stepper(model)
    n = model.parameters.samples_per_cycle
    now = machine.start(tangents=1)
    if state is not None:
        now = replace(state, tangents=now.tangents, growth=now.growth)
    growth = []
    for length in [transient] + [max(cycles // 10, 1)] * 10:
        block = machine.advance(now, length * n)
        if block.diverged:
            raise DivergenceError(f"the motion diverged at t = {block.rows[-1, 0]:.6g} s")
        growth.append(float(block.end.growth[0] - now.growth[0]))
        now = block.end
    tau = max(cycles // 10, 1) * TWO_PI / model.packed.Omega
    batches = np.array(growth[1:]) / tau
    return float(batches.mean()), float(batches.std(ddof=1) / np.sqrt(len(batches)))


def warm_up(model: Model) -> Any:
    """Compile (or load from the cache) all that ``Stepper.advance`` needs; returns the block."""
    machine = stepper(model)
    return machine.advance(machine.start(tangents=1), 1)
