"""A practice rig as the integrator reads it: Eqs. (1)-(16) in SI units, and room for effects.

Meshes m = 6 kind + 3 side + planet (kind 0 sun, 1 ring; side 0 left, 1 right), 12 of them.
Coordinates, 15: r_b theta of s_L, s_R, c, p1_L, p2_L, p3_L, p1_R, p2_R, p3_R, then ring L and R,
pins of planets 1 to 3 and the right plate of the carrier. The last six rest unless set free.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

N_MESH = 12
N_BODY = 9
N_COORDINATE = 15
N_HARMONIC = 6
BODIES = ("s_L", "s_R", "c", "p1_L", "p2_L", "p3_L", "p1_R", "p2_R", "p3_R")
MESHES = tuple(f"{k}{i}_{s}" for k in ("sp", "rp") for s in "LR" for i in (1, 2, 3))
TOLERANCE = 0.02
TOLERATED = ("k_sp", "k_rp", "I_s", "I_p", "I_c", "m_p", "I_r", "xi", "e_sp", "e_rp")


@dataclass(frozen=True)
class Constants:
    """What a rig is built to, SI units: the data sheet, or a rig within its tolerance."""

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
        """The same rig with some constants multiplied."""
        return replace(self, **{name: getattr(self, name) * f for name, f in factors.items()})


NOMINAL = Constants()


class Machine(NamedTuple):
    """One rig at one operating point; arrays over meshes are (12,), over coordinates (15,)."""

    mass: Array  # (15,) I / r_b^2 [kg]
    free: Array  # (15,) 1 where a coordinate moves
    stiffness: Array  # [N/m]
    k_cos: Array  # (6, 12) harmonics of k as shares
    k_sin: Array  # (6, 12)
    k_half: Array  # share of k at half the mesh order
    k_drift: Array  # share by which k has grown at the end of the run
    phase_by_load: Array  # shift of k by load [rad]
    shift_cos: Array  # of the phase shift of k and e together
    shift_sin: Array
    error: Array  # amplitude of e [m]
    p_cos: Array  # (6, 12) further errors by mesh order [m]
    p_sin: Array  # (6, 12)
    offset: Array  # constant displacement [m]
    runout: Array  # (5, 12) amplitude [m], cycles a turn, phase [rad], second order's share, phase
    event: Array  # (6, 12) cycles a turn, start, width [cycles], skew, depth [-], height [m]
    half_backlash: Array  # b' [m]
    rounding: Array  # width over which the flank takes up load [m]
    hertz: Array  # exponent of the spring's force
    damping: Array  # [N s/m]
    c_share: Array  # share of the damping that lives by contact
    c_load: float  # 0: in contact alone, 1: by load
    cross: Array  # share of the other side's spring force
    friction: Array  # coefficient at low sliding speed
    pitch: float  # where the sliding turns [rad]
    ring: Array  # (2,) spring [N/m] and damper [N s/m] of the ring
    support: Array  # (3,) clearance, spring and damper of a planet's pin
    plate: Array  # (2,) spring and damper of the carrier's right plate
    output: Array  # (2,) stick force [N] and speed [m/s] of the output
    shock: Array  # (3,) force [N], cycles between, width [cycles] of a shock on the carrier
    gyro: float  # skew coupling of sun and planet 1, left [N s/m]
    hysteresis: Array  # share of the spring force that turns with the direction of motion
    c_square: Array  # share by which damping has grown at 1 m/s
    film: Array  # damping of the gap next to a flank, as a multiple of that of the mesh
    k_turn: Array  # share of k that comes once a turn of the sun
    k_second: Array  # share of k that a second pair adds, once it touches
    bar: float  # torsion spring between the halves of the sun, put in with a twist [N/m]
    windage: float  # drag on each planet by its rate squared [N s2/m2]
    ripple: Array  # (4,) amplitude, order a turn, phase, share of the second order
    drive: float  # T_1 / (2 r_bs) [N] on each sun half
    brake: float  # T_2 / r_bc [N]
    control: float  # amplitude on the carrier [N]
    cos_beta: float
    omega: float  # mesh frequency [rad/s]
    span: float  # duration of the run [s], for what drifts


def radii() -> tuple[float, float, float, float]:
    """Base radii of sun, planet, ring and carrier [m]."""
    m_t = 4e-3 / np.cos(np.radians(16.0))
    cos_alpha = np.cos(np.arctan(np.tan(np.radians(20.0)) / np.cos(np.radians(16.0))))
    r_s, r_p, r_r = (float(m_t * z / 2.0 * cos_alpha) for z in (27, 25, 77))
    return r_s, r_p, r_r, r_s + r_p


def omega_n(c: Constants = NOMINAL) -> float:
    """Natural frequency [rad/s] of Eq. (17)."""
    r_s, r_p, _, _ = radii()
    return float(np.sqrt(c.k_sp * (r_s**2 / c.I_s + r_p**2 / c.I_p)))


def half_backlash(c: Constants, delta_T: float) -> Array:
    """b' (12,) [m] of Eqs. (2), (3)."""
    m_t = 4e-3 / np.cos(np.radians(16.0))
    strain = delta_T * c.gamma
    lever = np.sin(np.radians(20.0)) / 2.0
    loss = [strain * m_t * ((1.0 + strain) * np.pi + z * lever) for z in (27 + 25, 77 + 25)]
    return np.repeat(c.b - np.array(loss) / 2.0, 6)


