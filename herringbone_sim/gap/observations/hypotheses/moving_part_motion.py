"""Integrate the motion of a part on a spring seat, driven by the meshes that it carries; compiled.

Mesh displacements x are recorded as if the part were rigid. Its displacement q is not recorded and
reduces them to x - q cos beta, so the mesh forces in its equation of motion depend on q.

A seat in thick oil damps faster than the part oscillates, so the equation is stiff. It is solved
by Rodas3 (Sandu et al., Atmospheric Environment 31, 3459, 1997), a Rosenbrock method of order 3
that stays stable at any step.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from herringbone_sim.arrays import Array
from herringbone_sim.gap.observations.hypotheses.moving_part_equation import acceleration

STEP_ERROR = 0.01  # largest estimated error of a step, relative to the noise of x, chosen so that
# the errors of all steps stay below the noise
LEAST_NOISE = 1e-3  # relative to the RMS of x: 60 dB; steps need not be finer for less noise
MAX_STEPS = 64  # largest number of steps per sample, a power of 2, chosen for run time
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


def motions(meshes: MeshLoads, springs: Sequence[SeatSpring], cos_beta: float) -> Array:
    """Displacement [m] and rate [m/s] (L, n, 2) of a part on each of L seats.

    M q'' = cos beta sum F(x - q cos beta) - H (1 + M / M_u) - rest M / M_u with seat force H and
    mass M_u of the carrying body, starting at rest in the equilibrium of the first sample. There
    are so many steps per sample, a power of 2 up to ``MAX_STEPS``, that none makes an estimated
    error above ``STEP_ERROR`` of the largest noise of x, at least ``LEAST_NOISE``. A motion beyond
    ``DIVERGED_M`` is reset to zero.
    """
    none = np.empty((0, len(SeatSpring._fields)))
    return np.concatenate([_integrated(meshes, spring, none, cos_beta) for spring in springs])


def motion_with_slopes(
    meshes: MeshLoads, spring: SeatSpring, changes: Sequence[SeatSpring], cos_beta: float
) -> Array:
    """Motion as of ``motions`` on one seat, and its derivatives (1 + T, n, 2) along T changes.

    Args:
        changes: change of each property of the seat per unit of a parameter, a logarithm; those
            of the masses do not count. Derivatives beyond ``DIVERGED_M`` are reset to zero.
    """
    return _integrated(meshes, spring, np.array(changes), cos_beta)


def _integrated(meshes: MeshLoads, spring: SeatSpring, changes: Array, cos_beta: float) -> Array:
    """Motion and derivatives (1 + T, n, 2) along ``changes`` (T, fields of ``SeatSpring``)."""
    own = [np.ascontiguousarray(a) for a in meshes[:-1]]
    noise = max(float(meshes.noise.max()), LEAST_NOISE * float(np.sqrt(np.mean(meshes.x**2))))
    tolerance = STEP_ERROR * noise / cos_beta
    loads = MeshLoads._make([*own, meshes.step])
    return np.asarray(_integrate(loads, np.array(spring), changes, cos_beta, tolerance))


@njit(cache=True, error_model="numpy", nogil=True)
def _stepped(springs, loads, p, dp, cos_beta, s, ds, h, y, stages, by_p):  # type: ignore[no-untyped-def]
    """Take a step of Rodas3 in place, and return the estimated error [m] of the displacement.

    Tangents see the Jacobian of each stage. That the Jacobian of the step, too, changes with the
    motion and in time is left out, so tangents are of order 1.

    Args:
        springs, loads, p, cos_beta, s, by_p: as of ``acceleration``.
        dp: (T, fields of p) changes of p that the tangents belong to.
        ds, h: the step, as a fraction of that of the samples and in seconds.
        y: (1 + T, 2) displacement and rate, of the motion and of each tangent.
        stages: (4, 1 + T, 2) work.
    """
    i = 2.0 / h
    over, by_q, by_rate, by_t = 0.0, 0.0, 0.0, 0.0
    for stage in range(4):
        if stage != 1:  # the second stage is at the motion of the first
            at = s if stage == 0 else s + ds
            a, stage_by_q, stage_by_rate, by_s = acceleration(
                springs, loads, p, cos_beta, at, y[0], by_p
            )
        if stage == 0:
            by_q, by_rate, by_t = stage_by_q, stage_by_rate, by_s * ds / h
            over = i * (i - by_rate) - by_q
        for number in range(y.shape[0]):
            u, w = stages[:, number, 0], stages[:, number, 1]
            e, f = y[number, 1], a
            if number:
                f = stage_by_q * y[number, 0] + stage_by_rate * y[number, 1]
                for field in range(2, by_p.size):
                    f += by_p[field] * dp[number - 1, field]
            if stage == 1:
                e += 4.0 * u[0] / h
                f += 4.0 * w[0] / h
            elif stage:
                e += (u[0] - u[1]) / h
                f += (w[0] - w[1]) / h
            if stage == 3:
                e -= 8.0 / 3.0 * u[2] / h
                f -= 8.0 / 3.0 * w[2] / h
            if stage < 2 and not number:
                f += (0.5 if stage == 0 else 1.5) * h * by_t
            # (i - [[0, 1], [by_q, by_rate]]) (u, w) = (e, f)
            u[stage] = ((i - by_rate) * e + f) / over
            w[stage] = (by_q * e + i * f) / over
        # the motion of the next stage: 2 k_1, then k_3, at last k_4 more
        if stage:
            for number in range(y.shape[0]):
                taken, share = (0, 2.0) if stage == 1 else (stage, 1.0)
                y[number, 0] += share * stages[taken, number, 0]
                y[number, 1] += share * stages[taken, number, 1]
    return abs(stages[3, 0, 0])


@njit(cache=True, error_model="numpy", nogil=True)
def _begin_step(m, at, springs, loads):  # type: ignore[no-untyped-def]
    """Fill in ``springs`` and ``loads`` of ``acceleration`` for the step from sample ``at``.

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
def _integrate(m, p, dp, cos_beta, tolerance):  # type: ignore[no-untyped-def]
    """Motion and its derivatives (1 + T, n, 2), see ``motion_with_slopes``.

    Args:
        p: fields of ``SeatSpring``.
        dp: (T, fields) changes of p.
        tolerance: largest estimated error [m] of a step.
    """
    n, T = m.x.shape[0], dp.shape[0]
    motion = np.zeros((1 + T, n, 2))
    springs, loads = np.empty((m.x.shape[1], 7)), np.empty(5)
    y, stages = np.zeros((1 + T, 2)), np.empty((4, 1 + T, 2))
    by_p = np.zeros(p.size if T else 0)
    # Equilibrium at the first sample by bisection: acceleration decreases with q.
    _begin_step(m, 0, springs, loads)
    low, high = -1e-3, 1e-3
    for _ in range(60):
        y[0, 0] = 0.5 * (low + high)
        a, by_q, _, _ = acceleration(springs, loads, p, cos_beta, 0.0, y[0], by_p)
        if a > 0.0:
            low = y[0, 0]
        else:
            high = y[0, 0]
    motion[0, 0, 0] = 0.5 * (low + high)
    for number in range(T):
        for field in range(2, p.size):
            motion[1 + number, 0, 0] -= by_p[field] * dp[number, field] / by_q
        if not abs(motion[1 + number, 0, 0]) < DIVERGED_M:
            motion[1 + number, 0, 0] = 0.0
    steps = 1
    for at in range(n - 1):
        _begin_step(m, at, springs, loads)
        while True:
            worst, ds = 0.0, 1.0 / steps
            y[:] = motion[:, at]
            for number in range(steps):
                s, h = number * ds, m.step * ds
                error = _stepped(springs, loads, p, dp, cos_beta, s, ds, h, y, stages, by_p)
                worst = max(worst, error)
            if worst <= tolerance or steps == MAX_STEPS:
                break
            steps *= 2
        if not abs(y[0, 0]) < DIVERGED_M:  # reset a diverged trial
            y[:] = 0.0
        for number in range(1, 1 + T):  # those of a chaotic motion grow without end
            if not abs(y[number, 0]) < DIVERGED_M:
                y[number] = 0.0
        motion[:, at + 1] = y
        if worst < tolerance / 16.0 and steps > 1:  # half as many err some 8 times as much
            steps //= 2
    return motion
