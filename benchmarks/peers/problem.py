"""The common work of all rows: the reduced gear as scalars, its orbit, its values, its reference.

Peers get the right-hand side in its leanest form: one class of planets, left and right alike, one
harmonic, no control, every constant folded beforehand; ``test/project/test_benchmarks.py`` holds
it against the kernel's own.
"""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.integrate import State, Stepper
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.recording.parameter_file import load_parameters

PAPER = Path(__file__).parents[2] / "config" / "paper.yaml"
ORBIT = {"xi": 0.07, "delta_T": 90.0}
REFERENCE = {"order": 24, "steps_per_cycle": 128, "samples_per_cycle": 4}  # of work (a)
FINE = {"order": 20, "steps_per_cycle": 32, "samples_per_cycle": 4}  # of works (b) and (c)
ORBIT_CYCLES = 20
SETTLING = 3000
TRANSIENT = 300  # mesh cycles left out in works (b) and (c)
OBSERVED = 100
EXPONENT_CYCLES = 300

# Places in the array of constants that ``slope`` reads.
K_SP, K_SP_1, K_RP, K_RP_1, E, C_SP, C_RP, B_SP, B_RP = range(9)
N_S, TWO_N_C, N_C, I_P, LOAD_Q, LOAD_R = range(9, 15)

LEFT = [0, 2, 4, 6]  # one half of a state
FROM_HALF = [0, 0, 1, 1, 2, 2, 3, 3]  # and back
BOTH = {"control_on": (1.0, 0.5, 1.0, 1.0)}  # at K 0 no difference, but halves are told apart

fast: Any = njit(error_model="numpy", fastmath={"contract", "arcp"}, nogil=True)


def rig(**values: object) -> Model:
    """The rig on the periodic orbit of work (a), with some values changed."""
    return build(Parameters().changed(ORBIT | values))


@functools.cache
def paper_parameters() -> Parameters:
    """The paper's set, ``config/paper.yaml``."""
    return load_parameters(PAPER)


def paper(delta_T: float, **values: object) -> Model:
    """The paper's gear at one temperature rise, works (b) and (c)."""
    return build(paper_parameters().changed({"delta_T": float(delta_T)} | values))


def temperatures(n: int) -> Array:
    """The n temperature rises [K] of works (b) and (c)."""
    return np.linspace(0.0, 100.0, n)


def constants(model: Model) -> Array:
    """Constants (15,) of ``slope`` at Omega = 1; ValueError for a gear that it doesn't know."""
    p = model.packed
    alike = all(np.ptp(a.reshape(2, 2), axis=1).max() == 0.0 for a in (p.stiffness, p.b))
    plain = p.k_cos.shape[0] == p.e_cos.shape[0] == 1 and not p.k_sin.any() and not p.e_cos.any()
    if not alike or not plain or p.Omega != 1.0 or p.K != 0.0 or p.e_mean.any():
        raise ValueError("the benchmarks know Omega 1, K 0, one harmonic, no phase, equal halves")
    N, inv_M_c = p.multiplicity, p.inv_M_c
    return np.array(
        [
            *(p.stiffness[0], p.k_cos[0, 0], p.stiffness[2], p.k_cos[0, 2], p.e_sin[0, 0]),
            *(p.damping[0], p.damping[2], p.b[0], p.b[2]),
            *(N * p.inv_M_s[0], 2.0 * N * inv_M_c, N * inv_M_c, p.inv_M_p[0, 0]),
            *(p.load_q[0], p.load_r),
        ]
    )


@fast
def gap(x, b):
    """The backlash function f(x) of Eq. (4)."""
    return x - b if x > b else (x + b if x < -b else 0.0)


@fast
def slope(tau, y, p, dy):
    """dy/dtau of the reduced gear into dy (8,); p as ``constants`` gives it."""
    cos = math.cos(tau)
    e, rate = p[E] * math.sin(tau), p[E] * cos
    k_sp, k_rp = p[K_SP] + p[K_SP_1] * cos, p[K_RP] + p[K_RP_1] * cos
    sp_L = k_sp * gap(y[0] - y[2] - e, p[B_SP]) + p[C_SP] * (y[4] - y[6] - rate)
    sp_R = k_sp * gap(y[1] - y[3] - e, p[B_SP]) + p[C_SP] * (y[5] - y[7] - rate)
    rp_L = k_rp * gap(y[2] - e, p[B_RP]) + p[C_RP] * (y[6] - rate)
    rp_R = k_rp * gap(y[3] - e, p[B_RP]) + p[C_RP] * (y[7] - rate)
    total = (sp_L + rp_L) + (sp_R + rp_R)
    dy[0], dy[1], dy[2], dy[3] = y[4], y[5], y[6], y[7]
    dy[4] = p[LOAD_Q] - p[N_S] * sp_L - p[TWO_N_C] * total
    dy[5] = p[LOAD_Q] - p[N_S] * sp_R - p[TWO_N_C] * total
    dy[6] = p[LOAD_R] - p[N_C] * total + p[I_P] * (sp_L - rp_L)
    dy[7] = p[LOAD_R] - p[N_C] * total + p[I_P] * (sp_R - rp_R)


