"""Integrate the motion of a part on a spring seat, driven by the meshes that it carries; compiled.

Mesh displacements x are recorded as if the part were rigid. Its displacement q is not recorded and
reduces them to x - q cos beta, so the mesh forces in its equation of motion depend on q.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from herringbone_sim.arrays import Array

MAX_STEP_RAD = 1.25  # phase of the fastest oscillation per step; stability limit 2.8; chosen
MAX_SUBSTEPS = 40  # largest number of steps per sample, chosen for run time
MAX_EXPONENT = 300.0  # neither e^300 nor its reciprocal leaves the range of numbers
DIVERGED_M = 1e-2  # displacement at which the integration is reset; 100 times b_c


class MeshLoads(NamedTuple):
    """Motion and force law of the j meshes that drive a part, at n equal steps; arrays (n, j).

    Attributes:
        x, v: displacement [m] and rate [m/s] as if the part were rigid.
        k, c: stiffness [N/m] and damping [N s/m].
        plus, minus: half-backlash on both flanks [m].
        extra_force: force independent of the motion [N].
        noise: (j,) standard deviation of the noise of x [m].
        rest: (n,) force [N] on the body that carries the part, without that of the seat.
        step: time between samples [s].
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
        film: damping inside the play over that at its ends.
        farthest, fastest: deflection [m] and rate [m/s] for which the time step is chosen.
    """

    mass: float
    under: float
    stiffness: float
    damping: float
    play: float = 0.0
    width: float = 0.0
    growth: float = 0.0
    drag: float = 0.0
    film: float = 1.0
    farthest: float = 0.0
    fastest: float = 0.0


def motions(meshes: MeshLoads, springs: Sequence[SeatSpring], cos_beta: float) -> Array:
    """Displacement [m] and rate [m/s] (L, n, 2) of a part on each of L seats.

    M q'' = cos beta sum F(x - q cos beta) - H (1 + M / M_u) - rest M / M_u with seat force H and
    mass M_u of the carrying body, by Runge-Kutta 4, starting at rest in the equilibrium of the
    first sample. All seats use the time step that the stiffest needs. A motion beyond
    ``DIVERGED_M`` is reset to zero.
    """
    k = float(np.max(meshes.k.sum(axis=1)))
    parts = max(_steps_per_sample(spring, k, cos_beta, meshes.step) for spring in springs)
    own = [np.ascontiguousarray(a) for a in meshes[:-1]]
    return np.asarray(
        _integrate(MeshLoads._make([*own, meshes.step]), np.array(springs), cos_beta, parts)
    )


def _steps_per_sample(spring: SeatSpring, k: float, cos_beta: float, step_s: float) -> int:
    """Time steps per sample for a seat loaded by meshes of total stiffness k [N/m]."""
    stiff = spring.stiffness * (1.0 + 3.0 * spring.growth * spring.farthest**2) + cos_beta**2 * k
    damping = spring.damping * max(1.0, spring.film)
    damping *= 1.0 + 2.0 * spring.drag * spring.fastest
    quickest = max(math.sqrt(stiff / spring.mass), damping / spring.mass)
    return min(MAX_SUBSTEPS, max(1, math.ceil(step_s * quickest / MAX_STEP_RAD)))


@njit(cache=True, error_model="numpy", nogil=True)
def _rounding(z):  # type: ignore[no-untyped-def]
    """Expectation of max(g, 0) for Gaussian g of mean z and deviation 1, minus max(z, 0)."""
    a = abs(z)
    bell = math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    return bell - 0.5 * a * math.erfc(a / math.sqrt(2.0))


@njit(cache=True, error_model="numpy", nogil=True)
def _seat_force(p, q, rate):  # type: ignore[no-untyped-def]
    """Force [N] that resists displacement q [m] and rate [m/s]; p: fields of ``SeatSpring``."""
    stiffness, damping, play, width, growth, drag, film = p[2], p[3], p[4], p[5], p[6], p[7], p[8]
    if width * MAX_EXPONENT > max(play, abs(q)):
        # width [ln(1 + e^a) - ln(1 + e^b)], a and b = (+-q - play) / width
        e, out = math.exp(q / width), math.exp(-play / width)
        g = width * math.log((1.0 + out * e) / (1.0 + out / e))
        held = out * e / (1.0 + out * e) + out / e / (1.0 + out / e)
    else:
        g = max(q - play, 0.0) - max(-q - play, 0.0)
        held = 1.0 if g != 0.0 else 0.0
    spring = stiffness * g * (1.0 + growth * g * g)
    return spring + damping * rate * (1.0 + drag * abs(rate)) * (film + (1.0 - film) * held)


@njit(cache=True, error_model="numpy", nogil=True)
def _interpolate(m, at, s, x, v, k):  # type: ignore[no-untyped-def]
    """Interpolate x, v and k (j,), in place, at the fraction s between samples ``at`` and
    ``at`` + 1; return ``MeshLoads.rest`` there [N].
    """
    to = min(at + 1, m.x.shape[0] - 1)
    for j in range(m.x.shape[1]):
        x[j] = m.x[at, j] + s * (m.x[to, j] - m.x[at, j])
        v[j] = m.v[at, j] + s * (m.v[to, j] - m.v[at, j])
        k[j] = m.k[at, j] + s * (m.k[to, j] - m.k[at, j])
    return m.rest[at] + s * (m.rest[to] - m.rest[at])


@njit(cache=True, error_model="numpy", nogil=True)
def _accelerate(m, p, cos_beta, at, x, v, k, rest, q, rate, out):  # type: ignore[no-untyped-def]
    """Write to ``out`` (L,) the accelerations [m/s^2] of a part on L seats at q, ``rate`` (L,).

    x, v, k and ``rest`` are those of ``_interpolate``; other terms are those of sample ``at``.
    """
    L = len(q)
    out[:] = 0.0
    for j in range(len(x)):
        plus, minus, noise = m.plus[at, j], m.minus[at, j], m.noise[j]
        c, extra = m.c[at, j], m.extra_force[at, j]
        for i in range(L):
            y = x[j] - cos_beta * q[i]
            f = max(y - plus, 0.0) - max(-y - minus, 0.0)
            out[i] += k[j] * f + c * (v[j] - cos_beta * rate[i]) + extra
        # Expectation over the noise of x, which matters near the ends of the backlash alone.
        near = 6.0 * noise
        for i in range(L):
            y = x[j] - cos_beta * q[i]
            if abs(y - plus) < near:
                out[i] += k[j] * noise * _rounding((y - plus) / noise)
            if abs(y + minus) < near:
                out[i] -= k[j] * noise * _rounding((y + minus) / noise)
    for i in range(L):
        hold = _seat_force(p[i], q[i], rate[i])
        out[i] = (cos_beta * out[i] - hold) / p[i, 0] - (rest + hold) / p[i, 1]


@njit(cache=True, error_model="numpy", nogil=True)
def _integrate(m, p, cos_beta, parts):  # type: ignore[no-untyped-def]
    """Displacement and rate (L, n, 2) on seats p (L, fields of ``SeatSpring``), see ``motions``.

    Args:
        parts: time steps per sample.
    """
    n, L = m.x.shape[0], p.shape[0]
    motion = np.empty((L, n, 2))
    x, v, k = np.empty((3, m.x.shape[1]))
    q, rate, q2, r2, q3, r3, q4, r4, a1, a2, a3, a4 = np.zeros((12, L))
    # Equilibrium at the first sample by bisection: acceleration decreases with q.
    low, high = np.full(L, -1e-3), np.full(L, 1e-3)
    rest = _interpolate(m, 0, 0.0, x, v, k)
    for _ in range(60):
        q[:] = 0.5 * (low + high)
        _accelerate(m, p, cos_beta, 0, x, v, k, rest, q, rate, a1)
        for i in range(L):
            if a1[i] > 0.0:
                low[i] = q[i]
            else:
                high[i] = q[i]
    h = m.step / parts
    for at in range(n):
        motion[:, at, 0], motion[:, at, 1] = q, rate
        if at + 1 == n:
            break
        for part in range(parts):
            rest = _interpolate(m, at, part / parts, x, v, k)
            _accelerate(m, p, cos_beta, at, x, v, k, rest, q, rate, a1)
            for i in range(L):
                q2[i], r2[i] = q[i] + 0.5 * h * rate[i], rate[i] + 0.5 * h * a1[i]
            rest = _interpolate(m, at, (part + 0.5) / parts, x, v, k)
            _accelerate(m, p, cos_beta, at, x, v, k, rest, q2, r2, a2)
            for i in range(L):
                q3[i], r3[i] = q[i] + 0.5 * h * r2[i], rate[i] + 0.5 * h * a2[i]
            _accelerate(m, p, cos_beta, at, x, v, k, rest, q3, r3, a3)
            for i in range(L):
                q4[i], r4[i] = q[i] + h * r3[i], rate[i] + h * a3[i]
            rest = _interpolate(m, at, (part + 1.0) / parts, x, v, k)
            _accelerate(m, p, cos_beta, at, x, v, k, rest, q4, r4, a4)
            for i in range(L):
                q[i] += h * (rate[i] + 2.0 * r2[i] + 2.0 * r3[i] + r4[i]) / 6.0
                rate[i] += h * (a1[i] + 2.0 * a2[i] + 2.0 * a3[i] + a4[i]) / 6.0
        for i in range(L):  # reset a diverged trial
            if not abs(q[i]) < DIVERGED_M:
                q[i], rate[i] = 0.0, 0.0
    return motion
