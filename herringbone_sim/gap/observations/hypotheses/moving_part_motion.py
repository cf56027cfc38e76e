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
def _acceleration(springs, loads, p, cos_beta, s, q, rate):  # type: ignore[no-untyped-def]
    """Acceleration [m/s^2] of a part on a seat at displacement q [m] and ``rate`` [m/s].

    Args:
        springs: (j, 7) of each mesh x, its increment to the next sample, k, its increment, both
            ends of the backlash and the noise of x.
        loads: (5,) sum over the meshes of c v and of forces independent of the motion, its
            increment to the next sample, sum of c, ``MeshLoads.rest`` and its increment.
        p: fields of ``SeatSpring``.
        s: time since the sample, as a fraction of the step to the next.
    """
    pushed = loads[0] + s * loads[1] - cos_beta * loads[2] * rate
    for j in range(springs.shape[0]):
        y = springs[j, 0] + s * springs[j, 1] - cos_beta * q
        above, below = y - springs[j, 4], -y - springs[j, 5]
        f = max(above, 0.0) - max(below, 0.0)
        # Expectation over the noise of x, which matters near the ends of the backlash alone.
        noise = springs[j, 6]
        if abs(above) < 6.0 * noise:
            f += noise * _rounding(above / noise)
        if abs(below) < 6.0 * noise:
            f -= noise * _rounding(below / noise)
        pushed += (springs[j, 2] + s * springs[j, 3]) * f
    hold = _seat_force(p, q, rate)
    return (cos_beta * pushed - hold) / p[0] - (loads[3] + s * loads[4] + hold) / p[1]


@njit(cache=True, error_model="numpy", nogil=True)
def _begin_step(m, at, springs, loads):  # type: ignore[no-untyped-def]
    """Fill in ``springs`` and ``loads`` of ``_acceleration`` for the step from sample ``at``.

    The backlash, c and forces independent of the motion are those of this sample.
    """
    to = min(at + 1, m.x.shape[0] - 1)
    loads[:] = 0.0
    for j in range(m.x.shape[1]):
        springs[j, 0], springs[j, 1] = m.x[at, j], m.x[to, j] - m.x[at, j]
        springs[j, 2], springs[j, 3] = m.k[at, j], m.k[to, j] - m.k[at, j]
        springs[j, 4], springs[j, 5] = m.plus[at, j], m.minus[at, j]
        springs[j, 6] = m.noise[j]
        c = m.c[at, j]
        loads[0] += c * m.v[at, j] + m.extra_force[at, j]
        loads[1] += c * (m.v[to, j] - m.v[at, j])
        loads[2] += c
    loads[3], loads[4] = m.rest[at], m.rest[to] - m.rest[at]


@njit(cache=True, error_model="numpy", nogil=True)
def _integrate(m, p, cos_beta, parts):  # type: ignore[no-untyped-def]
    """Displacement and rate (L, n, 2) on seats p (L, fields of ``SeatSpring``), see ``motions``.

    Args:
        parts: time steps per sample.
    """
    n, L = m.x.shape[0], p.shape[0]
    motion = np.empty((L, n, 2))
    springs, loads = np.empty((m.x.shape[1], 7)), np.empty(5)
    # Equilibrium at the first sample by bisection: acceleration decreases with q.
    _begin_step(m, 0, springs, loads)
    for i in range(L):
        low, high = -1e-3, 1e-3
        for _ in range(60):
            q = 0.5 * (low + high)
            if _acceleration(springs, loads, p[i], cos_beta, 0.0, q, 0.0) > 0.0:
                low = q
            else:
                high = q
        motion[i, 0] = 0.5 * (low + high), 0.0
    h = m.step / parts
    for at in range(n - 1):
        _begin_step(m, at, springs, loads)
        for i in range(L):
            seat = p[i]
            q, rate = motion[i, at]
            for part in range(parts):
                s, middle, end = part / parts, (part + 0.5) / parts, (part + 1.0) / parts
                a1 = _acceleration(springs, loads, seat, cos_beta, s, q, rate)
                q2, r2 = q + 0.5 * h * rate, rate + 0.5 * h * a1
                a2 = _acceleration(springs, loads, seat, cos_beta, middle, q2, r2)
                q3, r3 = q + 0.5 * h * r2, rate + 0.5 * h * a2
                a3 = _acceleration(springs, loads, seat, cos_beta, middle, q3, r3)
                q4, r4 = q + h * r3, rate + h * a3
                a4 = _acceleration(springs, loads, seat, cos_beta, end, q4, r4)
                q += h * (rate + 2.0 * r2 + 2.0 * r3 + r4) / 6.0
                rate += h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0
            if not abs(q) < DIVERGED_M:  # reset a diverged trial
                q, rate = 0.0, 0.0
            motion[i, at + 1] = q, rate
    return motion
