"""Equations of a mesh in SI units: backlash and its thermal loss, damping."""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array


def backlash(x: Array | float, b: Array | float) -> Array:
    """Return f(x), the part of x beyond the half-backlash b, Eqs. (1) and (4); same unit as x."""
    x = np.asarray(x, dtype=float)
    return np.where(x > b, x - b, np.where(x < -np.asarray(b), x + b, 0.0))


def thermal_backlash_loss(
    delta_T: float, gamma: float, m_t: float, teeth: int, alpha_w: float
) -> float:
    """Return the reduction Delta b [m] of the total backlash by a temperature rise, Eq. (2).

    Args:
        delta_T: temperature rise [K].
        gamma: coefficient of linear expansion [1/K].
        m_t: transverse module [m].
        teeth: z_s + z_p for a sun mesh. For a ring mesh the paper prints z_r + z_p, which is kept;
            the centre distance of an internal mesh would require z_r - z_p.
        alpha_w: working pressure angle alpha' [rad].
    """
    strain = delta_T * gamma
    return (
        strain * (1.0 + strain) * m_t * np.pi + m_t * strain * teeth * float(np.sin(alpha_w)) / 2.0
    )


def half_backlash(b: float, b_c: float, loss: float) -> float:
    """Return the half-backlash b' [m] after a temperature rise, Eq. (3).

    Misprint corrected: the paper subtracts metres from the dimensionless b; b b_c [m] is meant.

    Args:
        b: half-backlash before, in units of b_c.
        b_c: displacement scale [m].
        loss: reduction of the total backlash [m], Eq. (2).
    """
    return b * b_c - loss / 2.0


def damping(xi: float, k_m: float, M_1: float, M_2: float) -> float:
    """Return the mesh damping c [N s/m], Eq. (11), of equivalent masses M = I / r_b^2 [kg].

    Misprint corrected: the paper prints M = I / r_b, which is no mass.
    """
    return 2.0 * xi * float(np.sqrt(k_m / (1.0 / M_1 + 1.0 / M_2)))
