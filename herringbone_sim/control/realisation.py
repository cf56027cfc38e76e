"""Which torques can realise a control: from accelerations of the meshes to newton metres.

A torque on a body moves the meshes by Eqs. (15), (16): with u = r_b theta of the bodies,

    x_sp'' = cos beta (u_s'' - u_c'' - u_p''),    x_rp'' = cos beta (u_p'' - u_c''),

so one on the carrier alone moves all four alike, as Eq. (22) has it; one on a half of the sun
moves its sun mesh alone; one on the planets of a side their sun and ring meshes against each
other. Five bodies (planets of a side count as one) move four meshes: what one torque vector
realises, others realise too, which differ by a rigid rotation of the whole train.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.control.amplitude import least_amplitudes, survey
from herringbone_sim.control.runs import Look, Runs
from herringbone_sim.control.starts import Starts
from herringbone_sim.core.model import Model
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.sweeps.grid import Axis

Array = NDArray[np.float64]

BODIES = ("s_L", "s_R", "c", "p_L", "p_R")
MESHES = ("sp_L", "sp_R", "rp_L", "rp_R")
RIGID = (2.0, 2.0, 1.0, 1.0, 1.0)  # u'' of the bodies at which no mesh is moved
SINGLE = {
    "carrier": ("c",),
    "sun": ("s_L", "s_R"),
    "sun left": ("s_L",),
    "planets": ("p_L", "p_R"),
    "planets left": ("p_L",),
}


@dataclass(frozen=True)
class Actuator:
    """Bodies that a torque acts on, and what it does to the meshes.

    Attributes:
        name: in words.
        pattern: (4,) shares of K on the equations of sp_L, sp_R, rp_L, rp_R (``control_on``).
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
        """The gear whose control this actuator realises."""
        return gear.changed({"control_on": self.pattern})


def torque_arms(model: Model) -> Array:
    """(5,) r_b M of s_L, s_R, c and one planet half a side [kg m]: torque over u''."""
    s, p = model.scales, model.packed
    planets = s.r_bp / p.inv_M_p[:, 0]
    return np.array([*(s.r_bs / p.inv_M_s), s.r_bc * s.M_c, *planets])


def mesh_map() -> Array:
    """(4, 5) x'' / cos beta of the meshes from u'' of s_L, s_R, c, p_L, p_R, Eqs. (15), (16)."""
    return np.array(
        [
            [1.0, 0.0, -1.0, -1.0, 0.0],
            [0.0, 1.0, -1.0, 0.0, -1.0],
            [0.0, 0.0, -1.0, 1.0, 0.0],
            [0.0, 0.0, -1.0, 0.0, 1.0],
        ]
    )


def pattern_of(model: Model, torques_n_m: Array) -> Array:
    """Vector K (4,) of Eq. (22) that torque amplitudes amount to; it enters with a minus there.

    Args:
        torques_n_m: (5,) on s_L, s_R, c, and on each planet half of the left and of the right.
    """
    s = model.scales
    unit = s.cos_beta / s.acceleration_m_per_s2
    moved: Array = -unit * mesh_map() @ (np.asarray(torques_n_m) / torque_arms(model))
    return moved


def torques_for(model: Model, pattern: Sequence[float], on: Sequence[str] = BODIES) -> Array:
    """Torque amplitudes (5,) [N m] on some bodies that realise a vector K of Eq. (22).

    Of all that do, the one with the least sum of squares over all halves of all planets too.

    Args:
        pattern: (4,) K on sp_L, sp_R, rp_L, rp_R.
        on: bodies that may be driven.

    Returns:
        NaN where these bodies cannot realise it.
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
    """Carrier, sun, one half of the sun, planets, planets of one side: each driven alone.

    Signs are those of the carrier's: K > 0 takes K cos from the first mesh that is moved.
    """
    return [_alone(model, name, bodies) for name, bodies in SINGLE.items()]


def _alone(model: Model, name: str, bodies: Sequence[str]) -> Actuator:
    moved = np.array([body in bodies for body in BODIES], dtype=float)
    shares = -mesh_map() @ moved
    shares = shares * np.sign(shares[np.flatnonzero(shares)[0]]) + 0.0  # no -0
    return Actuator(
        name, tuple(map(float, shares)), tuple(map(float, torques_for(model, shares, bodies)))
    )


def substitutes(model: Model) -> list[Actuator]:
    """Other torques that do what the carrier's does: sun and planets alone, and the least ones."""
    paper = (1.0, 1.0, 1.0, 1.0)
    ways = {"sun and planets": ("s_L", "s_R", "p_L", "p_R"), "all, least squares": BODIES}
    return [
        Actuator(name, paper, tuple(torques_for(model, paper, on))) for name, on in ways.items()
    ]


@dataclass(frozen=True)
class Needed:
    """What one actuator needs for a motion.

    Attributes:
        actuator: which.
        wanted: the motion repeats after so many mesh cycles.
        who: starts all of which must lead to it, see ``amplitude.FROM``.
        phase: of the control [rad].
        K: least amplitude from which it is reached over 0.1 of K; NaN = none was found.
        largest: largest amplitude tried.
        torque_n_m: at K, the largest amplitude on one body.
    """

    actuator: Actuator
    wanted: int
    who: str
    phase: float
    K: float
    largest: float
    torque_n_m: float


def needed(
    runs: Runs,
    base: Parameters,
    actuator: Actuator,
    phases: Axis,
    K: Array,
    asked: Sequence[tuple[int, str]],
    starts: Starts,
    look: Look,
) -> list[Needed]:
    """What an actuator needs at each phase for each motion and kind of starts."""
    over = survey(runs, actuator.controlled(base), phases, K, starts, look)
    return [
        Needed(
            *(actuator, wanted, who, one.value, one.staircase.firm, float(K[-1])),
            one.staircase.firm * actuator.largest_n_m,
        )
        for wanted, who in asked
        for one in least_amplitudes(runs, over, wanted, who)
    ]


def easiest(found: Sequence[Needed]) -> Needed | None:
    """The phase that needs the least; None where none reaches the motion."""
    held = [one for one in found if np.isfinite(one.K)]
    return min(held, key=lambda one: one.K) if held else None
