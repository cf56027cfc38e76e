"""Torques on the bodies [N m] that realise a control of the meshes.

A torque on a body moves the meshes by Eqs. (15), (16): with u = r_b theta of the bodies,

    x_sp'' = cos beta (u_s'' - u_c'' - u_p''),    x_rp'' = cos beta (u_p'' - u_c''),

so a torque on the carrier acts on all four meshes alike, as in Eq. (22); a torque on a half of the
sun on its sun mesh alone; torques on the planets of a side on their sun and ring meshes with
opposite signs. Five bodies (the planets of a side count as one) act on four meshes, so a control
can be realised by many torque vectors, which differ by a rigid rotation of the whole train.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.control.amplitude import Survey, Target, least_amplitudes
from herringbone_sim.control.runs import MotionRunner
from herringbone_sim.core.model import Model
from herringbone_sim.core.parameters import Parameters

BODIES = ("s_L", "s_R", "c", "p_L", "p_R")
MESHES = ("sp_L", "sp_R", "rp_L", "rp_R")
SINGLE = {
    "carrier": ("c",),
    "sun": ("s_L", "s_R"),
    "sun left": ("s_L",),
    "planets": ("p_L", "p_R"),
    "planets left": ("p_L",),
}


@dataclass(frozen=True)
class Actuator:
    """Torques on one or more bodies, and their action on the meshes.

    Attributes:
        name: in words.
        pattern: (4,) factors of K on the equations of sp_L, sp_R, rp_L, rp_R (``control_on``).
        torques_n_m: (5,) torque amplitude on s_L, s_R, c and on each planet half of the left and
            of the right at K = 1 and angle 0 [N m], signs as the rotation of each body.
    """

    name: str
    pattern: tuple[float, ...]
    torques_n_m: tuple[float, ...]

    @property
    def largest_n_m(self) -> float:
        """Largest torque amplitude on one body at K = 1 [N m]."""
        return float(np.max(np.abs(self.torques_n_m)))

    def controlled(self, gear: Parameters) -> Parameters:
        """Parameters of the gear with the control that this actuator realises."""
        return gear.changed({"control_on": self.pattern})


def torque_arms(model: Model) -> Array:
    """(5,) r_b M [kg m] of s_L, s_R, c and a planet half of each side: torque over u''."""
    s, p = model.scales, model.packed
    planets = s.r_bp / p.inv_M_p[:, 0]
    return np.array([*(s.r_bs / p.inv_M_s), s.r_bc * s.M_c, *planets])


def mesh_map() -> Array:
    """(4, 5) matrix from u'' of ``BODIES`` to x'' / cos beta of ``MESHES``, Eqs. (15), (16)."""
    return np.array(
        [
            [1.0, 0.0, -1.0, -1.0, 0.0],
            [0.0, 1.0, -1.0, 0.0, -1.0],
            [0.0, 0.0, -1.0, 1.0, 0.0],
            [0.0, 0.0, -1.0, 0.0, 1.0],
        ]
    )


def torques_for(model: Model, pattern: Sequence[float], on: Sequence[str] = BODIES) -> Array:
    """Torque amplitudes (5,) [N m] on some bodies that realise a vector K of Eq. (22).

    Of all such torques those with the least sum of squares, where each half of each planet counts.

    Args:
        pattern: (4,) K on sp_L, sp_R, rp_L, rp_R.
        on: bodies that may be driven.

    Returns:
        As in ``Actuator.torques_n_m``; NaN if these bodies cannot realise it.
    """
    s, N = model.scales, model.parameters.n_planets
    weight = np.sqrt([1.0, 1.0, 1.0, N, N])
    unit = s.cos_beta / s.acceleration_m_per_s2
    to_meshes = -unit * mesh_map() / torque_arms(model) / weight
    driven = np.array([body in on for body in BODIES])
    to_meshes[:, ~driven] = 0.0
    wanted = np.asarray(pattern, dtype=float)
    scale = np.abs(to_meshes).max()
    weighted = np.linalg.lstsq(to_meshes / scale, wanted, rcond=1e-10)[0]
    if np.abs(to_meshes / scale @ weighted - wanted).max() > 1e-9 * np.abs(wanted).max():
        return np.full(len(BODIES), np.nan)
    torques: Array = np.where(driven, weighted / weight / scale, 0.0)
    return torques


def single_actuators(model: Model) -> list[Actuator]:
    """Actuators on the carrier, the sun, its left half, all planets, and the planets of the left.

    Signs are as for the carrier: K > 0 subtracts K cos from the first mesh that is acted on.
    """
    return [_alone(model, name, bodies) for name, bodies in SINGLE.items()]


def _alone(model: Model, name: str, bodies: Sequence[str]) -> Actuator:
    driven = np.array([body in bodies for body in BODIES], dtype=float)
    shares = -mesh_map() @ driven
    shares = shares * np.sign(shares[np.flatnonzero(shares)[0]]) + 0.0  # no -0
    return Actuator(
        name, tuple(map(float, shares)), tuple(map(float, torques_for(model, shares, bodies)))
    )


def substitutes(model: Model) -> list[Actuator]:
    """Actuators that act on the meshes as one on the carrier does, by torques on other bodies.

    On sun and planets; and on all bodies, with the least sum of squares.
    """
    paper = (1.0, 1.0, 1.0, 1.0)
    ways = {"sun and planets": ("s_L", "s_R", "p_L", "p_R"), "all, least squares": BODIES}
    return [
        Actuator(name, paper, tuple(torques_for(model, paper, on))) for name, on in ways.items()
    ]


@dataclass(frozen=True)
class TorqueDemand:
    """Torque that an actuator needs to reach a motion.

    Attributes:
        actuator: bodies that are driven.
        target: motion to reach.
        phase: of the control [rad].
        K: least amplitude (``amplitude.Staircase.firm``); NaN = none up to ``largest``.
        largest: largest amplitude tested.
        torque_n_m: largest torque amplitude on one body at K [N m].
    """

    actuator: Actuator
    target: Target
    phase: float
    K: float
    largest: float
    torque_n_m: float


def torque_demands(
    runner: MotionRunner,
    survey: Survey,
    actuator: Actuator,
    targets: Sequence[Target],
) -> list[TorqueDemand]:
    """Torque demand of an actuator for each target at each phase of a survey.

    Args:
        runner: integrates the runs of the bisection.
        survey: over phase and K of the gear that the actuator controls.
        actuator: bodies that are driven.
        targets: motions to reach.
    """
    return [
        TorqueDemand(
            *(actuator, target, least.value, least.staircase.firm, float(survey.K[-1])),
            least.staircase.firm * actuator.largest_n_m,
        )
        for target in targets
        for least in least_amplitudes(runner, survey, target)
    ]


def smallest_demand(demands: Sequence[TorqueDemand]) -> TorqueDemand | None:
    """The demand with the least K; None if no demand reaches its target."""
    reached = [demand for demand in demands if np.isfinite(demand.K)]
    return min(reached, key=lambda demand: demand.K) if reached else None
