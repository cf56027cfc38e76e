"""What a small effect does to the innovations of a filter: by derivatives along the run.

The force that an effect adds at the filtered motion accelerates the bodies; a linear system that
varies in time, the filter's own with its gains, takes that to the channels. One pass answers for
all effects at all places. The planets of a gear are alike here, so that of one planet is a third
of that of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.gear import gear_table, laws, pointers_allowed, scratch
from herringbone_sim.effects.instant import recorded
from herringbone_sim.gap.data.geometry import bodies_to_coordinates, coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.data.waves import waves
from herringbone_sim.gap.filtering.filter import SIZE, Filtered, head, steps_of
from herringbone_sim.gap.filtering.gear import (
    calibrated,
    filter_index,
    gear_of,
    masses,
    reduced,
    rigid_rotation,
    seen,
)
from herringbone_sim.gap.filtering.kernel import answered, linearised
from herringbone_sim.gap.residuals.balance import inertia_parts

Array = NDArray[np.float64]

GRID = 0.3  # of the grid in dimensionless time: the force is taken as linear in between
DIFFERENCE = 1e-4
SUBSTEPS = 4


class _Out(NamedTuple):
    state: Array
    A: Array


@dataclass(frozen=True)
class Linear:
    """A filtered run and its derivatives on a grid of g points; r = 6 accelerations.

    Attributes:
        run, by: which run, by which gains.
        fine: points of the grid a sample.
        A: (g - 1, d, d) from one point to the next.
        times, now, x, v: (g,), (g, 5) and (g, n_mesh) as the laws of effects read them [SI].
        force: (g, n_mesh) of the law without effects [N].
        table: (rows, n_mesh) of the calibrated gear.
        of_force, of_torque: (r, n_mesh) and (r, n_bodies) dimensionless acceleration a newton.
    """

    run: PreparedRun
    by: Filtered
    fine: int
    A: Array
    times: Array
    now: Array
    x: Array
    v: Array
    force: Array
    table: Array
    of_force: Array
    of_torque: Array


def linear(run: PreparedRun, by: Filtered, factors: Array, inverse: Array) -> Linear:
    """Derivatives of a filtered run along its way."""
    model = reduced(run.model)
    gear = gear_of(run, model, factors, inverse)
    values, _ = seen(run)
    turn = float(np.median(np.diff(run.phase)))
    Omega = run.omega_rad_per_s / run.model.scales.omega_n
    fine = max(int(np.ceil(turn / Omega / GRID)), 1)
    points = (len(run) - 1) * fine + 1
    out = _Out(np.zeros((points, SIZE)), np.zeros((points - 1, SIZE, SIZE)))
    with pointers_allowed():
        linearised(
            *head(gear),
            run.phase,
            -(-steps_of(run) // fine),
            fine,
            gear.H,
            values,
            by.gain,
            np.full(SIZE, DIFFERENCE),
            gear.start.copy(),
            np.zeros((SIZE + 1, SIZE)),
            gear.w,
            gear.g,
            out,
        )
    return _along(run, by, fine, out, factors, inverse)


def _along(
    run: PreparedRun, by: Filtered, fine: int, out: _Out, factors: Array, inverse: Array
) -> Linear:
    model, s = run.model, run.model.scales
    at = np.arange(len(out.state)) / fine
    index = np.arange(len(run))
    phase, times = np.interp(at, index, run.phase), np.interp(at, index, run.times)
    p = model.parameters
    columns = (phase, run.omega_rad_per_s, p.delta_T, p.T_1, p.K)
    now = np.stack([np.broadcast_to(c, phase.shape) for c in columns], axis=1)
    D = coordinates_to_meshes(model.layout)[:, :, None]
    m = model.layout.n_coordinate
    expand = np.eye(SIZE)[filter_index(model.layout.n_classes)]
    of_z, of_rate = (D[:, :, 0] @ part for part in (expand[:m], expand[m:]))
    w = waves(model, phase, run.omega_rad_per_s)
    e = np.repeat(factors[4:6], len(D) // 2)
    x = s.b_c * out.state @ of_z.T - e * w.e
    v = s.velocity_m_per_s * out.state @ of_rate.T - e * w.e_rate
    unit = s.b_c * s.omega_n**2
    gather = _gather(model.layout.n_classes)
    of_force = gather @ np.tensordot(inverse, inertia_parts(model), axes=1) / unit
    M, rigid = masses(model, inverse), rigid_rotation(model)
    of_torque = gather @ bodies_to_coordinates(model) / M / unit
    turned = rigid / (rigid**2 @ M) / unit
    table = calibrated(gear_table(model), factors)
    made = Linear(
        run=run,
        by=by,
        fine=fine,
        A=out.A,
        times=times,
        now=np.ascontiguousarray(now, dtype=float),
        x=x,
        v=v,
        force=np.zeros_like(x),
        table=table,
        of_force=np.vstack([of_force, np.zeros((2, len(D)))]),
        of_torque=np.vstack([of_torque, np.zeros(len(M)), turned]),
    )
    plain, _ = answer(made, ())
    made.force[:] = plain
    return made


def _gather(classes: int) -> Array:
    """(4, m) coordinates of the reduced gear: mean over the planets of a side."""
    index = filter_index(classes)[: 2 + 2 * classes]
    gather = np.zeros((4, len(index)))
    gather[index, np.arange(len(index))] = 1.0
    mean: Array = gather / gather.sum(axis=1, keepdims=True)
    return mean


def answer(one: Linear, actives: Sequence[Active]) -> tuple[Array, Array]:
    """Forces (g, n_mesh) and torques (g, n_bodies) [N] of the gear with effects."""
    model = one.run.model
    found = laws(model, actives)
    force = np.empty_like(one.x)
    torque = np.empty((len(one.x), len(model.layout.bodies)))
    with pointers_allowed():
        recorded(
            found.kernel,
            found.site,
            found.theta,
            one.table,
            one.times,
            one.now,
            one.x,
            one.v,
            one.force,
            np.zeros(found.n_own),
            scratch(model, found.n_own),
            SUBSTEPS,
            force,
            torque,
        )
    return force, torque


def accelerations(one: Linear, actives: Sequence[Active], mask: Array | None = None) -> Array:
    """What effects add to the accelerations (g, r), on the meshes of a mask (n_mesh,)."""
    force, torque = answer(one, actives)
    return through(one, force - one.force, torque, mask)


def through(one: Linear, force: Array, torque: Array, mask: Array | None = None) -> Array:
    """Accelerations (g, r) by forces (g, n_mesh) on the meshes of a mask, and torques."""
    of_force = one.of_force if mask is None else one.of_force * mask
    total: Array = force @ of_force.T + torque @ one.of_torque.T
    return total


def responses(one: Linear, b: Array) -> Array:
    """Change (n, k, c) of the innovations over their spread by accelerations b (g, r, c)."""
    values, _ = seen(one.run)
    gear = gear_of(one.run, reduced(one.run.model), np.ones(6), np.ones(3))
    change = np.empty((*values.shape, b.shape[2]))
    h = float(np.median(np.diff(one.run.phase))) / one.fine / gear.packed.Omega
    scratch_pair = np.zeros((2, SIZE, b.shape[2]))
    answered(
        one.A,
        one.fine,
        h,
        np.ascontiguousarray(b),
        one.by.gain,
        gear.H,
        4,
        scratch_pair[0],
        scratch_pair[1],
        change,
    )
    white: Array = change / one.by.spread[:, :, None]
    return white
