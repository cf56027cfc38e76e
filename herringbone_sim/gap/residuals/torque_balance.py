"""Torque balance of the bodies, as accelerations d2z/dt2 of the coordinates z = (q, r).

It shows effects that act on the bodies, such as friction and torque ripple, which don't change the
force law of the meshes.

Weak form: dz/dt is never differentiated. Both sides of d2z/dt2 = (masses)^-1 (forces, loads,
control), Eqs. (12)-(14) and (18), are averaged over a Gaussian window; on the left side the window
is differentiated instead. A force has kinks between samples, so its sum over the samples is not
its integral; ``quadrature_correction`` estimates the difference from a force law.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model
from herringbone_sim.gap.data.gaussian_window import Window, gaussian_window
from herringbone_sim.gap.data.kinematics import coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.residuals.fusion import Fused

# phase (n,) [rad], D z [m] and its rate [m/s] (n, n_mesh) -> mesh forces (n, n_mesh) [N]
ForceFunction = Callable[[Array, Array, Array], Array]

FINE = 4  # points per sample interval at which a force law is evaluated
CORRECTION_UNCERTAINTY = 0.2  # standard deviation of the quadrature correction over its RMS
WIDTH = 0.12  # standard deviation of the window, mesh cycles: gain 0.75 at order 1, 0.08 at 3


@dataclass(frozen=True)
class Balance:
    """Measured and expected accelerations of the m coordinates z, averaged over a window [m/s^2].

    Attributes:
        measured: (k, m) averages of d2z/dt2 at k positions of the window.
        parts: (3, k, m) terms of the expected acceleration with nominal inertias: those
            proportional to 1/M_s, to 1/M_p and to 1/M_c.
        factors: (3,) factors by which 1/M_s, 1/M_p and 1/M_c differ from nominal.
        sigma: (m,) standard deviation of the residual by noise and by the error of the quadrature
            correction.
        overlap: samples per independent value, as neighbouring windows overlap.
    """

    measured: Array
    parts: Array
    factors: Array
    sigma: Array
    overlap: float

    @property
    def residual(self) -> Array:
        """Measured minus expected acceleration (k, m) [m/s^2], with ``factors`` applied."""
        residual: Array = self.measured - np.tensordot(self.factors, self.parts, axes=1)
        return residual

    @property
    def reduced_chi2(self) -> Array:
        """Mean over the window positions (m,) of (residual / sigma)^2: 1 if the balance holds."""
        chi2: Array = np.mean((self.residual / self.sigma) ** 2, axis=0)
        return chi2


@dataclass(frozen=True)
class AveragedForce:
    """Mesh forces averaged over the window, measured or from a force law.

    Attributes:
        average_n: (k, n_mesh) [N].
        covariance: (n_mesh, n_mesh) of the noise of the averages [N^2].
        correction_n: (k, n_mesh) quadrature correction contained in ``average_n`` [N].
    """

    average_n: Array
    covariance: Array
    correction_n: Array


def window_of(run: PreparedRun, width: float = WIDTH) -> Window:
    """Return a Gaussian window of standard deviation ``width`` [mesh cycles] for a run."""
    return gaussian_window(width * run.cycle_s / run.step_s, run.step_s)


def torque_balance(
    run: PreparedRun,
    fused: Fused,
    factors: Array | None = None,
    force: AveragedForce | None = None,
    width: float = WIDTH,
) -> Balance:
    """Return the measured accelerations of a run and those expected from its forces and loads.

    Coordinates whose rate is unknown are NaN.

    Args:
        run: the run.
        fused: its fused motion.
        factors: (3,) on 1/M_s, 1/M_p, 1/M_c; None: nominal inertias.
        force: averaged mesh forces; None: the measured ones, without quadrature correction.
        width: standard deviation of the window [mesh cycles].
    """
    window = window_of(run, width)
    force = force or averaged_measured_force(run, window)
    A = inertia_parts(run.model)
    factors = np.ones(3) if factors is None else factors
    load = load_accelerations(run)
    parts = np.stack([force.average_n @ A[i].T + window.average(load[i]) for i in range(3)])
    whole = np.tensordot(factors, A, axes=1)
    of_force = np.einsum("mi,ij,mj->m", whole, force.covariance, whole)
    of_rate = np.diag(fused.z_rate_cov) * np.sum(window.slope**2)
    between_samples = force.correction_n @ whole.T
    of_law = CORRECTION_UNCERTAINTY**2 * np.mean(between_samples**2, axis=0)
    return Balance(
        measured=window.derivative(fused.z_rate),
        parts=parts,
        factors=factors,
        sigma=np.sqrt(of_force + of_rate + of_law),
        overlap=float(2.0 * np.sqrt(np.pi) * window.deviation),
    )


def averaged_measured_force(
    run: PreparedRun, window: Window, correction_n: Array | None = None
) -> AveragedForce:
    """Average the measured forces over the window; add ``correction_n`` (k, n_mesh), if given."""
    average = window.average(run.F.values)
    correction = np.zeros_like(average) if correction_n is None else correction_n
    covariance = np.diag(run.F.sigma**2) * np.sum(window.mean**2)
    return AveragedForce(average + correction, covariance, correction)


def averaged_law_force(window: Window, force_n: Array, noise_n: Array) -> AveragedForce:
    """Average the forces of a law over the window, without quadrature correction.

    Args:
        window: to average with.
        force_n: (n, n_mesh) forces of the law [N].
        noise_n: (n, n_mesh) realisation of their noise [N], from which the covariance is computed.
    """
    average = window.average(force_n)
    return AveragedForce(average, np.cov(window.average(noise_n).T), np.zeros_like(average))


def quadrature_correction(
    run: PreparedRun, fused: Fused, law: ForceFunction, width: float = WIDTH
) -> Array:
    """Return window integral minus window sum over the samples (k, n_mesh) [N] of a law's forces.

    For the integral the law is evaluated on the motion interpolated between the samples.

    Args:
        run: whose sample times, phase and window are used.
        fused: its fused motion.
        law: mesh forces from phase, D z and its rate, see ``ForceFunction``.
        width: standard deviation of the window [mesh cycles].
    """
    h = run.step_s
    z, rate = hermite_interpolation(fused.z, fused.z_rate, h, FINE)
    D = coordinates_to_meshes(run.model.layout)
    phase = np.interp(np.arange(len(z)) / FINE, np.arange(len(run)), run.phase)
    force = law(phase, z @ D.T, rate @ D.T)
    window = window_of(run, width)
    fine = window.finer(FINE)
    reach = len(window.mean) // 2
    first = reach * FINE - len(fine.mean) // 2
    whole = fine.average(force)[first::FINE][: len(run) - 2 * reach]
    difference: Array = whole - window.average(force[::FINE])
    return difference


def hermite_interpolation(z: Array, rate: Array, step_s: float, parts: int) -> tuple[Array, Array]:
    """Interpolate z (n, m) by cubic Hermite polynomials at ``parts`` points per sample interval.

    Args:
        z, rate: (n, m) values and their rates.
        step_s: time between samples [s].
        parts: number of points, the sample itself included.

    Returns:
        Interpolated values and rates, each (parts (n - 1) + 1, m).
    """
    n = parts * (len(z) - 1) + 1
    fine, slope = np.empty((n, z.shape[1])), np.empty((n, z.shape[1]))
    a, b, da, db = z[:-1], z[1:], step_s * rate[:-1], step_s * rate[1:]
    for i in range(parts):
        s = i / parts
        up = s * s * (3.0 - 2.0 * s)
        fine[i:-1:parts] = a + up * (b - a) + s * (1 - s) ** 2 * da + s * s * (s - 1) * db
        bend = 6.0 * s * (1.0 - s) * (b - a)
        bend += (1.0 - s) * (1.0 - 3.0 * s) * da + s * (3.0 * s - 2.0) * db
        slope[i:-1:parts] = bend / step_s
    fine[-1], slope[-1] = z[-1], rate[-1]
    return fine, slope


def inertia_parts(model: Model) -> Array:
    """Return the accelerations of z per unit of mesh force (3, m, n_mesh) [1/kg].

    The first axis separates the terms with 1/M_s (suns), 1/M_p (planets) and 1/M_c (carrier).
    """
    layout, s = model.layout, model.scales
    n, m, c = layout.n_mesh, layout.n_coordinate, layout.n_classes
    A = np.zeros((3, m, n))
    of_all = s.projection * model.packed.multiplicity  # a mesh stands for those of all planets
    for side in range(2):
        A[0, side, side * c : (side + 1) * c] = -of_all * model.packed.inv_M_s[side]
    per_planet = s.projection * model.packed.inv_M_p.ravel()
    A[1, 2:, : n // 2] = np.diag(per_planet)
    A[1, 2:, n // 2 :] = -np.diag(per_planet)
    A[2, :2] = -2.0 * of_all / s.M_c
    A[2, 2:] = -of_all / s.M_c
    return A


def load_accelerations(run: PreparedRun) -> Array:
    """Return the accelerations (3, n, m) [m/s^2] of z by input, output and control torque.

    The first axis separates the terms with 1/M_s, 1/M_p (zero: no load on planets) and 1/M_c.
    """
    model = run.model
    p, s, packed = model.parameters, model.scales, model.packed
    load = np.zeros((3, len(run), model.layout.n_coordinate))
    load[0, :, :2] = p.T_1 / (2.0 * s.r_bs) * s.cos_beta * packed.inv_M_s
    output = s.T_2 * s.cos_beta / (s.r_bc * s.M_c)
    load[2, :, :2] = 2.0 * output
    load[2, :, 2:] = output
    load[2] += control_acceleration(run)[:, None] * control_directions(model)
    return load


def control_wave(model: Model, phase: Array, late_rad: float = 0.0) -> Array:
    """Control torque over its amplitude at mesh phases (n,) [rad], Eq. (20).

    Args:
        late_rad: by how much the torque lags behind, as a phase of its own.
    """
    packed = model.packed
    return np.asarray(np.cos(packed.control_order * phase + packed.control_phase - late_rad))


def control_acceleration(run: PreparedRun, late_rad: float = 0.0) -> Array:
    """Acceleration (n,) [m/s^2] by the control along ``control_directions``."""
    s, wave = run.model.scales, control_wave(run.model, run.gear_phase, late_rad)
    return np.asarray(-run.model.packed.K * s.b_c * s.omega_n**2 * wave)


def control_directions(model: Model) -> Array:
    """Accelerations (m,) of z by a unit of ``control_acceleration``."""
    of_planets = np.repeat(model.packed.control_r, model.layout.n_classes)
    return np.concatenate([np.broadcast_to(model.packed.control_q, 2), of_planets])
