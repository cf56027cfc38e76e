"""The equations of motion in plain NumPy, as in the paper; the kernel is compared with them."""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core import mesh
from herringbone_sim.core.model import Model, mean_stiffness, mesh_phases
from herringbone_sim.core.parameters import spread


def body_accelerations(model: Model, force_n: Array) -> Array:
    """Accelerations r_b d2theta/dt2 [m/s^2] of all bodies (n_bodies,), Eqs. (12)-(14).

    Args:
        force_n: (n_mesh,) mesh forces k f(x) + c v [N] of the full model.
    """
    s, p = model.scales, model.parameters
    sun, ring = force_n.reshape(2, 2, -1)
    share = model.packed.multiplicity
    M_s, M_p = 1.0 / model.packed.inv_M_s, 1.0 / model.packed.inv_M_p
    suns = (p.T_1 / 2.0 / s.r_bs - share * sun.sum(axis=1) * s.cos_beta) / M_s
    planets = (sun - ring) * s.cos_beta / M_p
    carrier = (share * force_n.sum() * s.cos_beta - s.T_2 / s.r_bc) / s.M_c
    return np.concatenate([suns, [carrier], planets.ravel()])


def reduced_accelerations(model: Model, x: Array, v: Array, phase: float) -> Array:
    """Second derivatives of (x_sp_L, x_sp_R, x_rp_L, x_rp_R), Eqs. (18) and (22), dimensionless.

    Misprints corrected: Eq. (22) writes k y for k f(y); its line of y6 contains k_sp, c_sp before
    y3, y4; the planet's part of k_rp is missing in its line of y8. Eq. (18) is correct.

    Args:
        x, v: (4,) relative displacements and velocities.
        phase: mesh phase [rad] = Omega tau.
    """
    s, p, N = model.scales, model.parameters, model.parameters.n_planets
    half = model.half_backlash_m / s.b_c
    shift = mesh_phases(p)
    waves = (a * np.cos((j + 1) * (phase + shift)) for j, a in enumerate(p.k_amp))
    k = mean_stiffness(p) * (1.0 + sum(waves))
    spring = k * mesh.backlash(x, half) / s.omega_n**2
    damper = model.damping_n_s_per_m * v / s.omega_n
    sp_L, sp_R, rp_L, rp_R = (spring + damper) * s.projection
    carrier = N * (sp_L + sp_R + rp_L + rp_R) / s.M_c
    M_s, M_p = 1.0 / model.packed.inv_M_s, 1.0 / model.packed.inv_M_p[:, 0]
    unit = s.omega_n**2 * s.b_c
    T_1_term = p.T_1 * s.cos_beta / (2.0 * s.r_bs * M_s * unit)
    T_2_term = s.T_2 * s.cos_beta / (s.r_bc * s.M_c * unit)
    e_dd = -p.e_m * p.Omega**2 * np.sin(phase + shift)
    control = p.K * np.cos(p.control_order * phase + p.control_phase)
    loads = np.array([*(T_1_term + T_2_term), T_2_term, T_2_term])
    meshes = np.array(
        [
            carrier + N * sp_L / M_s[0] + sp_L / M_p[0] - rp_L / M_p[0],
            carrier + N * sp_R / M_s[1] + sp_R / M_p[1] - rp_R / M_p[1],
            carrier - sp_L / M_p[0] + rp_L / M_p[0],
            carrier - sp_R / M_p[1] + rp_R / M_p[1],
        ]
    )
    result: Array = loads - meshes - e_dd - control * np.array(spread(p.control_on, 4))
    return result
