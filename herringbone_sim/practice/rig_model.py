"""Data of a practice rig as its integrator reads it: Eqs. (1)-(16) in SI units, and all effects.

Meshes m = 6 kind + 3 side + planet (kind 0 sun, 1 ring; side 0 left, 1 right), 12 of them.
Coordinates, 15: r_b theta of s_L, s_R, c, p1_L, p2_L, p3_L, p1_R, p2_R, p3_R, then ring L and R,
pins of planets 1 to 3 and the right plate of the carrier. The last six are fixed unless an effect
frees them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from herringbone_sim.arrays import Array

N_MESH = 12
N_BODY = 9
N_COORDINATE = 15
N_TABLE = 129
BODIES = ("s_L", "s_R", "c", "p1_L", "p2_L", "p3_L", "p1_R", "p2_R", "p3_R")
MESHES = tuple(f"{k}{i}_{s}" for k in ("sp", "rp") for s in "LR" for i in (1, 2, 3))
TOLERANCE = 0.02
TOLERATED = ("k_sp", "k_rp", "I_s", "I_p", "I_c", "m_p", "I_r", "xi", "e_sp", "e_rp")
OFF = (  # fields of ``RigModel`` (12,) that are 0 without effects; their array is shared
    *("k_half", "k_drift", "phase_by_load", "shift_sin", "offset", "rounding", "bent", "c_share"),
    *("cross", "friction", "hysteresis", "c_square", "film", "k_turn", "k_second"),
)


@dataclass(frozen=True)
class Constants:
    """Constants of a rig in SI units: the data sheet, or a rig within its tolerances."""

    k_sp: float = 1.5e9
    k_rp: float = 1.2e9
    I_s: float = 0.008
    I_p: float = 0.007
    I_c: float = 0.22
    I_r: float = 0.125
    m_p: float = 4.485
    xi: float = 0.07
    e_sp: float = 0.35e-4
    e_rp: float = 0.35e-4
    k_amp: float = 0.25
    b: float = 0.6e-4
    b_c: float = 1e-4
    gamma: float = 1.18e-5

    def scaled(self, factors: Mapping[str, float]) -> Constants:
        """Return a copy with some constants multiplied by factors [-], by their names."""
        return replace(self, **{name: getattr(self, name) * f for name, f in factors.items()})


NOMINAL = Constants()


class RandomFunction(NamedTuple):
    """A random smooth function at a mesh, sum of h cosines, and the quantity that it changes.

    Inputs, 8: deflection over 10 um, rate over 0.5 m/s, mesh phase [rad], spring force over 10 kN,
    delta_T over 50 K, angle of a member's revolution [rad], time over ``span``, memory state.
    """

    target: int  # see ``random_physics.TARGETS``; 0: none
    size: Array  # (12,) [-], [N] or [m], 0 where it does not act
    heights: Array  # (h,)
    weights: Array  # (h, 8) of the inputs
    angles: Array  # (h,) [rad]
    mean: float  # subtracted from the sum
    cycles: float  # mesh cycles of the member's revolution
    temperature: float  # delta_T over 50 K
    body: int  # coordinate that a force on a body acts on
    own_rate: float  # 1/s at which the memory state follows its input; 0: no memory state
    own_input: int  # index of that input: 0 deflection, 1 rate


class RigModel(NamedTuple):
    """One rig at one operating point; arrays over meshes are (12,), over coordinates (15,)."""

    mass: Array  # (15,) I / r_b^2 [kg]
    free: Array  # (15,) 1 where a coordinate moves
    stiffness: Array  # [N/m]
    k_cos: Array  # (h, 12) relative harmonics of k by mesh order
    k_sin: Array  # (h, 12)
    k_half: Array  # relative harmonic of k at half the mesh order
    k_drift: Array  # relative growth of k at the time ``span``
    phase_by_load: Array  # phase shift of k under large load [rad]
    shift_cos: Array  # cosine of the phase shift of k and e together
    shift_sin: Array
    error: Array  # amplitude of e [m]
    p_cos: Array  # (h, 12) additional errors by mesh order [m]
    p_sin: Array  # (h, 12)
    offset: Array  # additional constant error [m]
    turn_cycles: Array  # mesh cycles a revolution of the member that runs out
    turn_cos: Array  # (h, 12) additional errors by orders of that revolution [m]
    turn_sin: Array  # (h, 12)
    event: Array  # (5, 12) cycles a revolution, begin, width [cycles], depth [-], height [m]
    window: Array  # (2, N_TABLE) shape of an event over its width, as ``tables.table`` gives it
    half_backlash: Array  # b' of the drive flank [m]
    half_back: Array  # b' of the back flank [m]
    rounding: Array  # width over which a flank comes into contact [m]
    hertz: Array  # exponent of the spring force by deflection
    bent: Array  # 1 where ``bend`` applies
    bend: Array  # (2, N_TABLE) factor on the spring force by deflection
    damping: Array  # [N s/m]
    c_share: Array  # fraction of the damping that depends on contact or load
    c_power: Array  # (2,) power of the deflection that it has, deflection [m] where that is 1
    c_curve: Array  # (2, N_TABLE) instead of the power: table by deflection; (2, 0) without
    c_out: float  # factor on that fraction out of contact
    cross: Array  # fraction of the other side's spring force that is added
    friction: Array  # coefficient of friction
    pitch: float  # mesh phase [rad] at which the sliding changes its sign
    rub: Array  # (2, N_TABLE) factor on it over a mesh cycle; (2, 0): the sign of sliding
    ring: Array  # (4,) spring [N/m], damper [N s/m], their growth [1/m^2], [s/m] of the ring
    # (6,) of a pin: clearance, spring, damper, width of contact, growth [1/m^2], and the share of
    # the damper inside the clearance
    support: Array
    plate: Array  # (2,) spring [N/m], damper [N s/m] of the carrier's right plate
    output: Array  # (2,) friction force [N] and reference speed [m/s] of the output
    shock: Array  # (3,) force [N], cycles between, width [cycles] of a shock on the carrier
    gyro: float  # skew coupling of sun and planet 1, left [N s/m]
    hysteresis: Array  # relative change of the spring force with the sign of the velocity
    c_square: Array  # relative growth of the damping at 1 m/s
    film: Array  # additional damping close to a flank, relative to ``damping``
    k_turn: Array  # relative variation of k once a revolution of the sun
    k_second: Array  # relative increase of k by a second tooth pair that touches under load
    bar: float  # preloaded torsion spring between the halves of the sun [N/m]
    windage: float  # drag on each planet by its rate squared [N s2/m2]
    ripple_order: float  # first order of ``ripple`` by the sun's revolution in the inertial frame
    ripple: Array  # (2, h) cosines and sines of multiples of that order, relative to T_1
    random: RandomFunction
    drive: float  # T_1 / (2 r_bs) [N] on each sun half
    brake: float  # T_2 / r_bc [N], smaller by what a rig loses
    control: float  # amplitude on the carrier [N]
    cos_beta: float
    omega: float  # mesh frequency [rad/s]
    span: float  # reference duration [s] of drifting effects


def radii() -> tuple[float, float, float, float]:
    """Return the base radii of sun, planet, ring and carrier [m]."""
    m_t = 4e-3 / np.cos(np.radians(16.0))
    cos_alpha = np.cos(np.arctan(np.tan(np.radians(20.0)) / np.cos(np.radians(16.0))))
    r_s, r_p, r_r = (float(m_t * z / 2.0 * cos_alpha) for z in (27, 25, 77))
    return r_s, r_p, r_r, r_s + r_p


def omega_n() -> float:
    """Return the natural frequency [rad/s] of the nominal gear, Eq. (17)."""
    r_s, r_p, _, _ = radii()
    return float(np.sqrt(NOMINAL.k_sp * (r_s**2 / NOMINAL.I_s + r_p**2 / NOMINAL.I_p)))


def half_backlash(c: Constants, delta_T: float) -> Array:
    """Return the half-backlash b' (12,) [m] at a temperature rise delta_T [K], Eqs. (2), (3)."""
    m_t = 4e-3 / np.cos(np.radians(16.0))
    strain = delta_T * c.gamma
    lever = np.sin(np.radians(20.0)) / 2.0
    loss = [strain * m_t * ((1.0 + strain) * np.pi + z * lever) for z in (27 + 25, 77 + 25)]
    return np.repeat(c.b - np.array(loss) / 2.0, 6)


