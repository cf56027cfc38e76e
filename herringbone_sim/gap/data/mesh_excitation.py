"""Nominal stiffness and mesh error at the recorded mesh phase."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model


@dataclass(frozen=True)
class Waves:
    """Nominal stiffness and mesh error at every sample of a run.

    Attributes:
        k: (n, n_mesh) stiffness k(t) [N/m], Eqs. (7), (8).
        e, e_rate: (n, n_mesh) mesh error [m] and its time derivative [m/s], Eqs. (9), (10).
    """

    k: Array
    e: Array
    e_rate: Array


def waves(model: Model, phase: Array, omega_rad_per_s: float, e_share: float = 1.0) -> Waves:
    """Evaluate the nominal stiffness k(t), the mesh error e(t) and its time derivative.

    Args:
        model: nominal model at the operating point.
        phase: (n,) mesh phase [rad].
        omega_rad_per_s: mesh frequency [rad/s], for the derivative.
        e_share: factor on the harmonics of e(t), not on its mean; below 1 where a low-pass filter
            attenuates e(t) in the recorded displacements.
    """
    p, s = model.packed, model.scales
    orders = np.arange(1, max(len(p.k_cos), len(p.e_cos)) + 1)
    cos, sin = np.cos(np.outer(phase, orders)), np.sin(np.outer(phase, orders))
    e_cos, e_sin = e_share * p.e_cos, e_share * p.e_sin
    h, i = len(p.k_cos), len(p.e_cos)
    per_m = s.omega_n**2 / s.projection
    k = p.stiffness + cos[:, :h] @ p.k_cos + sin[:, :h] @ p.k_sin
    turn = omega_rad_per_s * orders[:i]
    rate = (cos[:, :i] * turn) @ e_sin - (sin[:, :i] * turn) @ e_cos
    e = p.e_mean + cos[:, :i] @ e_cos + sin[:, :i] @ e_sin
    return Waves(k * per_m, e * s.b_c, rate * s.b_c)
