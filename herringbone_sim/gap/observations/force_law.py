"""The force law as an observation: measured minus modelled force, mesh by mesh.

Algebraic in the measured motion, so chaos does not matter. Needs F of a mesh, and its x and v,
measured or inferred.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.gap.data.kinematics import bodies_to_meshes, cycles_per_shaft_turn
from herringbone_sim.gap.observations.basis import (
    ORDERS,
    TURNS,
    Function,
    Values,
    constant_function,
    force_column,
    harmonic_functions,
    load_hat_functions,
)
from herringbone_sim.gap.observations.common_filter import FILTERS
from herringbone_sim.gap.residuals.mesh_law import Law, MeshMotion
from herringbone_sim.gap.sensors.noise import DRIFT_SHARE

NAME = "force_law"
SLOW_HZ = 350.0  # [Hz] hum and drift lie below: seventh harmonic of the mains; chosen
# Amplitude of the encoder error once a revolution: 3 arcsec, data sheet.
ENCODER_ERROR_RAD = 1.45e-5


def of_force_sensor(function: str) -> bool:
    """Whether a function of the force law, by name, is an error of force sensors and no force."""
    return function.startswith("F ")


def slope(m: MeshMotion, values: Array) -> Array:
    """Time derivative (n, k) of values (n, k) by a cubic spline; NaN in columns with NaN.

    At five samples a mesh cycle, as the force law has where ten are recorded, differences lose a
    quarter of the first order, the spline 2 %.
    """
    slopes = np.full_like(values, np.nan)
    known = np.isfinite(values).all(axis=0)
    if known.any():
        slopes[:, known] = CubicSpline(m.times, values[:, known]).derivative()(m.times)
    return slopes


def shift_k(m: MeshMotion, _: Law) -> Array:
    """Derivative (n, n_mesh) of k(t) with respect to the mesh phase, over k_m."""
    return m.wave_slopes[0] / m.k_m


def shift_e(m: MeshMotion, _: Law) -> Array:
    """Derivative (n, n_mesh) of -e(t) with respect to the mesh phase [m]."""
    return -m.e_rate / m.omega


def shift_e_rate(m: MeshMotion, _: Law) -> Array:
    """Time derivative (n, n_mesh) of ``shift_e`` [m/s]."""
    return -m.wave_slopes[1]


def phase_advance(m: MeshMotion, a: Array, what: str) -> tuple[Array, Array]:
    """Exact change of the nominal waves of each mesh if their phase is advanced by an angle.

    ``shift_k``, ``shift_e`` and ``shift_e_rate`` are its derivatives at 0.

    Args:
        a: (n_mesh,) angles of mesh phase [rad].
        what: wave that is advanced, ``k`` or ``e``; the other one stays.

    Returns:
        Value and rate, each (n, n_mesh). ``k``: change of k over k_m, and zeros. ``e``: change of
        -e(t) [m], and of its time derivative [m/s].
    """
    value, rate = np.zeros_like(m.x), np.zeros_like(m.x)
    for angle in np.unique(a[a != 0.0]):
        w, at = m.waves_at(m.phase + angle), a == angle
        if what == "k":
            value[:, at] = (w.k - m.k)[:, at] / m.k_m[at]
        else:
            value[:, at], rate[:, at] = (m.e - w.e)[:, at], (m.e_rate - w.e_rate)[:, at]
    return value, rate


def cycles_per_member_turn(model: Model) -> dict[str, float]:
    """Mesh cycles per revolution of each member relative to the carrier."""
    p = model.parameters
    return {"sun": float(p.z_s), "planet": float(p.z_p), "ring": float(p.z_r)}


def law_functions(model: Model) -> list[Function]:
    """Return all basis functions of the force law, errors of force sensors included."""
    function_of_law = partial(Function, by_law=True)
    functions = [
        constant_function("kappa", "kappa"),
        constant_function("gamma", "gamma"),
        Function("error", "d", lambda m, _: -m.e, lambda m, _: -m.e_rate),
        constant_function("b_plus", "b_plus"),
        constant_function("b_minus", "b_minus"),
        Function("shift k", "mean_kappa", shift_k),
        Function("shift e", "d", shift_e, shift_e_rate),
        Function("advance k", "mean_kappa", shift_k, None, partial(phase_advance, what="k")),
        Function("advance e", "d", shift_e, shift_e_rate, partial(phase_advance, what="e")),
    ]
    functions += harmonic_functions("mean_kappa", "k", {str(q): q for q in ORDERS})
    functions += harmonic_functions("d", "e", {str(q): q for q in ORDERS})
    for member, cycles in cycles_per_member_turn(model).items():
        functions += harmonic_functions("d", member, {str(h): h / cycles for h in TURNS})
    for shaft, cycles in cycles_per_shaft_turn(model).items():
        functions += harmonic_functions("d", f"shaft {shaft}", {"1": 1.0 / cycles})
    functions += load_hat_functions("kappa", "kappa load")
    functions += [
        function_of_law(
            "gamma free", "gamma", lambda _, law: 1.0 - law.contact_drive - law.contact_back
        ),
        *(
            function_of_law(f.name, f.slot, _in_contact(f))
            for f in load_hat_functions("gamma", "gamma load")
        ),
        constant_function("F bias", "extra_force"),
        function_of_law("F gain", "extra_force", lambda _, law: law.force),
        function_of_law("F delay", "extra_force", lambda m, law: -slope(m, law.force)),
        function_of_law(
            "F clock",
            "extra_force",
            lambda m, law: -m.times[:, None] * slope(m, law.force),
        ),
        *(Function(f"filter {i + 1}", "extra_force", _filtered(i)) for i in range(len(FILTERS))),
    ]
    for i in range(model.layout.n_mesh):
        functions.append(function_of_law(f"F of {i}", "extra_force", _of_mesh(i)))
    return functions


def _in_contact(f: Function) -> Values:
    """Return the values of a function times the probability of contact."""
    return lambda m, law: f.values(m, law) * (law.contact_drive + law.contact_back)


def _of_mesh(i: int) -> Values:
    """Return values that are the force of mesh i at all meshes: for swapped force channels."""
    return lambda m, law: np.repeat(law.force[:, i : i + 1], m.x.shape[1], axis=1)


def _filtered(i: int) -> Values:
    """Return values that are the change (n, n_mesh) of the mesh forces by low-pass filter i [N].

    The filter is common to all channels, see ``common_filter``; i counts ``FILTERS`` from 0. The
    change is 0 for a motion without ``filtered``.
    """
    return lambda m, _: np.zeros_like(m.x) if m.filtered is None else m.filtered[i]


def slow_waves(times: Array) -> Array:
    """Cosines (n, S) of 1, 2, ... half periods over the run, up to the frequency ``SLOW_HZ``."""
    span = times[-1] - times[0]
    count = max(1, int(np.ceil(2.0 * span * SLOW_HZ)))
    at = (np.arange(len(times)) + 0.5) / len(times)
    return np.cos(np.pi * np.outer(at, np.arange(1, count + 1)))


def drift_spread(count: int) -> float:
    """Prior standard deviation of the amplitude of each of ``count`` slow waves.

    It is over that of the channel's noise. Drift has ``DRIFT_SHARE`` of the noise's RMS; its
    variance is spread evenly over the cosines, whose mean square is one half.
    """
    return float(DRIFT_SHARE * np.sqrt(2.0 / count))


def block(
    m: MeshMotion,
    law: Law,
    model: Model,
    chosen: Sequence[Function],
) -> Block:
    """Return the force-law residual of a run: measured minus modelled force [N], a row a mesh.

    The law is linearised about ``m.encoder_errors``, if any; the residual is that without them, so
    that their prior stays about 0. Rows of meshes whose force or motion is not known are zero.

    Args:
        m: motion of the run.
        law: force law at ``m``, under the change about which the block is linearised.
        chosen: functions whose columns are formed.
    """
    known = np.asarray(np.all(np.isfinite(m.F) & np.isfinite(law.force), axis=0))
    residual = np.where(known, m.F - law.force, 0.0)
    sigma = np.where(known, law.sigma, 1.0)
    names = tuple(f.name for f in chosen)
    # Functions along the first axis: each is written contiguously.
    flat = np.stack([force_column(f, m, law) for f in chosen])
    flat[:, :, ~known] = 0.0
    columns = np.moveaxis(np.nan_to_num(flat, copy=False), 0, 2)
    slow = slow_waves(m.times)
    stiff = np.nan_to_num(law.k * (law.contact_drive + law.contact_back))
    nuisance = np.concatenate(
        [
            np.repeat(slow[:, None, :], len(known), axis=1),
            stiff[:, :, None] * slow[:, None, :],
        ],
        axis=2,
    )
    S = slow.shape[1]
    spread = drift_spread(S)
    sd = np.concatenate(
        [
            np.repeat(spread * np.nan_to_num(m.sigma_F, nan=1.0)[:, None], S, axis=1),
            np.repeat(spread * np.nan_to_num(m.sigma_x, nan=1.0)[:, None], S, axis=1),
        ],
        axis=1,
    )
    shared, shared_sd = encoder_nuisances(model, names)
    shared = shared * known[None, :, None]
    if m.encoder_errors is not None:
        of_rows = np.tensordot(m.encoder_errors, shared, 1)
        residual = residual + np.einsum("nrq,rq->nr", columns, of_rows)
    return Block(
        NAME,
        residual,
        sigma,
        names,
        columns,
        nuisance,
        sd,
        shared,
        shared_sd,
    )


def encoder_nuisances(model: Model, names: Sequence[str]) -> tuple[Array, Array]:
    """Return shared nuisances: an encoder error once per revolution of each body.

    A reading too large by w acts on the law as the displacement d = -G[:, body] w.

    Returns:
        Weights (T, n_mesh, Q) of the functions ``names``, and prior standard deviations (T,) [m].
    """
    through = -bodies_to_meshes(model)
    weights, sds = [], []
    for j, body in enumerate(model.layout.bodies):
        for trig in ("cos", "sin"):
            weight = np.zeros((model.layout.n_mesh, len(names)))
            weight[:, names.index(f"shaft {body[0]} 1 {trig}")] = through[:, j]
            weights.append(weight)
            sds.append(ENCODER_ERROR_RAD * model.scales.base_radius(body))
    return np.array(weights), np.array(sds)
