"""Simulation of a gear with effects from measured states, in SI units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.packed import TWO_PI, of_one_type
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.gear import gear_table, laws, pointers_allowed, scratch
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.verdict.augmented import Augmented, parameters_of
from herringbone_sim.gap.verification.parallel_simulation import roll

STEPS = 128  # Runge-Kutta steps per natural period; their error is far below recording noise


class _Scratch(NamedTuple):
    """Work arrays of a step; n = n_mesh, s = size of the state including states of effects."""

    x: Array  # (n,) deflection [m]
    v: Array  # (n,) its rate [m/s]
    scaled: Array  # (n,) mesh forces, dimensionless
    stage: Array  # (s,)
    rate: Array  # (4, s)
    projection: float


@dataclass(frozen=True)
class SimulatedRuns:
    """s simulated motions of k samples each.

    Attributes:
        z, z_rate: (s, k, n_coordinate) coordinates (q, r) [m], [m/s].
        force_n: (s, k, n_mesh) [N].
        added_states: (s, k, n_added_states) states of effects.
    """

    z: Array
    z_rate: Array
    force_n: Array
    added_states: Array


class GearSimulator:
    """Simulates a gear with effects from given states; holds work arrays, but no state.

    Args:
        model: built at the operating point.
        actives: effects; those of sensors are ignored.
    """

    def __init__(self, model: Model, actives: Sequence[Active] = ()) -> None:
        s, layout = model.scales, model.layout
        self.model = model
        self.laws = laws(model, actives)
        self._gear = gear_table(model)
        self._w = scratch(model, self.laws.n_added_states)
        n, size = layout.n_mesh, layout.n_state + self.laws.n_added_states
        x, v, scaled = np.zeros((3, n))
        self._g = _Scratch(x, v, scaled, np.zeros(size), np.zeros((4, size)), s.projection)
        force = s.b_c * s.omega_n**2 / s.projection
        u_unit = s.b_c / s.cos_beta
        self._si = np.array([s.b_c, s.velocity_m_per_s, force, u_unit, s.omega_n], dtype=float)
        self._unit = np.repeat([s.b_c, s.velocity_m_per_s], layout.n_coordinate)

    def run(
        self,
        z: Array,
        z_rate: Array,
        phase: Array,
        turn: float,
        samples: int,
        added_states: Array | None = None,
    ) -> SimulatedRuns:
        """Simulate s motions; the first sample of each is its initial state.

        Args:
            z, z_rate: (s, n_coordinate) initial states [m], [m/s].
            phase: (s,) initial mesh phase [rad], unwrapped.
            turn: mesh phase per sample [rad].
            samples: number of samples of each motion.
            added_states: (s, n_added_states) initial states of effects; None: zero.
        """
        p, m = self.model.parameters, self.model.layout.n_coordinate
        if added_states is None:
            added_states = np.zeros((len(z), self.laws.n_added_states))
        y = np.ascontiguousarray(np.hstack([np.hstack([z, z_rate]) / self._unit, added_states]))
        cycle = np.floor(phase / TWO_PI)
        parts = math.ceil(STEPS * max(1.0, 1.0 / p.Omega) * turn / TWO_PI)
        states = np.empty((len(z), samples, y.shape[1]))
        force = np.empty((len(z), samples, self.model.layout.n_mesh))
        now = np.array([0.0, p.Omega * self.model.scales.omega_n, p.delta_T, p.T_1, p.K])
        with pointers_allowed():
            roll(
                *self.laws,
                self._gear,
                of_one_type(self.model.packed),
                self._si,
                now,
                y,
                cycle,
                phase - TWO_PI * cycle,
                turn / p.Omega / parts,
                parts,
                self._w,
                self._g,
                states,
                force,
            )
        moved = states[:, :, : 2 * m] * self._unit
        return SimulatedRuns(moved[:, :, :m], moved[:, :, m:], force, states[:, :, 2 * m :])


def simulator_of(run: PreparedRun, model: Augmented) -> GearSimulator:
    """Return a simulator of the augmented model at the operating point of a run.

    Raises:
        ParameterError: factors out of range, or an effect at a locus that it can't have.
    """
    return GearSimulator(build(parameters_of(run.model.parameters, model)), model.actives)


def phase_step(run: PreparedRun) -> float:
    """Return the mean mesh phase per sample [rad]."""
    return float((run.phase[-1] - run.phase[0]) / (len(run) - 1))
