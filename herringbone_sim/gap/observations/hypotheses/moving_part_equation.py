"""Equation of motion of a part on a spring seat: acceleration and its slopes; compiled.

The displacement q of the part reduces the displacements of its meshes to x - q cos beta. For the
arguments see ``moving_part_motion``.
"""

from __future__ import annotations

import math

from numba import njit

MAX_EXPONENT = 300.0  # neither e^300 nor its reciprocal leaves the range of numbers


@njit(cache=True, error_model="numpy", nogil=True)
def _half_contact(over, noise):  # type: ignore[no-untyped-def]
    """Expectation [m] of max(g, 0), g Gaussian of mean ``over`` and sd ``noise``, and its slope.

    The noise of x matters near the ends of the backlash alone: beyond 6 sd it is left out.
    """
    if over > 6.0 * noise:
        return over, 1.0
    if over < -6.0 * noise:
        return 0.0, 0.0
    z = over / noise
    bell = math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    slope = 0.5 * math.erfc(-z / math.sqrt(2.0))
    return noise * bell + over * slope, slope


@njit(cache=True, error_model="numpy", nogil=True)
def _seat_force(p, q, rate, by_p):  # type: ignore[no-untyped-def]
    """Force [N] that resists displacement q [m] and rate [m/s], and its slopes by q and by rate.

    p: fields of ``SeatSpring``; by_p: filled in with the slopes by these, unless it is empty.
    """
    stiffness, damping, play, width, growth, drag, film = p[2], p[3], p[4], p[5], p[6], p[7], p[8]
    if width * MAX_EXPONENT > max(play, abs(q)):
        # width [ln(1 + e^a) - ln(1 + e^b)], a and b = (+-q - play) / width
        e, out = math.exp(q / width), math.exp(-play / width)
        g = width * math.log((1.0 + out * e) / (1.0 + out / e))
        right, left = out * e / (1.0 + out * e), out / e / (1.0 + out / e)
        right_slope, left_slope = right * (1.0 - right) / width, left * (1.0 - left) / width
        g_by_width = (g - right * (q - play) - left * (q + play)) / width
        held_by_width = (left_slope * (q + play) - right_slope * (q - play)) / width
    else:
        g = max(q - play, 0.0) - max(-q - play, 0.0)
        right, left = 1.0 if q > play else 0.0, 1.0 if -q >= play else 0.0
        right_slope, left_slope, g_by_width, held_by_width = 0.0, 0.0, 0.0, 0.0
    held = right + left
    hardened, dragged = growth * g * g, drag * abs(rate)
    oil = film + (1.0 - film) * held
    resisted = damping * rate * (1.0 + dragged)  # by the damper, where film is 1
    by_g, by_held = stiffness * (1.0 + 3.0 * hardened), resisted * (1.0 - film)
    if by_p.size:
        by_p[2] = g * (1.0 + hardened)
        by_p[3] = rate * (1.0 + dragged) * oil
        by_p[4] = by_g * (left - right) - by_held * (right_slope + left_slope)
        by_p[5] = by_g * g_by_width + by_held * held_by_width
        by_p[6] = stiffness * g * g * g
        by_p[7] = damping * rate * abs(rate) * oil
        by_p[8] = resisted * (1.0 - held)
    force = stiffness * g * (1.0 + hardened) + resisted * oil
    by_q = by_g * held + by_held * (right_slope - left_slope)
    return force, by_q, damping * (1.0 + 2.0 * dragged) * oil


@njit(cache=True, error_model="numpy", nogil=True)
def acceleration(springs, loads, p, cos_beta, s, y, by_p):  # type: ignore[no-untyped-def]
    """Acceleration [m/s^2] of a part on a seat, and its slopes by q, by rate and by s.

    Args:
        springs: (j, 7) of each mesh x, its increment to the next sample, k, its increment, both
            ends of the backlash and the noise of x.
        loads: (5,) sum over the meshes of c v and of forces independent of the motion, its
            increment to the next sample, sum of c, ``MeshLoads.rest`` and its increment.
        p: fields of ``SeatSpring``.
        s: time since the sample, as a fraction of the step to the next.
        y: (2,) displacement [m] and rate [m/s].
        by_p: (fields of p or 0,) filled in with the slopes by p; those by the masses stay.
    """
    q, rate = y[0], y[1]
    pushed, by_s, stiffness = loads[0] + s * loads[1] - cos_beta * loads[2] * rate, loads[1], 0.0
    for j in range(springs.shape[0]):
        x = springs[j, 0] + s * springs[j, 1] - cos_beta * q
        front, front_slope = _half_contact(x - springs[j, 4], springs[j, 6])
        back, back_slope = _half_contact(-x - springs[j, 5], springs[j, 6])
        k = springs[j, 2] + s * springs[j, 3]
        pushed += k * (front - back)
        stiffness += k * (front_slope + back_slope)
        by_s += springs[j, 3] * (front - back) + k * (front_slope + back_slope) * springs[j, 1]
    held, held_by_q, held_by_rate = _seat_force(p, q, rate, by_p)
    lightness = 1.0 / p[0] + 1.0 / p[1]
    for i in range(2, by_p.size):
        by_p[i] *= -lightness
    return (
        cos_beta * pushed / p[0] - (loads[3] + s * loads[4]) / p[1] - held * lightness,
        -cos_beta * cos_beta * stiffness / p[0] - held_by_q * lightness,
        -cos_beta * cos_beta * loads[2] / p[0] - held_by_rate * lightness,
        cos_beta * by_s / p[0] - loads[4] / p[1],
    )
