"""A gear with effects, integrated: the interface of ``core.integrate.Stepper``, samples alike.

The series of the core can't know what an effect does, so the method is Runge-Kutta of order 4,
cut where a mesh makes or loses contact. In the place of a tangent a second trajectory runs close
by, brought back to its distance once a step of the grid (Benettin, Galgani and Strelcyn, Phys.
Rev. A 14, 2338, 1976): its growth gives the largest exponent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core import integrate
from herringbone_sim.core.integrate import Block, State, Stepper, carrier_row
from herringbone_sim.core.model import Model, initial_state
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.assemble import acting, assemble, in_slots, own_coordinates
from herringbone_sim.effects.channels import distort
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.gear import gear_table, laws, pointers_allowed, scratch
from herringbone_sim.effects.instant import own_slopes
from herringbone_sim.effects.rows import DISTANCE, run
from herringbone_sim.errors import AnalysisError, DivergenceError

Array = NDArray[np.float64]
LEAST_STEPS = 48
OWN_STEPS = 16  # of the method a period of the fastest own state of an effect
DEFLECTION_M = 1e-3  # beyond any clearance, where own states are at their stiffest


class _Stage(NamedTuple):
    """Scratch of the integration; n = n_mesh, s = size of the state with own states."""

    x: Array  # (n,) deflection with the nominal error [m]
    v: Array  # (n,) its rate [m/s]
    scaled: Array  # (n,) mesh forces, dimensionless
    stage: Array  # (s,)
    rate: Array  # (4, s)
    projection: float


class EffectStepper:
    """Advances states of one model with effects; the interface is that of ``core.Stepper``.

    A state's ``y`` is that of the model, then the effects' own states in SI units.

    Args:
        model: see ``core.model.build``.
        actives: effects with size and place; those of sensors are passed over.
        least_steps: of the method a natural period; more where the mesh is slower than that, or
            own states of effects are faster.

    Raises:
        ParameterError: a locus that the gear or the effect doesn't have.
    """

    def __init__(
        self, model: Model, actives: Sequence[Active], least_steps: int = LEAST_STEPS
    ) -> None:
        p, s = model.parameters, model.scales
        self.model = model
        self.actives = tuple(one for one in actives if one.effect.level != "sensor")
        self.laws = laws(model, actives)
        self._gear = gear_table(model)
        self._w = scratch(model, self.laws.n_own)
        n, size = model.layout.n_mesh, model.layout.n_state + self.laws.n_own
        x, v, scaled = np.zeros((3, n))
        self._g = _Stage(x, v, scaled, np.zeros(size), np.zeros((4, size)), s.projection)
        self._began, self._before = np.zeros(size), np.zeros((2, 3, n))
        force = s.b_c * s.omega_n**2 / s.projection
        self._si = np.array(
            [s.b_c, s.velocity_m_per_s, force, s.b_c / s.cos_beta, s.omega_n], dtype=float
        )
        self._carrier = carrier_row(model) * s.b_c
        self._unit = np.ones(size)
        self._unit[model.layout.n_state :: 2] = s.b_c
        self._unit[model.layout.n_state + 1 :: 2] = s.velocity_m_per_s
        wanted = max(least_steps, OWN_STEPS * self._fastest(), p.steps_per_cycle)
        self._parts = math.ceil(wanted * max(1.0, 1.0 / p.Omega) / p.steps)

    def _fastest(self) -> float:
        """Frequency of the effects' fastest own state over the natural frequency."""
        n, p = self.laws.n_own, self.model.parameters
        if n == 0:
            return 0.0
        now = np.array([0.0, p.Omega * self.model.scales.omega_n, p.delta_T, p.T_1, p.K])
        slopes = np.zeros((1 + n, n))
        with pointers_allowed():
            for j, own in enumerate(DEFLECTION_M * np.eye(1 + n, n, -1)):
                own_slopes(
                    self.laws.kernel,
                    self.laws.site,
                    self.laws.theta,
                    self._gear,
                    now,
                    own,
                    np.zeros(self.model.layout.n_mesh),
                    slopes[j],
                )
        fastest = np.abs(np.linalg.eigvals((slopes[1:] - slopes[0]) / DEFLECTION_M)).max()
        return float(fastest / self.model.scales.omega_n)

    @property
    def compiled(self) -> bool:
        """Whether this process has the kernel of gears with laws of their own ready."""
        return bool(getattr(run, "signatures", True))

    def alike(self, other: object) -> bool:
        """Whether another stepper runs on the same kernel."""
        return isinstance(other, EffectStepper)

    def start(self, tangents: int = 0) -> State:
        """Initial state, effects' own states at rest, with a second trajectory or without.

        Raises:
            AnalysisError: more than one tangent is wanted.
        """
        if tangents > 1:
            raise AnalysisError(
                f"a gear with effects has no tangent flow, only a second trajectory for the "
                f"largest exponent, got tangents = {tangents}: ask for one, or leave the effects "
                "out for the whole spectrum"
            )
        y = np.concatenate([initial_state(self.model), np.zeros(self.laws.n_own)])
        apart = np.random.default_rng(0).normal(size=(tangents, y.size))
        apart /= np.linalg.norm(apart, axis=1, keepdims=True)
        return State(y, 0, 0, 0.0, apart, np.zeros(tangents))

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
        stride = p.steps // p.samples_per_cycle
        now = np.array([0.0, p.Omega * self.model.scales.omega_n, p.delta_T, p.T_1, p.K])
        with pointers_allowed():
            t, filled = run(
                self.laws.kernel,
                self.laws.site,
                self.laws.theta,
                self._gear,
                self.model.packed,
                self._si,
                self._carrier,
                now,
                y,
                y + DISTANCE * self._unit * tangents,
                self._unit,
                tangents,
                growth,
                place,
                state.t,
                p.steps,
                stride,
                self._parts,
                self._w,
                self._g,
                self._began,
                self._before,
                rows,
                contact,
            )
        end = State(y, int(place[0]), int(place[1]), float(t), tangents, growth)
        at = (state.index // stride + np.arange(filled)) % p.samples_per_cycle
        return Block(
            rows=rows[:filled],
            start=state,
            end=end,
            section=np.flatnonzero(at == 0),
            contact=contact,
            switches=0,
            diverged=filled < n_samples or not bool(np.all(np.isfinite(y))),
        )


Machine = Stepper | EffectStepper


def stepper(model: Model, actives: Sequence[Active]) -> Machine:
    """The stepper of a gear: that of the core where its slots hold all effects."""
    if in_slots(actives):
        return Stepper(assemble(model, actives))
    return EffectStepper(model, acting(actives))


def change(old: Machine, new: Machine, state: State) -> State:
    """State with which a run goes on after a change of live parameters or effects.

    Displacements and rates are kept, see ``core.integrate.change``. An effect that stays where it
    was, of whatever size, keeps its own states; those of a new one are at rest. Tangents begin
    anew, as many as there were.
    """
    n = old.model.layout.n_state
    moved = integrate.change(old.model, new.model, replace(state, y=state.y[:n]))
    before = _own(old, state.y)
    y = np.concatenate([moved.y, new.start().y[n:]])
    for key, (indices, unit) in _own_places(new).items():
        if key in before and before[key].shape == indices.shape:
            y[indices] = before[key] / unit
    if not len(state.tangents):
        return replace(moved, y=y, tangents=np.zeros((0, y.size)))
    fresh = new.start(len(state.tangents))
    return replace(moved, y=y, tangents=fresh.tangents, growth=fresh.growth)


def _own(machine: Machine, y: Array) -> dict[tuple[object, ...], Array]:
    """Own states, displacements and rates in SI units, by effect and place."""
    return {key: y[at] * unit for key, (at, unit) in _own_places(machine).items()}


def _own_places(machine: Machine) -> dict[tuple[object, ...], tuple[NDArray[np.int64], Array]]:
    """Indices (k, 2) of an effect's own displacements and rates in a state, and their units.

    The key is the effect, its place, and how many such ones stand before it.
    """
    model, n = machine.model, machine.model.layout.n_state
    if isinstance(machine, EffectStepper):
        actives, sizes, unit = machine.actives, np.diff(machine.laws.first) // 2, np.ones(2)
        pairs = np.arange(machine.laws.n_own).reshape(-1, 2)
    else:
        actives, sizes = model.effects, np.array(own_coordinates(model), dtype=int)
        unit = np.array([model.scales.b_c, model.scales.velocity_m_per_s])
        pairs = np.arange(2 * model.n_own).reshape(2, -1).T
    edges = np.cumsum([0, *sizes])
    return {
        (one.effect.id, one.locus, _before(actives, i)): (n + pairs[edges[i] : edges[i + 1]], unit)
        for i, one in enumerate(actives)
    }


def _before(actives: Sequence[Active], i: int) -> int:
    """How many effects of the same kind at the same place stand before one."""
    mine = actives[i].effect.id, actives[i].locus
    return sum((one.effect.id, one.locus) == mine for one in actives[:i])


def simulate(
    model: Model, actives: Sequence[Active], cycles: int, state: State | None = None
) -> tuple[TimeSeries, State]:
    """Samples of whole mesh cycles of a gear with effects, and the state after them.

    Sensor effects are in the samples, see ``channels.distort`` for them alone.

    Raises:
        DivergenceError: the motion left the range of any gear.
    """
    machine = stepper(model, actives)
    block = machine.advance(state or machine.start(), cycles * model.parameters.samples_per_cycle)
    if block.diverged:
        raise DivergenceError(
            f"the motion diverged at t = {block.rows[-1, 0]:.6g} s with "
            f"{', '.join(one.effect.id for one in actives)} and {model.parameters}"
        )
    series = TimeSeries(block.rows[:, 0].copy(), block.rows, model.layout.channels)
    return distort(series, tuple(actives)), block.end