def machine(c: Constants, point: Mapping[str, float], span: float = 1.0) -> Machine:
    """A rig without effect at an operating point (delta_T [K], K, T_1 [N m], Omega)."""
    r_s, r_p, r_r, r_c = radii()
    m_s, m_pl, m_r = c.I_s / r_s**2, c.I_p / r_p**2, c.I_r / r_r**2
    m_c = c.I_c / r_c**2 + 3.0 * c.m_p
    nominal_m_c = NOMINAL.I_c / r_c**2 + 3.0 * NOMINAL.m_p
    cos_beta = float(np.cos(np.radians(16.0)))
    k = np.repeat([c.k_sp, c.k_rp], 6)
    other = np.repeat([m_s, m_r], 6)
    harmonics = np.zeros((N_HARMONIC, N_MESH))
    harmonics[0] = c.k_amp
    zero = np.zeros(N_MESH)
    unit = c.b_c * omega_n() ** 2
    return Machine(
        mass=np.array([m_s, m_s, m_c, *[m_pl] * 6, m_r, m_r, *[c.m_p] * 3, 0.3 * m_c]),
        free=np.concatenate([np.ones(N_BODY), np.zeros(N_COORDINATE - N_BODY)]),
        stiffness=k,
        k_cos=harmonics,
        k_sin=np.zeros((N_HARMONIC, N_MESH)),
        k_half=zero.copy(),
        k_drift=zero.copy(),
        phase_by_load=zero.copy(),
        shift_cos=np.ones(N_MESH),
        shift_sin=zero.copy(),
        error=np.repeat([c.e_sp, c.e_rp], 6),
        p_cos=np.zeros((N_HARMONIC, N_MESH)),
        p_sin=np.zeros((N_HARMONIC, N_MESH)),
        offset=zero.copy(),
        runout=np.array([zero, zero + 27.0, zero, zero, zero]),
        event=np.array([zero + 27.0, zero, zero + 1.0, zero + 1.0, zero, zero]),
        half_backlash=half_backlash(c, point["delta_T"]),
        rounding=zero.copy(),
        hertz=np.ones(N_MESH),
        damping=2.0 * c.xi * np.sqrt(k / (1.0 / other + 1.0 / m_pl)),
        c_share=zero.copy(),
        c_load=0.0,
        cross=zero.copy(),
        friction=zero.copy(),
        pitch=0.0,
        ring=np.zeros(2),
        support=np.zeros(3),
        plate=np.zeros(2),
        output=np.array([0.0, 1.0]),
        shock=np.array([0.0, 10.0, 1.0]),
        gyro=0.0,
        hysteresis=zero.copy(),
        c_square=zero.copy(),
        film=zero.copy(),
        k_turn=zero.copy(),
        k_second=zero.copy(),
        bar=0.0,
        windage=0.0,
        ripple=np.zeros(4),
        drive=point["T_1"] / 2.0 / r_s,
        brake=2.0 * point["T_1"] / r_s,
        control=point["K"] * unit * nominal_m_c / cos_beta,
        cos_beta=cos_beta,
        omega=point["Omega"] * omega_n(),
        span=span,
    )