@fast
def slope_of_half(tau, y, p, dy):
    """The same of one half (4,), q, r and their rates, that stands for both, into dy (4,)."""
    cos = math.cos(tau)
    e, rate = p[E] * math.sin(tau), p[E] * cos
    k_sp, k_rp = p[K_SP] + p[K_SP_1] * cos, p[K_RP] + p[K_RP_1] * cos
    sp = k_sp * gap(y[0] - y[1] - e, p[B_SP]) + p[C_SP] * (y[2] - y[3] - rate)
    rp = k_rp * gap(y[1] - e, p[B_RP]) + p[C_RP] * (y[3] - rate)
    total = 2.0 * (sp + rp)
    dy[0], dy[1] = y[2], y[3]
    dy[2] = p[LOAD_Q] - p[N_S] * sp - p[TWO_N_C] * total
    dy[3] = p[LOAD_R] - p[N_C] * total + p[I_P] * (sp - rp)


@fast
def closed(x, b):
    """Slope of the backlash function."""
    return 1.0 if abs(x) > b else 0.0


@fast
def tangent_slope(tau, y, p, z, dz):
    """The derivative of ``slope`` by y, times a tangent vector z (8,), into dz (8,)."""
    cos, e = math.cos(tau), p[E] * math.sin(tau)
    k_sp, k_rp = p[K_SP] + p[K_SP_1] * cos, p[K_RP] + p[K_RP_1] * cos
    sp_L = k_sp * closed(y[0] - y[2] - e, p[B_SP]) * (z[0] - z[2]) + p[C_SP] * (z[4] - z[6])
    sp_R = k_sp * closed(y[1] - y[3] - e, p[B_SP]) * (z[1] - z[3]) + p[C_SP] * (z[5] - z[7])
    rp_L = k_rp * closed(y[2] - e, p[B_RP]) * z[2] + p[C_RP] * z[6]
    rp_R = k_rp * closed(y[3] - e, p[B_RP]) * z[3] + p[C_RP] * z[7]
    total = (sp_L + rp_L) + (sp_R + rp_R)
    dz[0], dz[1], dz[2], dz[3] = z[4], z[5], z[6], z[7]
    dz[4] = -p[N_S] * sp_L - p[TWO_N_C] * total
    dz[5] = -p[N_S] * sp_R - p[TWO_N_C] * total
    dz[6] = -p[N_C] * total + p[I_P] * (sp_L - rp_L)
    dz[7] = -p[N_C] * total + p[I_P] * (sp_R - rp_R)


def at_rest(y: Array, *tangents: Array) -> State:
    """State of our stepper at phase 0, with such tangent vectors (8,)."""
    return State(
        y.copy(), 0, 0, 0.0, np.array(tangents).reshape(-1, len(y)), np.zeros(len(tangents))
    )


def initial_tangent() -> Array:
    """The tangent vector (8,), of length 1, from which ``run_batch`` starts."""
    z = np.random.default_rng(0).normal(size=8)
    return z / np.linalg.norm(z)


def advanced(model: Model, y: Array, cycles: int) -> Array:
    """State (n_state,) so many mesh cycles after y, by our stepper."""
    n = cycles * model.parameters.samples_per_cycle
    return Stepper(model).advance(at_rest(y), n).end.y


@functools.cache
def orbit_start() -> Array:
    """The state (8,) at phase 0 from which work (a) starts: on the periodic orbit."""
    model = rig()
    return advanced(model, Stepper(model).start().y, SETTLING)


@functools.cache
def orbit_end() -> Array:
    """The reference (8,) of work (a): order 24 with 128 steps."""
    return advanced(rig(**REFERENCE), orbit_start(), ORBIT_CYCLES)


def zero_start(model: Model) -> Array:
    """State (8,) at phase 0 of works (b) and (c): the paper's zero start."""
    return Stepper(model).start().y


def spread_over(values: Array, n: int) -> Indices:
    """Indices of n values evenly spread, or of all."""
    n = min(n, len(values))
    return np.unique(np.linspace(0, len(values) - 1, n).round().astype(np.int64))
