"""The torque balance as an observation: accelerations of the coordinates against forces and loads.

Weak form: dz/dt is never differentiated. Both sides of d2z/dt2 = (masses)^-1 (forces, loads,
control), Eqs. (12)-(14) and (18), are averaged over a Gaussian window, the left one by the
derivative of the window. A mesh whose force is not recorded enters by its law, and so do effects
on it; a recorded force enters as it is, and so do errors of its sensor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.gap.data.geometry import bodies_to_coordinates
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.data.window import Window
from herringbone_sim.gap.observations.basis import Function, column
from herringbone_sim.gap.observations.force_law import DRIFT_SHARE, gratings, slow_waves
from herringbone_sim.gap.observations.law import Law, Motion
from herringbone_sim.gap.residuals.balance import inertia_parts, load_accelerations, window_of
from herringbone_sim.gap.residuals.fusion import Fused

Array = NDArray[np.float64]

NAME = "torque_balance"
MASSES = ("M_s", "M_p", "M_c")
RIPPLES = tuple(range(1, 61))
FRICTION = ("sign", "lever", "sin 1", "sin 2", "sin 3", "cos 1", "cos 2")


def function_names(
    model: Model,
    modelled: NDArray[np.bool_],
    of_law: Sequence[Function],
    on_bodies: Sequence[str] = (),
) -> tuple[str, ...]:
    """Columns: masses, forces and their slopes by mesh, friction, ripple, laws of some meshes."""
    meshes = model.layout.meshes
    names = [*MASSES, "between", "one"]
    names += [f"{what} of {j}" for what in ("F", "slope", "late") for j in range(len(meshes))]
    names += [f"friction {g} of {j}" for j in range(len(meshes)) for g in FRICTION]
    names += [f"ripple {q} {trig}" for q in RIPPLES for trig in ("cos", "sin")]
    names += on_bodies
    modelled_ones = np.flatnonzero(modelled).tolist()
    names += [f"{f.name} of {j}" for f in of_law for j in modelled_ones if f.acts_on(j)]
    return tuple(names)


def accelerations(model: Model) -> Array:
    """(m, n_bodies) acceleration of the coordinates by a force on each body at its base radius."""
    s, packed = model.scales, model.packed
    inverse = np.concatenate([packed.inv_M_s, [1.0 / s.M_c], packed.inv_M_p.ravel()])
    return np.asarray(bodies_to_coordinates(model) * inverse)


def block(
    run: PreparedRun,
    fused: Fused,
    m: Motion,
    law: Law,
    modelled: NDArray[np.bool_],
    chosen: Sequence[Function],
    quadrature_n: Array | None,
    width: float,
    on_bodies: Sequence[Function] = (),
    wanted: Sequence[str] | None = None,
    drift: float = DRIFT_SHARE,
) -> Block:
    """The balance of a run.

    Args:
        modelled: (n_mesh,) meshes whose force comes from the law.
        chosen: functions of the force law, which act through those meshes.
        quadrature_n: (k, n_mesh) integral minus sum of the forces over the window [N].
        width: of the window [mesh cycles].
        on_bodies: further functions, (n,) each.
        wanted: names of the columns to form; None for all.
        drift: RMS of drift and hum over that of the noise.
    """
    look = window_of(run, width)
    A = inertia_parts(run.model)
    whole = A.sum(0)
    reach = len(look.mean) // 2
    stride = max(1, round(look.deviation))
    at = np.arange(reach, len(run) - reach)[::stride]
    force = np.where(modelled, law.force, m.F)
    average = look.average(force)
    more = np.zeros((len(average), whole.shape[0]))
    if quadrature_n is not None:
        average = average + quadrature_n
        more = quadrature_n @ whole.T
    load = load_accelerations(run)
    parts = np.stack([average @ A[i].T + look.average(load[i]) for i in range(3)])
    measured = look.derivative(fused.z_rate)
    noise_f = np.where(modelled, np.sqrt(np.mean(law.sigma**2, axis=0)), m.sigma_F)
    of_force = (whole**2) @ (noise_f**2) * np.sum(look.mean**2)
    of_rate = np.diag(fused.z_rate_cov) * np.sum(look.slope**2)
    variance = of_force + of_rate
    if quadrature_n is not None:
        variance = variance + 0.04 * np.mean((quadrature_n @ whole.T) ** 2, axis=0)
    residual = (measured - parts.sum(0))[::stride]
    rows = run.model.layout.n_coordinate
    names, columns = _columns(
        run, m, law, force, modelled, chosen, look, stride, (*parts, more), on_bodies, wanted
    )
    slow = slow_waves(m.times)[at]
    # A window averages white noise out, drift and hum it leaves as they are.
    spread = drift * np.sqrt(2.0 / slow.shape[1] * ((whole**2) @ np.nan_to_num(noise_f) ** 2))
    overlap = 2.0 * np.sqrt(np.pi) * look.deviation
    return Block(
        NAME,
        run.name,
        tuple(f"z{i}" for i in range(rows)),
        residual,
        np.broadcast_to(np.sqrt(variance), residual.shape),
        names,
        columns,
        np.repeat(slow[:, None, :], rows, axis=1),
        np.repeat(spread[:, None], slow.shape[1], axis=1),
        *_gratings(run.model, modelled, names),
        independent=min(1.0, stride / overlap),
        at=at,
        alike=np.array([name not in (*MASSES, "between") for name in names]),
    )


def _gratings(
    model: Model, modelled: NDArray[np.bool_], names: Sequence[str]
) -> tuple[Array, Array]:
    """Encoders off centre through the forces that come from the law (T, rows, Q), and their prior.

    They turn slowly: what they do to the accelerations themselves is left out.
    """
    reach = inertia_parts(model).sum(0)
    shaft = tuple(n for n in names if n.startswith("shaft "))
    kinds = sorted({n.rpartition(" of ")[0] for n in shaft})
    by_mesh, sd = (
        gratings(model, kinds) if shaft else (np.zeros((0, len(modelled), 0)), np.zeros(0))
    )
    found = np.zeros((len(sd), len(reach), len(names)))
    for name in shaft:
        kind, _, mesh = name.rpartition(" of ")
        weight = by_mesh[:, int(mesh), kinds.index(kind)]
        found[:, :, names.index(name)] = weight[:, None] * reach[:, int(mesh)]
    return found, sd


def corrected(
    block: Block, after_n: Array | None, before_n: Array | None, run: PreparedRun
) -> Block:
    """A balance with other forces between samples."""
    if after_n is None or before_n is None or block.at is None:
        return block
    whole = inertia_parts(run.model).sum(0)
    rows = block.at - block.at[0]
    return replace(block, residual=block.residual - ((after_n - before_n) @ whole.T)[rows])


def friction_shapes(phase: Array) -> dict[str, Array]:
    """(n,) how friction may go over a mesh cycle, by name; the pitch point is at phase 0."""
    s = phase / (2.0 * np.pi)
    s = s - np.floor(s + 0.5)
    return {
        "sign": np.sign(s),
        "lever": np.abs(s),
        "sin 1": np.sin(phase),
        "sin 2": np.sin(2 * phase),
        "sin 3": np.sin(3 * phase),
        "cos 1": np.cos(phase),
        "cos 2": np.cos(2 * phase),
    }


def _columns(
    run: PreparedRun,
    m: Motion,
    law: Law,
    force: Array,
    modelled: NDArray[np.bool_],
    chosen: Sequence[Function],
    look: Window,
    stride: int,
    parts: Sequence[Array],
    on_bodies: Sequence[Function],
    wanted: Sequence[str] | None,
) -> tuple[tuple[str, ...], Array]:
    """Names and columns (n, rows, Q), those wanted alone."""
    every = function_names(run.model, modelled, chosen, [f.name for f in on_bodies])
    there = set(every if wanted is None else wanted)
    names = tuple(n for n in every if n in there)
    n_mesh = m.x.shape[1]
    slope = np.gradient(force, m.times, axis=0)
    late = m.times[:, None] * slope
    shapes = friction_shapes(m.phase)
    p = run.model.parameters
    turn = p.z_s * p.z_r / (p.z_s + p.z_r)
    made: dict[str, Callable[[], Array]] = {"one": partial(np.ones, len(m.phase))}

    def friction(j: int, g: str) -> Array:
        return np.abs(force[:, j]) * shapes[g]

    def ripple(trig: Callable[[Array], Array], q: int) -> Array:
        return trig(q * m.phase / turn)

    for j in range(n_mesh):
        made[f"F of {j}"] = partial(np.take, force, j, 1)
        made[f"slope of {j}"] = partial(np.take, slope, j, 1)
        made[f"late of {j}"] = partial(np.take, late, j, 1)
        for g in FRICTION:
            made[f"friction {g} of {j}"] = partial(friction, j, g)
    for q in RIPPLES:
        made[f"ripple {q} cos"] = partial(ripple, np.cos, q)
        made[f"ripple {q} sin"] = partial(ripple, np.sin, q)
    for f in on_bodies:
        made[f.name] = partial(f.values, m, law)
    for f in chosen:
        meshes = [j for j in np.flatnonzero(modelled).tolist() if f"{f.name} of {j}" in there]
        if meshes:
            of_law = np.nan_to_num(column(f, m, law)[:, meshes])
            for i, j in enumerate(meshes):
                made[f"{f.name} of {j}"] = partial(np.take, of_law, i, 1)
    masses = {name: parts[i][::stride] for i, name in enumerate((*MASSES, "between"))}
    flat = [made[n]() for n in names if n not in masses]
    k, rows = parts[0][::stride].shape
    averaged = iter(look.average(np.stack(flat, axis=1))[::stride].T if flat else ())
    columns = [
        masses[n] if n in masses else np.broadcast_to(next(averaged)[:, None], (k, rows))
        for n in names
    ]
    whole = np.moveaxis(np.stack(columns), 0, 2) if columns else np.zeros((k, rows, 0))
    return names, whole
