"""The torque balance as relative accelerations: effects that act on the bodies show here.

Weak form: dz/dt is never differentiated. Both sides of d2z/dt2 = (masses)^-1 (forces, loads,
control), Eqs. (12)-(14) and (18), are averaged over a smooth window about half a mesh cycle wide,
the left one by the derivative of the window. Friction and torque ripple leave no trace in the
force law; here they do. A recorded force has kinks that a sum over its samples does not average as
an integral does; the difference between the two is taken from a law (``quadrature``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model
from herringbone_sim.gap.data.geometry import coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.data.window import Window, gaussian_window
from herringbone_sim.gap.residuals.fusion import Fused

Array = NDArray[np.float64]

FineLaw = Callable[[Array, Array, Array], Array]

FINE = 4  # points a sample at which a law is averaged
UNSURE = 0.2  # share of the RMS of what a law adds between samples that it may be off
UNSURE_AT_ONCE = 0.5  # share of it at one time
WIDTH = 0.12  # deviation of the window, mesh cycles: order 1 passes with 0.75, order 3 with 0.08


@dataclass(frozen=True)
class Balance:
    """Accelerations of the coordinates z = (q, r), averaged over a window; [m/s^2].

    Attributes:
        at: (k,) indices of the samples in the middle of the windows.
        measured: (k, m) from dz/dt.
        parts: (3, k, m) of the sun, planet and carrier inertias as nominal: what 1/M_s, 1/M_p and
            1/M_c multiply.
        factors: (3,) on 1/M_s, 1/M_p, 1/M_c that the residual was taken with.
        sigma: (m,) noise floor of the residual.
        unsure: (k, m) how far off the forces between samples may be at a time.
        overlap: samples that share one independent value, by the width of the window.
        meshes: (n_mesh, m) matrix D that makes the relative accelerations of the meshes of it.
    """

    at: NDArray[np.int64]
    measured: Array
    parts: Array
    factors: Array
    sigma: Array
    unsure: Array
    overlap: float
    meshes: Array

    @property
    def residual(self) -> Array:
        """Measured minus expected (k, m)."""
        residual: Array = self.measured - np.tensordot(self.factors, self.parts, axes=1)
        return residual

    @property
    def chi2(self) -> Array:
        """Mean square (m,) of residual over floor: 1 where the balance holds."""
        chi2: Array = np.mean((self.residual / self.sigma) ** 2, axis=0)
        return chi2


@dataclass(frozen=True)
class Force:
    """Forces averaged over the window, whatever they come from.

    Attributes:
        average_n: (k, n_mesh) [N].
        covariance: (n_mesh, n_mesh) of their noise [N^2].
        correction_n: (k, n_mesh) part of the average that a law between samples gave [N].
    """

    average_n: Array
    covariance: Array
    correction_n: Array


def window_of(run: PreparedRun, width: float = WIDTH) -> Window:
    """Window of a width [mesh cycles] on the samples of a run."""
    cycle_s = 2.0 * np.pi / run.omega_rad_per_s
    return gaussian_window(width * cycle_s / run.step_s, run.step_s)


def torque_balance(
    run: PreparedRun,
    fused: Fused,
    factors: Array | None = None,
    force: Force | None = None,
    width: float = WIDTH,
) -> Balance:
    """Relative accelerations of a run against its forces.

    Args:
        run: with v of enough meshes.
        fused: of the run.
        factors: (3,) on 1/M_s, 1/M_p, 1/M_c; None: nominal.
        force: averaged forces and their floor; None: the measured ones, averaged as a sum.
        width: of the window [mesh cycles].
    """
    look = window_of(run, width)
    force = force or measured_force(run, look)
    A = inertia_parts(run.model)
    own = np.ones(3) if factors is None else factors
    load = _loads(run)
    parts = np.stack([force.average_n @ A[i].T + look.average(load[i]) for i in range(3)])
    whole = np.tensordot(own, A, axes=1)
    of_force = np.einsum("mi,ij,mj->m", whole, force.covariance, whole)
    of_rate = np.diag(fused.z_rate_cov) * np.sum(look.slope**2)
    between_samples = force.correction_n @ whole.T
    of_law = UNSURE**2 * np.mean(between_samples**2, axis=0)
    reach = len(look.mean) // 2
    return Balance(
        at=np.arange(reach, len(run) - reach),
        measured=look.derivative(fused.z_rate),
        parts=parts,
        factors=own,
        sigma=np.sqrt(of_force + of_rate + of_law),
        unsure=UNSURE_AT_ONCE * np.abs(between_samples),
        overlap=float(2.0 * np.sqrt(np.pi) * look.deviation),
        meshes=coordinates_to_meshes(run.model.layout),
    )


def measured_force(run: PreparedRun, look: Window, correction_n: Array | None = None) -> Force:
    """Window average of the measured forces, with a ``quadrature`` correction if there is one."""
    average = look.average(run.F.values)
    more = np.zeros_like(average) if correction_n is None else correction_n
    return Force(average + more, np.diag(run.F.sigma**2) * np.sum(look.mean**2), more)


def modelled_force(look: Window, force_n: Array, noise_n: Array) -> Force:
    """Window average of forces (n, n_mesh) of a law, its floor from a realisation of the noise."""
    average = look.average(force_n)
    return Force(average, np.cov(look.average(noise_n).T), np.zeros_like(average))


def quadrature(run: PreparedRun, fused: Fused, law: FineLaw, width: float = WIDTH) -> Array:
    """Integral minus sum of a force over the window (k, n_mesh) [N], by a law between samples.

    Args:
        law: gives the forces (n, n_mesh) from phase (n,), D z and its rate (n, n_mesh).
    """
    h = run.step_s
    z, rate = between(fused.z, fused.z_rate, h, FINE)
    D = coordinates_to_meshes(run.model.layout)
    phase = np.interp(np.arange(len(z)) / FINE, np.arange(len(run)), run.phase)
    force = law(phase, z @ D.T, rate @ D.T)
    look = window_of(run, width)
    fine = look.finer(FINE)
    reach = len(look.mean) // 2
    first = reach * FINE - len(fine.mean) // 2
    whole = fine.average(force)[first::FINE][: len(run) - 2 * reach]
    difference: Array = whole - look.average(force[::FINE])
    return difference


def between(z: Array, rate: Array, step_s: float, parts: int) -> tuple[Array, Array]:
    """Cubic through values and rates (n, m) at ``parts`` points a step, and its rate."""
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
    """A (3, m, n_mesh): accelerations of z by mesh forces through suns, planets and carrier."""
    layout, s = model.layout, model.scales
    n, m, c = layout.n_mesh, layout.n_coordinate, layout.n_classes
    A = np.zeros((3, m, n))
    square = s.cos_beta**2
    for side in range(2):
        A[0, side, side * c : (side + 1) * c] = -square * model.packed.inv_M_s[side]
    per_planet = square * model.packed.inv_M_p.ravel()
    A[1, 2:, : n // 2] = np.diag(per_planet)
    A[1, 2:, n // 2 :] = -np.diag(per_planet)
    A[2, :2] = -2.0 * square / s.M_c
    A[2, 2:] = -square / s.M_c
    return A


def _loads(run: PreparedRun) -> Array:
    """Accelerations (3, n, m) by the torques T_1, T_2 and the control on suns and carrier."""
    model = run.model
    p, s, packed = model.parameters, model.scales, model.packed
    load = np.zeros((3, len(run), model.layout.n_coordinate))
    load[0, :, :2] = p.T_1 / (2.0 * s.r_bs) * s.cos_beta * packed.inv_M_s
    output = s.T_2 * s.cos_beta / (s.r_bc * s.M_c)
    wave = np.cos(packed.control_order * (run.phase - run.late_rad) + packed.control_phase)
    control = -packed.K * s.b_c * s.omega_n**2 * wave[:, None]
    per_planet = model.layout.n_classes
    load[2, :, :2] = 2.0 * output + control * packed.control_q
    load[2, :, 2:] = output + control * np.repeat(packed.control_r, per_planet)
    return load
