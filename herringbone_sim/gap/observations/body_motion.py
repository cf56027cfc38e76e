"""Loads, masses and rotations u [m] of all bodies, rigid rotation of the gear included."""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model, mean_stiffness
from herringbone_sim.gap.data.kinematics import bodies_to_meshes, inverse_masses
from herringbone_sim.gap.data.prepared import SHAFTS, PreparedRun
from herringbone_sim.gap.residuals.torque_balance import control_wave


def body_loads(model: Model, phase: Array) -> Array:
    """Forces (n, 9) [N] on the bodies by T_1, T_2 and the control at mesh phases (n,) [rad]."""
    p, sc = model.parameters, model.scales
    tau = np.zeros((len(phase), len(model.layout.bodies)))
    tau[:, :2] = p.T_1 / (2.0 * sc.r_bs)
    tau[:, 2] = -sc.T_2 / sc.r_bc + control_force(model, phase)
    return tau


def control_force(model: Model, phase: Array, late_rad: float = 0.0) -> Array:
    """Force (n,) [N] on the carrier by the control, see ``control_wave``."""
    sc = model.scales
    size = model.packed.K * sc.b_c * sc.omega_n**2 / sc.cos_beta * sc.M_c
    return np.asarray(size * control_wave(model, phase, late_rad))


def rigid_moment(run: PreparedRun, phase: Array) -> Array:
    """Rigid motion by the nominal control: sum of M r u (n,) over the bodies [kg m].

    M is the mass [kg] and u [m] the rotation of a body, r the rigid rotation, 1 at the carrier.
    Mesh forces do no work along r, so the second time derivative of the sum is the force of the
    control [N]. The sum is this harmonic integrated twice, without mean and trend. It follows from
    the nominal K and the order and phase of the control, not from recorded channels. It is 0 for
    a control of order 0, a constant torque, which the load of a steady rotation balances.

    Args:
        phase: (n,) recorded mesh phase [rad]; the control is evaluated ``run.delay_rad`` earlier.
    """
    turn = run.model.packed.control_order * run.omega_rad_per_s
    if turn == 0.0:
        return np.zeros(len(phase))
    return np.asarray(-control_force(run.model, phase - run.delay_rad) / turn**2)


def rigid_swing(run: PreparedRun) -> Array:
    """Rigid oscillation (n, 9) of all bodies that the control excites [m].

    Recordings of a simulator in relative coordinates lack all rigid rotation; those of a rig lack
    only its trend.
    """
    M = 1.0 / inverse_masses(run.model)
    rigid = rigid_mode(run.model)
    swing = rigid_moment(run, run.phase) / (M @ rigid**2)
    return np.asarray(swing[:, None] * rigid)


def rigid_mode(model: Model) -> Array:
    """Rigid rotation r (n_bodies,) [-] of the gear: G r = 0, 1 at the carrier, 2 at the suns."""
    rigid = np.linalg.svd(bodies_to_meshes(model))[2][-1]
    return np.asarray(rigid / rigid[2])


def static_rotations(run: PreparedRun) -> Array:
    """Static rotations (9,) [m] under the torques, for equal planets and e = 0.

    Of those that differ by a rigid rotation r, the one with sum of M r u = 0, as of recorded u.
    """
    model = run.model
    p, sc = model.parameters, model.scales
    G = bodies_to_meshes(model)
    of_rigid = rigid_mode(model) / inverse_masses(model)
    tau = np.zeros(len(of_rigid))
    tau[:2] = p.T_1 / (2.0 * sc.r_bs)
    tau[2] = -sc.T_2 / sc.r_bc
    force = np.linalg.lstsq(G.T, tau, rcond=None)[0]
    x = force / mean_stiffness(p) + np.sign(force) * model.half_backlash_m
    rows = np.vstack([G, of_rigid / np.abs(of_rigid).max()])
    rotations: Array = np.linalg.lstsq(rows, np.append(x, 0.0), rcond=None)[0]
    return rotations


def shaft_rotations(run: PreparedRun) -> Array:
    """Rotations (n, 3) of suns and carrier [m], as recorded or integrated from accelerations.

    Integration leaves out frequencies below half the mesh frequency and adds the static rotation.
    """
    bodies, n = run.model.layout.bodies, len(run)
    at = [bodies.index(name) for name in SHAFTS]
    w = 2.0 * np.pi * np.fft.rfftfreq(n, run.step_s)
    over = np.divide(-1.0, w**2, out=np.zeros_like(w), where=w > 0.5 * run.omega_rad_per_s)
    static = static_rotations(run)
    rotations = np.empty((n, len(at)))
    for i, b in enumerate(at):
        if run.u.recorded[b]:
            rotations[:, i] = run.u.values[:, b]
        else:
            power = np.fft.rfft(run.a.values[:, b])
            rotations[:, i] = np.fft.irfft(power * over, n) + static[b]
    return rotations
