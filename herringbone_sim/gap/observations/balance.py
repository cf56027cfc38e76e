"""The torque balance as an observation: accelerations of the coordinates against forces and loads.

Weak form: dz/dt is never differentiated. Both sides of d2z/dt2 = (masses)^-1 (forces, loads,
control), Eqs. (12)-(14) and (18), are averaged over a Gaussian window, the left one by the
derivative of the window. A mesh whose force is not recorded enters by its law, and so do effects
on it; a recorded force enters as it is, and so do errors of its sensor.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.gap.data.geometry import bodies_to_coordinates
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.basis import Function, column
from herringbone_sim.gap.observations.law import Law, Motion
from herringbone_sim.gap.residuals.balance import _loads, inertia_parts, window_of
from herringbone_sim.gap.residuals.fusion import Fused

Array = NDArray[np.float64]

NAME = "torque_balance"
MASSES = ("M_s", "M_p", "M_c")
RIPPLES = tuple(range(1, 61))
FRICTION = ("sign", "lever", "sin 1", "sin 2", "sin 3", "cos 1", "cos 2")


def function_names(
    model: Model,
    modelled: NDArray[np.bool_],
    law_names: Sequence[str],
    on_bodies: Sequence[str] = (),
) -> tuple[str, ...]:
    """Columns: masses, forces and their slopes by mesh, friction, ripple, laws of some meshes."""
    meshes = model.layout.meshes
    names = [*MASSES, "one"]
    names += [f"{what} of {j}" for what in ("F", "slope", "late") for j in range(len(meshes))]
    names += [f"friction {g} of {j}" for j in range(len(meshes)) for g in FRICTION]
    names += [f"ripple {q} {trig}" for q in RIPPLES for trig in ("cos", "sin")]
    names += on_bodies
    names += [f"{f} of {j}" for j in np.flatnonzero(modelled) for f in law_names]
    return tuple(names)


def accelerations(model: Model) -> Array:
    """(m, n_bodies) acceleration of the coordinates by a force on each body at its base radius."""
    s, packed = model.scales, model.packed
    inverse = np.concatenate([packed.inv_M_s, [1.0 / s.M_c], packed.inv_M_p.ravel()])
    return bodies_to_coordinates(model) * inverse


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
) -> Block:
    """The balance of a run.

    Args:
        modelled: (n_mesh,) meshes whose force comes from the law.
        chosen: functions of the force law, which act through those meshes.
        quadrature_n: (k, n_mesh) integral minus sum of the forces over the window [N].
        width: of the window [mesh cycles].
        on_bodies: further functions, (n,) each.
    """
    look = window_of(run, width)
    A = inertia_parts(run.model)
    whole = A.sum(0)
    reach = len(look.mean) // 2
    stride = max(1, int(round(look.deviation)))
    at = np.arange(reach, len(run) - reach)[::stride]
    force = np.where(modelled, law.force, m.F)
    average = look.average(force)
    if quadrature_n is not None:
        average = average + quadrature_n
    load = _loads(run)
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
    names, columns = _columns(run, m, law, force, modelled, chosen, look, stride, parts, on_bodies)
    overlap = 2.0 * np.sqrt(np.pi) * look.deviation
    return Block(
        NAME,
        run.name,
        tuple(f"z{i}" for i in range(rows)),
        residual,
        np.broadcast_to(np.sqrt(variance), residual.shape),
        names,
        columns,
        np.zeros((len(at), rows, 0)),
        np.zeros((rows, 0)),
        np.zeros((0, rows, len(names))),
        np.zeros(0),
        independent=min(1.0, stride / overlap),
        at=at,
    )


def _columns(run, m, law, force, modelled, chosen, look, stride, parts, on_bodies):  # type: ignore[no-untyped-def]
    model = run.model
    phase = m.phase
    n_mesh = m.x.shape[1]
    slope = np.gradient(force, m.times, axis=0)
    s = phase / (2.0 * np.pi)
    s = s - np.floor(s + 0.5)
    load = np.abs(force)
    shapes = {
        "sign": np.sign(s),
        "lever": np.abs(s),
        "sin 1": np.sin(phase),
        "sin 2": np.sin(2 * phase),
        "sin 3": np.sin(3 * phase),
        "cos 1": np.cos(phase),
        "cos 2": np.cos(2 * phase),
    }
    friction = [load[:, j] * shapes[g] for j in range(n_mesh) for g in FRICTION]
    p = model.parameters
    turn = p.z_s * p.z_r / (p.z_s + p.z_r)
    ripple = [trig(q * phase / turn) for q in RIPPLES for trig in (np.cos, np.sin)]
    flat = [
        np.ones(len(phase)),
        *force.T,
        *slope.T,
        *(m.times[:, None] * slope).T,
        *friction,
        *ripple,
    ]
    flat += [f.values(m, law) for f in on_bodies]
    for j in np.flatnonzero(modelled):
        flat += [np.nan_to_num(column(f, m, law)[:, j]) for f in chosen]
    averaged = look.average(np.stack(flat, axis=1))[::stride]
    rows = parts.shape[2]
    masses = parts.transpose(1, 2, 0)[::stride]
    columns = np.concatenate(
        [masses, np.broadcast_to(averaged[:, None, :], (len(averaged), rows, averaged.shape[1]))],
        axis=2,
    )
    names = function_names(model, modelled, [f.name for f in chosen], [f.name for f in on_bodies])
    return names, columns
