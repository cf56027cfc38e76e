"""Integration in blocks of samples: state goes in and comes out, samples in SI units beside it.

The same stepper serves real time, sweeps, tangent flow and replay. Steps lie on a fixed grid of
the mesh phase, so a run does not depend on how it was cut into blocks: same input, same output,
bit for bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model, body_displacements, carry_over, initial_state
from herringbone_sim.core.packed import TWO_PI, make_work
from herringbone_sim.core.run import read_rows, runner
from herringbone_sim.core.sensitivity import Direction, Directions
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.core.trace import tracer
from herringbone_sim.errors import DivergenceError

Array = NDArray[np.float64]


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
        contact: (n_mesh, 3) samples in back contact, separated, in drive contact.
        switches: contact switches located.
        diverged: whether the last row left the range of any physical motion; ``end`` is there.
    """

    rows: Array
    start: State
    end: State
    section: NDArray[np.int64]
    contact: NDArray[np.int64]
    switches: int
    diverged: bool


class Stepper:
    """Advances states of one model; holds the scratch, nothing of the run.

    Args:
        model: see ``model.build``.
        directions: parameters whose columns run along, see ``sensitivity``.
    """

    def __init__(self, model: Model, directions: Sequence[Direction] = ()) -> None:
        layout, s = model.layout, model.scales
        self.model = model
        self._work = make_work(
            layout.n_mesh, layout.n_coordinate, model.parameters.order, model.n_own
        )
        self._directions = Directions(model, directions) if directions else None
        self._run = runner(model.parameters.method, model.packed.plain)
        force = s.b_c * s.omega_n**2 / s.projection
        self._si = np.array([s.b_c, s.velocity_m_per_s, force, s.b_c / s.cos_beta])
        self._carrier = carrier_row(model) * s.b_c

    @property
    def compiled(self) -> bool:
        """Whether this process has the kernel of such a gear ready."""
        return bool(getattr(self._run, "signatures", True))

    def alike(self, other: object) -> bool:
        """Whether another stepper runs on the same kernel."""
        return isinstance(other, Stepper) and other._run is self._run

    def start(self, tangents: int = 0) -> State:
        """Initial state, with so many tangent vectors."""
        n = self.model.n_state
        frame = np.linalg.qr(np.random.default_rng(0).normal(size=(n, n)))[0][:tangents]
        y = np.concatenate([initial_state(self.model), np.zeros(2 * self.model.n_own)])
        columns = np.zeros((len(self._directions.step) if self._directions else 0, n))
        return State(y, 0, 0, 0.0, frame.copy(), np.zeros(tangents), columns)

    def _head(self) -> Array:
        p = self.model.parameters
        return np.array([0.0, 0.0, p.K, p.delta_T, p.T_1])

    def trace(self, state: State, n_samples: int) -> tuple[Array, Array, Array, NDArray[np.int64]]:
        """States, tangents and columns at the next samples, the first one at the state itself.

        Returns:
            (n, n_state), (n, k, n_state) tangents as they have grown, (n, p, n_state), and the
            place (n, 2) of each sample, its mesh cycle and step, for ``read``.
        """
        p, n = self.model.parameters, self.model.n_state
        stride, along = p.steps // p.samples_per_cycle, self._directions
        near = along.near(self._work, state.y, state.columns) if along else None
        states = np.empty((n_samples, n))
        tangents = np.empty((n_samples, len(state.tangents), n))
        columns = np.zeros((n_samples, len(near.step) if near else 0, n))
        place = np.array([state.cycle, state.index], dtype=np.int64)
        trace = tracer(self.model.packed.plain)
        y, now = state.y.copy(), state.tangents.copy()
        trace(
            self.model.packed,
            self._work,
            y,
            now,
            near,
            place,
            p.steps,
            stride,
            states,
            tangents,
            columns,
        )
        passed = state.index + stride * np.arange(n_samples)
        places = np.stack([state.cycle + passed // p.steps, passed % p.steps], axis=1)
        return states, tangents, along.told(states, columns) if along else columns, places

    def read(self, states: Array, places: NDArray[np.int64]) -> Array:
        """Samples (n, n_channels) of states (n, n_state) at places (n, 2), as in ``Block``.

        The time is counted from mesh cycle 0.
        """
        rows = np.empty((len(states), len(self.model.layout.channels)))
        model, steps = self.model, self.model.parameters.steps
        read_rows(
            model.packed,
            self._work,
            np.ascontiguousarray(states),
            places,
            steps,
            self._head(),
            self._si,
            self._carrier,
            rows,
        )
        rows[:, 0] = rows[:, 1] / (model.packed.Omega * model.scales.omega_n)
        return rows

    def advance(self, state: State, n_samples: int) -> Block:
        """The next samples from a state on, the first one at the state itself.

        Same state, same model: same samples to the bit, in blocks of whatever size.
        """
        p = self.model.parameters
        layout = self.model.layout
        rows = np.empty((n_samples, len(layout.channels)))
        contact = np.zeros((layout.n_mesh, 3), dtype=np.int64)
        place = np.array([state.cycle, state.index], dtype=np.int64)
        y, tangents, growth = state.y.copy(), state.tangents.copy(), state.growth.copy()
        along = self._directions
        near = along.near(self._work, state.y, state.columns) if along else None
        stride = p.steps // p.samples_per_cycle
        t, filled, switches = self._run(
            self.model.packed,
            self._work,
            y,
            tangents,
            near,
            growth,
            place,
            state.t,
            self.model.scales.omega_n,
            p.steps,
            stride,
            self._head(),
            self._si,
            self._carrier,
            rows,
            contact,
        )
        columns = along.told(y, near.columns) if along and near else state.columns
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
    stepper = Stepper(model)
    block = stepper.advance(state or stepper.start(), cycles * model.parameters.samples_per_cycle)
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
    stepper = Stepper(model)
    n = model.parameters.samples_per_cycle
    now = stepper.start(tangents=1)
    if state is not None:
        now = replace(state, tangents=now.tangents, growth=now.growth)
    growth = []
    for length in [transient] + [max(cycles // 10, 1)] * 10:
        block = stepper.advance(now, length * n)
        if block.diverged:
            raise DivergenceError(f"the motion diverged at t = {block.rows[-1, 0]:.6g} s")
        growth.append(float(block.end.growth[0] - now.growth[0]))
        now = block.end
    tau = max(cycles // 10, 1) * TWO_PI / model.packed.Omega
    batches = np.array(growth[1:]) / tau
    return float(batches.mean()), float(batches.std(ddof=1) / np.sqrt(len(batches)))


def warm_up(model: Model) -> Any:
    """Compile (or load from the cache) all that ``Stepper.advance`` needs; returns the block."""
    stepper = Stepper(model)
    return stepper.advance(stepper.start(tangents=1), 1)
