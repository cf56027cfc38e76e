"""Motion of a part on its own seat, driven by the meshes that it carries; compiled.

The meshes' displacements are measured, the part's own is not: its equation of motion has the force
law of its meshes in it, taken at the displacement that the part leaves them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

TURN = 1.25  # radians of its fastest oscillation that a step may span: 2.8 would not be stable
MOST_PARTS = 40  # of a step, whatever a trial asks for


@dataclass(frozen=True)
class Meshes:
    """What pushes a part: meshes of one run at equal steps; arrays (n, j).

    Attributes:
        x, v: displacement [m] and rate [m/s] as if the part were rigid.
        k, c: stiffness [N/m] and damping [N s/m].
        plus, minus: half-backlash on both flanks [m].
        more: further force [N].
        noise: (j,) of x [m].
        rest: (n,) force [N] on what the part sits in, without the part's own.
        step: [s].
    """

    x: Array
    v: Array
    k: Array
    c: Array
    plus: Array
    minus: Array
    more: Array
    noise: Array
    rest: Array
    step: float


@dataclass(frozen=True)
class Spring:
    """A part and its seat.

    Attributes:
        mass: [kg].
        under: mass of what the part sits in [kg], infinite where that is fixed.
        stiffness: [N/m].
        damping: [N s/m].
        play: way to either side without force [m].
        width: rounding of the ends of the play [m].
        growth: of the stiffness with the square of the deflection [1/m^2].
        drag: of the damping with the rate [s/m].
        farthest, fastest: deflection [m] and rate [m/s] up to which steps are fine enough.
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


def motion(meshes: Meshes, spring: Spring, cos_beta: float) -> Array:
    """(n, 2) displacement [m] and rate [m/s] of a part, from rest in balance on.

    M q'' = cos beta sum F(x - q cos beta) - H (1 + M / M_u) - rest M / M_u, by Runge and Kutta.
    """
    stiff = spring.stiffness * (1.0 + 3.0 * spring.growth * spring.farthest**2)
    stiff += cos_beta**2 * float(np.max(meshes.k.sum(axis=1)))
    damping = spring.damping * (1.0 + 2.0 * spring.drag * spring.fastest)
    quickest = max(math.sqrt(stiff / spring.mass), damping / spring.mass)
    parts = min(MOST_PARTS, max(1, math.ceil(meshes.step * quickest / TURN)))
    own = np.array(
        [
            1.0 / spring.mass,
            1.0 / spring.under,
            spring.stiffness,
            spring.damping,
            spring.play,
            spring.width,
            spring.growth,
            spring.drag,
            cos_beta,
        ]
    )
    m = meshes
    arrays = (m.x, m.v, m.k, m.c, m.plus, m.minus, m.more, m.noise, m.rest)
    return np.asarray(_integrate(*(np.ascontiguousarray(a) for a in arrays), own, m.step, parts))


@njit(cache=True, error_model="numpy")
def _over(y, s):  # type: ignore[no-untyped-def]
    """Expectation of max(y, 0) with noise s on y."""
    if y > 6.0 * s:
        return y
    if y < -6.0 * s:
        return 0.0
    z = y / s
    return y * 0.5 * math.erfc(-z / math.sqrt(2.0)) + s * math.exp(-0.5 * z * z) / math.sqrt(
        2.0 * math.pi
    )


@njit(cache=True)
def _rise(z):  # type: ignore[no-untyped-def]
    """ln(1 + e^z), for any z."""
    return max(z, 0.0) + (math.log1p(math.exp(-abs(z))) if abs(z) < 36.0 else 0.0)


@njit(cache=True)
def _hold(own, q, rate):  # type: ignore[no-untyped-def]
    """Force [N] of the seat."""
    play, width = own[4], own[5]
    if width > 0.0:
        g = width * (_rise((q - play) / width) - _rise((-q - play) / width))
    else:
        g = max(q - play, 0.0) - max(-q - play, 0.0)
    return own[2] * g * (1.0 + own[6] * g * g) + own[3] * rate * (1.0 + own[7] * abs(rate))


@njit(cache=True, error_model="numpy")
def _acceleration(at, next_, s, arrays, noise, rest, own, q, rate):  # type: ignore[no-untyped-def]
    """Acceleration, s of the way from one point to the next."""
    x, v, k, c, plus, minus, more = arrays
    cos_beta, load = own[8], 0.0
    for j in range(x.shape[1]):
        y = x[at, j] + s * (x[next_, j] - x[at, j]) - cos_beta * q
        w = v[at, j] + s * (v[next_, j] - v[at, j]) - cos_beta * rate
        f = _over(y - plus[at, j], noise[j]) - _over(-y - minus[at, j], noise[j])
        load += (k[at, j] + s * (k[next_, j] - k[at, j])) * f + c[at, j] * w + more[at, j]
    hold = _hold(own, q, rate)
    under = rest[at] + s * (rest[next_] - rest[at]) + hold
    return (cos_beta * load - hold) * own[0] - under * own[1]


@njit(cache=True, error_model="numpy")
def _integrate(x, v, k, c, plus, minus, more, noise, rest, own, step, parts):  # type: ignore[no-untyped-def]
    n = len(x)
    arrays = (x, v, k, c, plus, minus, more)
    out = np.zeros((n, 2))
    # Balance of the first point: the acceleration falls with q.
    low, high = -1e-3, 1e-3
    for _ in range(60):
        q = 0.5 * (low + high)
        if _acceleration(0, 0, 0.0, arrays, noise, rest, own, q, 0.0) > 0.0:
            low = q
        else:
            high = q
    rate, h = 0.0, step / parts
    for i in range(n):
        out[i, 0], out[i, 1] = q, rate
        if i + 1 == n:
            break
        for part in range(parts):
            s0, s1, s2 = part / parts, (part + 0.5) / parts, (part + 1.0) / parts
            a1 = _acceleration(i, i + 1, s0, arrays, noise, rest, own, q, rate)
            q2, r2 = q + 0.5 * h * rate, rate + 0.5 * h * a1
            a2 = _acceleration(i, i + 1, s1, arrays, noise, rest, own, q2, r2)
            q3, r3 = q + 0.5 * h * r2, rate + 0.5 * h * a2
            a3 = _acceleration(i, i + 1, s1, arrays, noise, rest, own, q3, r3)
            q4, r4 = q + h * r3, rate + h * a3
            a4 = _acceleration(i, i + 1, s2, arrays, noise, rest, own, q4, r4)
            q += h * (rate + 2.0 * r2 + 2.0 * r3 + r4) / 6.0
            rate += h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0
        if not abs(q) < 1e-2:
            q, rate = 0.0, 0.0
    return out