def rig_model(c: Constants, point: Mapping[str, float], span: float = 1.0) -> RigModel:
    """Return a rig without effects at an operating point (delta_T [K], K, T_1 [N m], Omega).

    Args:
        span: reference duration [s] of drifting effects.
    """
    r_s, r_p, r_r, r_c = radii()
    m_s, m_pl, m_r = c.I_s / r_s**2, c.I_p / r_p**2, c.I_r / r_r**2
    m_c = c.I_c / r_c**2 + 3.0 * c.m_p
    nominal_m_c = NOMINAL.I_c / r_c**2 + 3.0 * NOMINAL.m_p
    cos_beta = float(np.cos(np.radians(16.0)))
    k = np.repeat([c.k_sp, c.k_rp], 6)
    other = np.repeat([m_s, m_r], 6)
    zero = np.zeros(N_MESH)
    unit = c.b_c * omega_n() ** 2
    return RigModel(
        **dict.fromkeys(OFF, zero),
        mass=np.array([m_s, m_s, m_c, *[m_pl] * 6, m_r, m_r, *[c.m_p] * 3, 0.3 * m_c]),
        free=np.concatenate([np.ones(N_BODY), np.zeros(N_COORDINATE - N_BODY)]),
        stiffness=k,
        k_cos=np.full((1, N_MESH), c.k_amp),
        k_sin=np.zeros((1, N_MESH)),
        shift_cos=np.ones(N_MESH),
        error=np.repeat([c.e_sp, c.e_rp], 6),
        p_cos=np.zeros((0, N_MESH)),
        p_sin=np.zeros((0, N_MESH)),
        turn_cycles=zero + 27.0,
        turn_cos=np.zeros((0, N_MESH)),
        turn_sin=np.zeros((0, N_MESH)),
        event=np.array([zero + 27.0, zero, zero + 1.0, zero, zero]),
        window=np.zeros((2, N_TABLE)),
        half_backlash=half_backlash(c, point["delta_T"]),
        half_back=half_backlash(c, point["delta_T"]),
        hertz=np.ones(N_MESH),
        bend=np.zeros((2, N_TABLE)),
        damping=2.0 * c.xi * np.sqrt(k / (1.0 / other + 1.0 / m_pl)),
        c_power=np.array([0.0, 1e-5]),
        c_curve=np.zeros((2, 0)),
        c_out=0.0,
        pitch=0.0,
        rub=np.zeros((2, 0)),
        ring=np.zeros(4),
        support=np.zeros(6),
        plate=np.zeros(2),
        output=np.array([0.0, 1.0]),
        shock=np.array([0.0, 10.0, 1.0]),
        gyro=0.0,
        bar=0.0,
        windage=0.0,
        ripple_order=1.0,
        ripple=np.zeros((2, 0)),
        random=no_random_function(point["delta_T"]),
        drive=point["T_1"] / 2.0 / r_s,
        brake=2.0 * point["T_1"] / r_s,
        control=point["K"] * unit * nominal_m_c / cos_beta,
        cos_beta=cos_beta,
        omega=point["Omega"] * omega_n(),
        span=span,
    )


def no_random_function(delta_T: float) -> RandomFunction:
    """Return a random function that acts nowhere."""
    none = np.zeros(0)
    zero = np.zeros(N_MESH)
    return RandomFunction(
        0, zero, none, np.zeros((0, 8)), none, 0.0, 27.0, delta_T / 50.0, 0, 0.0, 0
    )
