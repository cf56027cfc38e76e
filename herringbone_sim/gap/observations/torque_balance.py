"""The torque balance as an observation: accelerations of the coordinates against forces and loads.

Both sides of d2z/dt2 = M^-1 (forces, loads, control), Eqs. (12)-(14) and (18), are averaged over a
Gaussian window; on the left side the window is differentiated instead of dz/dt (weak form). The
force of a mesh is the recorded one, on which sensor errors act, or, where it is not recorded, that
of the force law, on which effects act.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.gap.data.gaussian_window import Window
from herringbone_sim.gap.data.kinematics import cycles_per_shaft_turn
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.basis import Function, force_column
from herringbone_sim.gap.observations.force_law import drift_spread, encoder_nuisances, slow_waves
from herringbone_sim.gap.observations.friction import (
    FRICTION,
    friction_of_mesh,
    friction_shapes,
)
from herringbone_sim.gap.observations.runs import GearRun
from herringbone_sim.gap.residuals.mesh_law import Law, MeshMotion
from herringbone_sim.gap.residuals.torque_balance import (
    control_acceleration,
    inertia_parts,
    load_accelerations,
    window_of,
)

NAME = "torque_balance"
# Error of ``quadrature_n`` counted as noise: variance over its mean square (20 % RMS); chosen.
QUADRATURE_NOISE = 0.04
MASSES = ("M_s", "M_p", "M_c")
RIPPLES = tuple(range(1, 61))  # orders of torque ripple, by turn of the input shaft; chosen
# Signals averaged at once, so few that they stay in the cache; chosen for run time.
AVERAGED_AT_ONCE = 32
# Control at its phase, and a quarter of its period late.
CONTROL = ("control", "control late")


def function_names(
    model: Model,
    modelled: NDArray[np.bool_],
    of_law: Sequence[Function],
    on_bodies: Sequence[str] = (),
) -> tuple[str, ...]:
    """Return the names of the columns of the balance.

    These are masses, force of each mesh, its rate and time times rate (errors of force sensors),
    friction, ripple, functions on the carrier, and functions of the law on modelled meshes.

    Args:
        modelled: (n_mesh,) meshes whose force comes from the law.
        of_law: functions of the force law.
        on_bodies: names of functions that are forces on the carrier.
    """
    meshes = model.layout.meshes
    names = [*MASSES, "quadrature", "constant", *CONTROL]
    names += [f"{what} of {j}" for what in ("F", "slope", "clock") for j in range(len(meshes))]
    names += [f"friction {g} of {j}" for j in range(len(meshes)) for g in FRICTION]
    names += [f"ripple {q} {trig}" for q in RIPPLES for trig in ("cos", "sin")]
    names += on_bodies
    modelled_ones = np.flatnonzero(modelled).tolist()
    names += [f"{f.name} of {j}" for f in of_law for j in modelled_ones if f.acts_on(j)]
    return tuple(names)


def block(
    g: GearRun,
    law: Law,
    modelled: NDArray[np.bool_],
    on_bodies: Sequence[Function],
    chosen: Sequence[Function],
    quadrature_n: Array | None,
    wanted: Sequence[str] | None = None,
) -> Block:
    """Return the torque balance of a run: residual accelerations of the coordinates z [m/s^2].

    Of the K window positions, every ``_stride``-th is a sample of the block.

    Args:
        law: force law at every sample, under the change about which the balance is linearised.
        modelled: (n_mesh,) meshes whose force comes from the law.
        on_bodies: additional functions: forces (n,) on the carrier [N].
        chosen: functions of the force law with columns, as they act through modelled meshes.
        quadrature_n: (K, n_mesh) window integral of the forces minus its sum over samples [N];
            None where the motion between samples is unknown.
        wanted: names of the columns to form; None: all.
    """
    run, m = g.run, g.motion
    window = window_of(run)
    A = inertia_parts(run.model)
    whole = A.sum(0)
    reach = len(window.mean) // 2
    stride = _stride(window)
    at = np.arange(reach, len(run) - reach)[::stride]
    average = window.average(_forces(m, law, modelled))
    more = np.zeros((len(average), whole.shape[0]))
    if quadrature_n is not None:
        average = average + quadrature_n
        more = quadrature_n @ whole.T
    load = load_accelerations(run)
    parts = np.stack([average @ A[i].T + window.average(load[i]) for i in range(3)])
    measured = window.derivative(g.fused.z_rate)
    of_law = np.mean(law.sigma**2, axis=0) - np.nan_to_num(m.sigma_F) ** 2  # no force is used
    noise_f = np.where(modelled, np.sqrt(np.maximum(of_law, 0.0)), m.sigma_F)
    of_force = (whole**2) @ (noise_f**2) * np.sum(window.mean**2)
    of_rate = np.diag(g.fused.z_rate_cov) * np.sum(window.slope**2)
    variance = of_force + of_rate
    if quadrature_n is not None:
        variance = variance + QUADRATURE_NOISE * np.mean((quadrature_n @ whole.T) ** 2, axis=0)
    residual = (measured - parts.sum(0))[::stride]
    rows = run.model.layout.n_coordinate
    names, columns, common = _columns(g, law, modelled, on_bodies, chosen, (*parts, more), wanted)
    slow = slow_waves(m.times)[at]
    # The window averages white noise, but neither drift nor hum.
    spread = drift_spread(slow.shape[1]) * np.sqrt((whole**2) @ np.nan_to_num(noise_f) ** 2)
    overlap = 2.0 * np.sqrt(np.pi) * window.deviation
    return Block(
        NAME,
        residual,
        np.broadcast_to(np.sqrt(variance), residual.shape),
        names,
        columns,
        np.broadcast_to(slow[:, None, :], (len(slow), rows, slow.shape[1])),
        np.repeat(spread[:, None], slow.shape[1], axis=1),
        *_encoder_nuisances(run.model, modelled, names),
        independent_share=min(1.0, stride / overlap),
        sample_index=at,
        common_columns=common,
    )


def _stride(window: Window) -> int:
    """Number of samples from one window of the balance to the next: one standard deviation."""
    return max(1, round(window.deviation))


def _forces(m: MeshMotion, law: Law, modelled: NDArray[np.bool_]) -> Array:
    """Mesh forces (n, n_mesh) [N]: of the law where ``modelled``, else as recorded."""
    return np.where(modelled, law.force, m.F)


def _encoder_nuisances(
    model: Model, modelled: NDArray[np.bool_], names: Sequence[str]
) -> tuple[Array, Array]:
    """Return shared nuisances: encoder errors that act through modelled forces.

    The accelerations in the errors themselves are negligible, as shafts turn slowly.

    Returns:
        Weights (T, rows, Q) of the functions ``names``, and prior standard deviations (T,) [m];
        T = 0 if no name begins with ``shaft``.
    """
    reach = inertia_parts(model).sum(0)
    shaft = tuple(n for n in names if n.startswith("shaft "))
    kinds = sorted({n.rpartition(" of ")[0] for n in shaft})
    by_mesh, sd = (
        encoder_nuisances(model, kinds)
        if shaft
        else (np.zeros((0, len(modelled), 0)), np.zeros(0))
    )
    weights = np.zeros((len(sd), len(reach), len(names)))
    for name in shaft:
        kind, _, mesh = name.rpartition(" of ")
        weight = by_mesh[:, int(mesh), kinds.index(kind)]
        weights[:, :, names.index(name)] = weight[:, None] * reach[:, int(mesh)]
    return weights, sd


def with_quadrature(
    block: Block, after_n: Array | None, before_n: Array | None, run: PreparedRun
) -> Block:
    """Return a balance of ``run`` formed with ``before_n`` as if formed with ``after_n``.

    Both are as ``quadrature_n`` of ``block``; if either is None, the balance is unchanged.
    """
    if after_n is None or before_n is None or block.sample_index is None:
        return block
    whole = inertia_parts(run.model).sum(0)
    rows = block.sample_index - block.sample_index[0]
    return replace(block, residual=block.residual - ((after_n - before_n) @ whole.T)[rows])


def _columns(
    g: GearRun,
    law: Law,
    modelled: NDArray[np.bool_],
    on_bodies: Sequence[Function],
    chosen: Sequence[Function],
    parts: Sequence[Array],
    wanted: Sequence[str] | None,
) -> tuple[tuple[str, ...], Array, Array]:
    """Names of the wanted functions, and their columns at k of the K window positions.

    Those with columns (k, rows, P) that differ between rows come first, as in ``function_names``;
    then those with columns (k, C) common to all rows.

    Args:
        parts: (K, rows) each: averaged accelerations by 1/M_s, 1/M_p and 1/M_c, and those by
            ``quadrature_n``.
    """
    run, m = g.run, g.motion
    window = window_of(run)
    force, stride = _forces(m, law, modelled), _stride(window)
    every = function_names(run.model, modelled, chosen, [f.name for f in on_bodies])
    there = set(every if wanted is None else wanted)
    names = tuple(n for n in every if n in there)
    n_mesh = m.x.shape[1]
    slope = np.gradient(force, m.times, axis=0)
    clock = m.times[:, None] * slope
    shapes = friction_shapes(m.phase)
    turn = cycles_per_shaft_turn(run.model)["s"]
    made: dict[str, Callable[[], Array]] = {"constant": partial(np.ones, len(m.phase))}
    for name, late_rad in zip(CONTROL, (0.0, np.pi / 2.0), strict=True):
        made[name] = partial(control_acceleration, run, late_rad)

    def friction(j: int, shape: str) -> Array:
        return friction_of_mesh(shape, shapes, force[:, j], law.k[:, j] * law.f[:, j])

    def ripple(trig: Callable[[Array], Array], q: int) -> Array:
        return trig(q * m.phase / turn)

    for j in range(n_mesh):
        made[f"F of {j}"] = partial(np.take, force, j, 1)
        made[f"slope of {j}"] = partial(np.take, slope, j, 1)
        made[f"clock of {j}"] = partial(np.take, clock, j, 1)
        for shape in FRICTION:
            made[f"friction {shape} of {j}"] = partial(friction, j, shape)
    for q in RIPPLES:
        made[f"ripple {q} cos"] = partial(ripple, np.cos, q)
        made[f"ripple {q} sin"] = partial(ripple, np.sin, q)
    for f in on_bodies:
        made[f.name] = partial(f.values, m, law)
    for f in chosen:
        meshes = [j for j in np.flatnonzero(modelled).tolist() if f"{f.name} of {j}" in there]
        if meshes:
            of_law = np.nan_to_num(force_column(f, m, law)[:, meshes])
            for i, j in enumerate(meshes):
                made[f"{f.name} of {j}"] = partial(np.take, of_law, i, 1)
    by_row = {name: parts[i][::stride] for i, name in enumerate((*MASSES, "quadrature"))}
    own = [by_row[n] for n in names if n in by_row]
    others = [n for n in names if n not in by_row]
    k, rows = parts[0][::stride].shape
    common = np.empty((len(others), k))
    for i in range(0, len(others), AVERAGED_AT_ONCE):
        some = np.stack([made[n]() for n in others[i : i + AVERAGED_AT_ONCE]])
        common[i : i + AVERAGED_AT_ONCE] = window.averages(some, stride)
    return names, np.stack(own, axis=2) if own else np.zeros((k, rows, 0)), common.T
