"""The mesh force law at measured motion, with terms that effects change.

F = [k(t) (1 + kappa) + k_m mean_kappa] f(x + d; b' + b_plus, b' + b_minus)
    + c (1 + gamma) (v + d') + extra_force,
with f the expectation of the backlash function over the noise of x, Eqs. (1) to (4), (12).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import mean_stiffness
from herringbone_sim.gap.data.mesh_excitation import Waves
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.residuals.fusion import Fused

SMALL_RAD = 1e-5  # half of the phase across which derivatives of the waves are formed
Displacements = Mapping[str, tuple[Array, Array]]  # [m] and rate [m/s], (n, n_mesh), by function


@dataclass(frozen=True)
class MeshMotion:
    """Motion of all meshes of a run; arrays (n, n_mesh) unless stated otherwise.

    Attributes:
        name: name of the run.
        phase, times: (n,) mesh phase of the gear [rad], see ``PreparedRun.gear_phase``; time [s].
        omega: mesh frequency [rad/s].
        point: delta_T [K], K, T_1 [N m], Omega.
        x, v: displacement [m] and rate [m/s] relative to the nominal e(t).
        F: measured force [N], NaN where not recorded.
        sigma_x, sigma_v, sigma_F: (n_mesh,) noise of x, v, F; of x also (n, n_mesh).
        k, e, e_rate: nominal waves [N/m], [m], [m/s].
        waves_at: nominal waves at any phases (n,) of the gear.
        k_m, c, b: (n_mesh,) mean stiffness [N/m], damping [N s/m], half-backlash [m].
        filtered: (filters, n, n_mesh) change of the force by common filters [N], see
            ``common_filter``; None where unknown.
        encoder_errors: as in ``PreparedRun``.
    """

    name: str
    phase: Array
    times: Array
    omega: float
    point: dict[str, float]
    x: Array
    v: Array
    F: Array
    sigma_x: Array
    sigma_v: Array
    sigma_F: Array
    k: Array
    e: Array
    e_rate: Array
    waves_at: Callable[[Array], Waves]
    k_m: Array
    c: Array
    b: Array
    filtered: Array | None = None
    encoder_errors: Array | None = None

    @cached_property
    def wave_slopes(self) -> tuple[Array, Array]:
        """Derivatives (n, n_mesh) of the nominal k(t) and of ``e_rate`` by the phase, per rad."""
        before, after = (self.waves_at(self.phase + a) for a in (-SMALL_RAD, SMALL_RAD))
        across = 2.0 * SMALL_RAD
        return (after.k - before.k) / across, (after.e_rate - before.e_rate) / across


def mesh_motion(run: PreparedRun, fused: Fused, stride: int = 1) -> MeshMotion:
    """Motion of a run from fused displacements, at every ``stride``-th sample."""
    at = slice(None, None, stride)
    return MeshMotion(
        name=run.name,
        phase=run.gear_phase[at],
        times=run.times[at],
        omega=run.omega_rad_per_s,
        point=dict(run.point),
        x=fused.x[at],
        v=fused.v[at],
        F=run.F.values[at],
        sigma_x=fused.sigma_x,
        sigma_v=fused.sigma_v,
        sigma_F=run.F.sigma,
        k=run.waves.k[at],
        e=run.waves.e[at],
        e_rate=run.waves.e_rate[at],
        waves_at=replace(run, delay_rad=0.0).waves_at,
        k_m=mean_stiffness(run.model.parameters),
        c=run.model.damping_n_s_per_m,
        b=run.model.half_backlash_m,
        encoder_errors=run.encoder_errors,
    )


@dataclass
class LawChange:
    """Change of the terms of the law: arrays (n, n_mesh) or numbers.

    Attributes:
        kappa, mean_kappa: relative change of k(t), and change of k(t) over k_m.
        d, d_rate: additional displacement [m] and its rate [m/s].
        b_plus, b_minus: change of the half-backlash on drive and back flank [m].
        gamma: relative change of c.
        extra_force: [N].
        displacements: by moving parts at unit amplitude, by function; ``d`` has those that act.
    """

    kappa: Array | float = 0.0
    mean_kappa: Array | float = 0.0
    d: Array | float = 0.0
    d_rate: Array | float = 0.0
    b_plus: Array | float = 0.0
    b_minus: Array | float = 0.0
    gamma: Array | float = 0.0
    extra_force: Array | float = 0.0
    displacements: Displacements = field(default_factory=dict)


def select_meshes(
    m: MeshMotion, change: LawChange, at: NDArray[np.int64]
) -> tuple[MeshMotion, LawChange]:
    """Restrict a motion and a change to some meshes (indices)."""
    wide = ("x", "v", "F", "k", "e", "e_rate")
    narrow = ("sigma_x", "sigma_v", "sigma_F", "k_m", "c", "b")
    some = {name: getattr(m, name)[:, at] for name in wide}
    some |= {name: getattr(m, name)[..., at] for name in narrow}
    some["filtered"] = None if m.filtered is None else m.filtered[:, :, at]
    parts: dict[str, Array | float] = {
        name: value[:, at] if isinstance(value, np.ndarray) and value.ndim == 2 else value
        for name, value in vars(change).items()
        if name != "displacements"
    }
    return replace(m, **some), LawChange(**parts)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Law:
    """The force law evaluated at every sample, arrays (n, n_mesh).

    Attributes:
        force: [N].
        sigma: noise of measured minus modelled force [N].
        k: stiffness with all changes [N/m].
        f: expected backlash function [m].
        contact_drive, contact_back: probability of contact on drive and back flank.
        damper: nominal c times (v + d') [N].
        c: damping with all changes [N s/m].
        displacements: of moving parts, by function.
    """

    force: Array
    sigma: Array
    k: Array
    f: Array
    contact_drive: Array
    contact_back: Array
    damper: Array
    c: Array = field(repr=False)
    displacements: Displacements = field(default_factory=dict, repr=False)


def law(m: MeshMotion, change: LawChange | None = None) -> Law:
    """Return the force law at a motion: its expectation over the noise ``sigma_x`` of x.

    Args:
        m: motion; ``sigma_x`` of 0 or NaN counts as no noise.
        change: of the terms of the law; None: the nominal law.
    """
    ch = change or LawChange()
    x = m.x + ch.d
    s = np.broadcast_to(np.maximum(np.nan_to_num(m.sigma_x), 1e-15), x.shape)
    f, variance, on, off = np.empty((4, *x.shape))
    plus = np.broadcast_to(np.maximum(m.b + ch.b_plus, 0.0), x.shape)
    minus = np.broadcast_to(np.maximum(m.b + ch.b_minus, 0.0), x.shape)
    _smoothed_backlash(np.ascontiguousarray(x), plus, minus, s, f, variance, on, off)
    f[np.isnan(x)] = np.nan
    k = m.k * (1.0 + ch.kappa) + m.k_m * ch.mean_kappa
    c = m.c * (1.0 + ch.gamma) * np.ones_like(m.x)
    damper = m.c * (m.v + ch.d_rate)
    force = k * f + damper * (1.0 + ch.gamma) + ch.extra_force
    sigma = np.sqrt(np.nan_to_num(m.sigma_F) ** 2 + k**2 * variance + (c * m.sigma_v) ** 2)
    return Law(force, sigma, k, f, on, off, damper, c, ch.displacements)


@njit(cache=True, nogil=True)
def _smoothed_backlash(x, plus, minus, sigma, f, variance, drive, back):  # type: ignore[no-untyped-def]
    """Write expectation ``f`` and variance of the backlash function and contact probabilities.

    From moments of max(y, 0), y ~ N(over, sigma^2), on each flank. All arrays (n, n_mesh);
    the last four are outputs.
    """
    n, m = x.shape
    for i in range(n):
        for j in range(m):
            s = sigma[i, j]
            first = 0.0
            second = 0.0
            for flank in range(2):
                over = x[i, j] - plus[i, j] if flank == 0 else -x[i, j] - minus[i, j]
                z = over / s
                if z > FAR_SIGMA:
                    odds, mean, square = 1.0, over, over * over + s * s
                elif z < -FAR_SIGMA or np.isnan(z):
                    odds, mean, square = 0.0, 0.0, 0.0
                else:
                    odds = 0.5 * math.erfc(-z / SQRT_2)
                    bell = s * math.exp(-0.5 * z * z) / SQRT_2_PI
                    mean = over * odds + bell
                    square = (over * over + s * s) * odds + over * bell
                second += square
                if flank == 0:
                    first += mean
                    drive[i, j] = odds
                else:
                    first -= mean
                    back[i, j] = odds
            f[i, j] = first
            variance[i, j] = max(second - first * first, 0.0)


FAR_SIGMA = 6.0  # number of sigma beyond which noise is neglected: probability 1e-9
SQRT_2, SQRT_2_PI = math.sqrt(2.0), math.sqrt(2.0 * math.pi)
