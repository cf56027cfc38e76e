"""The gear once more from Newton's law and plain NumPy: masses, a mesh matrix, nothing shared.

Bodies (s_L, s_R, c, planets) with u = r_b theta; meshes x = J u - e as Eqs. (15), (16) say.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Gear:
    """Dimensionless (Eq. 17): J (12, 9); inverse masses and loads (9,); the meshes' own (12,)."""

    J: np.ndarray
    inverse_mass: np.ndarray
    load: np.ndarray
    k: np.ndarray
    c: np.ndarray
    b: np.ndarray
    e: np.ndarray
    phi_a: np.ndarray
    phi_b: np.ndarray
    share: float
    Omega: float

    def accelerations(self, x, v, tau):
        """x'' (12,) of Eqs. (12)-(16) with one harmonic of k and of e."""
        phase = self.Omega * tau
        k = self.k * (1.0 + self.share * np.cos(phase + self.phi_a))
        f = np.sign(x) * np.maximum(np.abs(x) - self.b, 0.0)
        bodies = self.inverse_mass * (self.load - self.J.T @ (k * f + self.c * v))
        return self.J @ bodies + self.e * self.Omega**2 * np.sin(phase + self.phi_b)

    def slope(self, tau, z):
        x, v = np.split(z, 2)
        return np.concatenate([v, self.accelerations(x, v, tau)])

    def linear(self):
        """Matrix (27, 27) of (x, v, 1, sin, cos of Omega tau): no backlash, constant k."""
        A = np.zeros((27, 27))
        flexibility = self.J @ (self.inverse_mass[:, None] * self.J.T)
        A[:12, 12:24] = np.eye(12)
        A[12:24, :12] = -flexibility * self.k
        A[12:24, 12:24] = -flexibility * self.c
        A[12:24, 24] = self.J @ (self.inverse_mass * self.load)
        A[12:24, 25] = self.e * self.Omega**2 * np.cos(self.phi_b)
        A[12:24, 26] = self.e * self.Omega**2 * np.sin(self.phi_b)
        A[25, 26], A[26, 25] = self.Omega, -self.Omega
        return A


def mesh_matrix(cos_beta):
    """J (12, 9): x_sp = (u_s - u_p - u_c) cos beta, x_rp = (u_p - u_c) cos beta."""
    J = np.zeros((12, 9))
    for side in range(2):
        for i in range(3):
            m = 3 * side + i
            J[m, [side, 2, 3 + m]] = 1.0, -1.0, -1.0
            J[6 + m, [2, 3 + m]] = -1.0, 1.0
    return J * cos_beta


def gear(model):
    """Same gear as a full model of three planets with one harmonic, from its parameter set."""
    p = model.parameters
    cos_beta = np.cos(np.radians(p.beta))
    cos_alpha_t = np.cos(np.arctan(np.tan(np.radians(p.alpha_n)) / cos_beta))
    r_s, r_p = (0.5 * p.m_n / cos_beta * z * cos_alpha_t for z in (p.z_s, p.z_p))
    r_c = r_s + r_p
    M_s, M_p, M_c = p.I_s / r_s**2, p.I_p / r_p**2, p.I_c / r_c**2 + 3.0 * p.m_p
    omega_n = np.sqrt(p.k_m_sp * (1.0 / M_s + 1.0 / M_p))
    M = np.concatenate([M_s * np.resize(p.I_s_factor, 2), [M_c], M_p * np.resize(p.I_p_factor, 6)])
    force = np.zeros(9)
    force[:2] = p.T_1 / 2.0 / r_s
    force[2] = -2.0 * p.T_1 / r_s
    return Gear(
        J=mesh_matrix(cos_beta),
        inverse_mass=1.0 / M,
        load=force / (p.b_c * omega_n**2),
        k=np.repeat([p.k_m_sp, p.k_m_rp], 6) * np.resize(p.k_factor, 12) / omega_n**2,
        c=model.damping_n_s_per_m / omega_n,
        b=model.half_backlash_m / p.b_c,
        e=p.e_m * np.resize(p.e_factor, 12),
        phi_a=np.resize(p.phi_a, 12),
        phi_b=np.resize(p.phi_b, 12),
        share=p.k_amp[0] if p.k_amp else 0.0,
        Omega=p.Omega,
    )
