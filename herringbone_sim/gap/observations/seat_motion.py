"""Integrate the motion of a part on a spring seat, driven by the meshes that it carries; compiled.

Mesh displacements are measured as if the part were rigid; its own displacement q is not measured
and reduces them, so the force law of the meshes is part of its equation of motion.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from herringbone_sim.arrays import Array

MAX_STEP_RAD = 1.25  # phase of the fastest oscillation per step; stability limit 2.8; chosen
MAX_SUBSTEPS = 40  # steps per sample, limit of run time
DIVERGED_M = 1e-2  # displacement at which the integration is reset; 100 times b_c


class MeshLoads(NamedTuple):
    """Meshes that drive a part, of one run at equal steps; arrays (n, j).

    Attributes:
        x, v: displacement [m] and rate [m/s] as if the part were rigid.
        k, c: stiffness [N/m] and damping [N s/m].
        plus, minus: half-backlash on both flanks [m].
        extra_force: force independent of the motion [N].
        noise: (j,) noise of x [m].
        rest: (n,) force [N] on the body that carries the part, without that of the seat.
        step: [s].
    """

    x: Array
    v: Array
    k: Array
    c: Array
    plus: Array
    minus: Array
    extra_force: Array
    noise: Array
    rest: Array
    step: float


class SeatSpring(NamedTuple):
    """Mass of a part and properties of its seat.

    Attributes:
        mass: [kg].
        under: mass of the body that carries the part [kg]; inf: fixed.
        stiffness: [N/m].
        damping: [N s/m].
        play: clearance to either side [m].
        width: rounding of the ends of the play [m].
        growth: relative increase of the stiffness with the squared deflection [1/m^2].
        drag: relative increase of the damping with the rate [s/m].
        farthest, fastest: deflection [m] and rate [m/s] for which the step is chosen.
    """

    mass: float
    under: float
    stiffness: float
    damping: float
    play: float = 0.0
    width: float = 0.0
    growth: float = 0.0
    drag: float = 0.0
    farthest: float = 0.0
    fastest: float = 0.0


def motion(meshes: MeshLoads, spring: SeatSpring, cos_beta: float) -> Array:
    """Displacement [m] and rate [m/s] (n, 2) of a part, starting at rest in equilibrium.

    M q'' = cos beta sum F(x - q cos beta) - H (1 + M / M_u) - rest M / M_u with seat force H, by
    Runge-Kutta 4.
    """
    stiff = spring.stiffness * (1.0 + 3.0 * spring.growth * spring.farthest**2)
    stiff += cos_beta**2 * float(np.max(meshes.k.sum(axis=1)))
    damping = spring.damping * (1.0 + 2.0 * spring.drag * spring.fastest)
    quickest = max(math.sqrt(stiff / spring.mass), damping / spring.mass)
    parts = min(MAX_SUBSTEPS, max(1, math.ceil(meshes.step * quickest / MAX_STEP_RAD)))
    own = [np.ascontiguousarray(a) for a in meshes[:-1]]
    return np.asarray(_integrate(MeshLoads._make([*own, meshes.step]), spring, cos_beta, parts))


@njit(cache=True, error_model="numpy", nogil=True)
def _expected_positive(y, s):  # type: ignore[no-untyped-def]
    """Expectation of max(y, 0) for Gaussian noise s on y."""
    if y > 6.0 * s:
        return y
    if y < -6.0 * s:
        return 0.0
    z = y / s
    bell = s * math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    return y * 0.5 * math.erfc(-z / math.sqrt(2.0)) + bell


@njit(cache=True, nogil=True)
def _softplus(z):  # type: ignore[no-untyped-def]
    """ln(1 + e^z) without overflow."""
    return max(z, 0.0) + (math.log1p(math.exp(-abs(z))) if abs(z) < 36.0 else 0.0)


@njit(cache=True, nogil=True)
def _seat_force(p, q, rate):  # type: ignore[no-untyped-def]
    """Force of the seat [N] at displacement q [m] and rate [m/s]."""
    if p.width > 0.0:
        g = p.width * (_softplus((q - p.play) / p.width) - _softplus((-q - p.play) / p.width))
    else:
        g = max(q - p.play, 0.0) - max(-q - p.play, 0.0)
    spring = p.stiffness * g * (1.0 + p.growth * g * g)
    return spring + p.damping * rate * (1.0 + p.drag * abs(rate))


@njit(cache=True, error_model="numpy", nogil=True)
def _acceleration(m, p, cos_beta, at, s, q, rate):  # type: ignore[no-untyped-def]
    """Acceleration [m/s^2] at the fraction s between samples ``at`` and ``at`` + 1."""
    load, to = 0.0, min(at + 1, len(m.x) - 1)
    for j in range(m.x.shape[1]):
        y = m.x[at, j] + s * (m.x[to, j] - m.x[at, j]) - cos_beta * q
        w = m.v[at, j] + s * (m.v[to, j] - m.v[at, j]) - cos_beta * rate
        f = _expected_positive(y - m.plus[at, j], m.noise[j]) - _expected_positive(
            -y - m.minus[at, j], m.noise[j]
        )
        k = m.k[at, j] + s * (m.k[to, j] - m.k[at, j])
        load += k * f + m.c[at, j] * w + m.extra_force[at, j]
    hold = _seat_force(p, q, rate)
    under = m.rest[at] + s * (m.rest[to] - m.rest[at]) + hold
    return (cos_beta * load - hold) / p.mass - under / p.under


@njit(cache=True, error_model="numpy", nogil=True)
def _integrate(m, p, cos_beta, parts):  # type: ignore[no-untyped-def]
    """(n, 2) displacement and rate, ``parts`` steps per sample."""
    n = len(m.x)
    out = np.zeros((n, 2))
    # Equilibrium at the first sample by bisection: acceleration decreases with q.
    low, high = -1e-3, 1e-3
    for _ in range(60):
        q = 0.5 * (low + high)
        if _acceleration(m, p, cos_beta, 0, 0.0, q, 0.0) > 0.0:
            low = q
        else:
            high = q
    rate, h = 0.0, m.step / parts
    for i in range(n):
        out[i, 0], out[i, 1] = q, rate
        if i + 1 == n:
            break
        for part in range(parts):
            s0, s1, s2 = part / parts, (part + 0.5) / parts, (part + 1.0) / parts
            a1 = _acceleration(m, p, cos_beta, i, s0, q, rate)
            q2, r2 = q + 0.5 * h * rate, rate + 0.5 * h * a1
            a2 = _acceleration(m, p, cos_beta, i, s1, q2, r2)
            q3, r3 = q + 0.5 * h * r2, rate + 0.5 * h * a2
            a3 = _acceleration(m, p, cos_beta, i, s1, q3, r3)
            q4, r4 = q + h * r3, rate + h * a3
            a4 = _acceleration(m, p, cos_beta, i, s2, q4, r4)
            q += h * (rate + 2.0 * r2 + 2.0 * r3 + r4) / 6.0
            rate += h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0
        # Reset a diverged trial.
        if not abs(q) < DIVERGED_M:
            q, rate = 0.0, 0.0
    return out
