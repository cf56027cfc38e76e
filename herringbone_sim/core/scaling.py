"""Scales of the dimensionless equations, Eq. (17), and the masses and radii in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from herringbone_sim.core.parameters import Parameters


@dataclass(frozen=True)
class Scales:
    """Geometry, equivalent masses and scales of a gear, SI units.

    Attributes:
        m_t: transverse module [m].
        cos_beta: cosine of the helix angle.
        r_bs, r_bp, r_br, r_bc: base radii [m]; r_bc = r_bs + r_bp is the only carrier radius for
            which a rigid rotation has the ratio 1 + z_r / z_s.
        M_s, M_p, M_c, M_r: equivalent masses I / r_b^2 [kg] (the paper's I / r_b is a misprint);
            M_c contains the planets, I_ce = I_c + N m_p r_bc^2.
        omega_n: natural frequency [rad/s], Eq. (17); misprint corrected: k_m multiplies the sum of
            inverse masses, sqrt(k_m (1 / M_s + 1 / M_p)).
        b_c: displacement scale [m].
        T_2: output torque [N m].
        projection: factor on the mesh terms of Eq. (18): cos^2 beta, or 1 with ``projection:
            torque``.
    """

    m_t: float
    cos_beta: float
    r_bs: float
    r_bp: float
    r_br: float
    r_bc: float
    M_s: float
    M_p: float
    M_c: float
    M_r: float
    omega_n: float
    b_c: float
    T_2: float
    projection: float

    @property
    def velocity_m_per_s(self) -> float:
        """SI value of dx/dtau = 1."""
        return self.b_c * self.omega_n

    @property
    def acceleration_m_per_s2(self) -> float:
        """SI value of d2x/dtau2 = 1."""
        return self.b_c * self.omega_n**2

    def base_radius(self, body: str) -> float:
        """Return the base radius [m] of a body, such as ``s_L``, ``c`` or ``p1_R``."""
        return {"s": self.r_bs, "c": self.r_bc, "p": self.r_bp}[body[0]]

    def control_torque_n_m(self, K: float) -> float:
        """Return the torque amplitude on the carrier [N m] that subtracts K from every relative
        acceleration.
        """
        return self.M_c * self.r_bc * K * self.acceleration_m_per_s2 / self.cos_beta


def scales(p: Parameters) -> Scales:
    """Return geometry, masses and scales of a parameter set (Table 1, Eqs. 11, 12, 17)."""
    cos_beta = float(np.cos(np.radians(p.beta)))
    m_t = p.m_n / cos_beta
    cos_alpha_t = float(np.cos(np.arctan(np.tan(np.radians(p.alpha_n)) / cos_beta)))
    r_bs, r_bp, r_br = (m_t * z / 2.0 * cos_alpha_t for z in (p.z_s, p.z_p, p.z_r))
    r_bc = r_bs + r_bp
    M_s = p.I_s / r_bs**2
    M_p = p.I_p / r_bp**2
    return Scales(
        m_t=m_t,
        cos_beta=cos_beta,
        r_bs=r_bs,
        r_bp=r_bp,
        r_br=r_br,
        r_bc=r_bc,
        M_s=M_s,
        M_p=M_p,
        M_c=(p.I_c + p.n_planets * p.m_p * r_bc**2) / r_bc**2,
        M_r=p.I_r / r_br**2,
        omega_n=float(p.omega_n or np.sqrt(p.k_m_sp * (1.0 / M_s + 1.0 / M_p))),
        b_c=p.b_c,
        T_2=p.T_2 or 2.0 * p.T_1 * r_bc / r_bs,
        projection=cos_beta**2 if p.projection == "mesh_and_torque" else 1.0,
    )
