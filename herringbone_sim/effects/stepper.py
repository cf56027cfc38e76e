"""A gear with effects, integrated: the interface of ``core.integrate.Stepper``, samples alike.

The series of the core can't know what an effect does, so the method is Runge-Kutta of order 4,
with so many steps that its error on a smooth stretch is far below the noise of a recording. It
steps over the kinks of the backlash function, which costs the order there, not the convergence.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.integrate import Block, State, Stepper, carrier_row
from herringbone_sim.core.model import Model, initial_state
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.channels import distort
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.gear import gear_table, laws, pointers_allowed, scratch
from herringbone_sim.effects.run import run
from herringbone_sim.errors import AnalysisError, DivergenceError

Array = NDArray[np.float64]
LEAST_STEPS = 256


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
        least_steps: of the method a natural period; more where the mesh is slower than that.

    Raises:
        ParameterError: a locus that the gear or the effect doesn't have.
    """

    def __init__(
        self, model: Model, actives: Sequence[Active], least_steps: int = LEAST_STEPS
    ) -> None:
        p, s = model.parameters, model.scales
        self.model = model
        self.laws = laws(model, actives)
        self._gear = gear_table(model)
        self._w = scratch(model, self.laws.n_own)
        n, size = model.layout.n_mesh, model.layout.n_state + self.laws.n_own
        x, v, scaled = np.zeros((3, n))
        self._g = _Stage(x, v, scaled, np.zeros(size), np.zeros((4, size)), s.projection)
        force = s.b_c * s.omega_n**2 / s.projection
        self._si = np.array(
            [s.b_c, s.velocity_m_per_s, force, s.b_c / s.cos_beta, s.omega_n], dtype=float
        )
        self._carrier = carrier_row(model) * s.b_c
        wanted = max(least_steps, p.steps_per_cycle) * max(1.0, 1.0 / p.Omega)
        self._parts = math.ceil(wanted / p.steps)

    def start(self, tangents: int = 0) -> State:
        """Initial state, effects' own states at rest; AnalysisError when tangents are wanted."""
        if tangents:
            raise AnalysisError(
                f"a gear with effects has no tangent flow, got tangents = {tangents}: leave the "
                "effects out for exponents"
            )
        y = np.concatenate([initial_state(self.model), np.zeros(self.laws.n_own)])
        return State(y, 0, 0, 0.0, np.zeros((0, y.size)), np.zeros(0))

    def advance(self, state: State, n_samples: int) -> Block:
        """The next samples from a state on, the first one at the state itself.

        Same state, same model: same samples to the bit, in blocks of whatever size.
        """
        p = self.model.parameters
        layout = self.model.layout
        rows = np.empty((n_samples, len(layout.channels)))
        contact = np.zeros((layout.n_mesh, 3), dtype=np.int64)
        place = np.array([state.cycle, state.index], dtype=np.int64)
        y = state.y.copy()
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
                place,
                state.t,
                p.steps,
                stride,
                self._parts,
                self._w,
                self._g,
                rows,
                contact,
            )
        end = replace(state, y=y, cycle=int(place[0]), index=int(place[1]), t=float(t))
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


def stepper(model: Model, actives: Sequence[Active]) -> Stepper | EffectStepper:
    """The stepper of a gear: that of the core where no effect acts on the machine."""
    acting = [one for one in actives if one.effect.level != "sensor"]
    return EffectStepper(model, acting) if acting else Stepper(model)


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
