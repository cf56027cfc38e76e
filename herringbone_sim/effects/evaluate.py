"""Evaluate the laws of a gear with effects at a recorded motion, without integrating the gear.

Recorded x and v include the nominal error e(t) but not the displacement d of an effect, which
therefore appears in the force only: F = k f(x + d) + c (v + d').
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.gear import gear_table, laws, pointers_allowed, scratch
from herringbone_sim.effects.instant import recorded
from herringbone_sim.errors import AnalysisError

SUBSTEPS = 8


@dataclass(frozen=True)
class Motion:
    """Recorded motion in the form that the laws read.

    Attributes:
        times: (n,) [s].
        now: (n, 5) phase [rad], mesh frequency [rad/s], delta_T [K], T_1 [N m], K.
        x, v: (n, n_mesh) deflection [m] and its rate [m/s].
        force: (n, n_mesh) measured [N], which drives states of effects; None if not measured.
    """

    times: Array
    now: Array
    x: Array
    v: Array
    force: Array | None


@dataclass(frozen=True)
class LawForces:
    """Mesh forces, and torques of the effects, that the laws give for a recorded motion.

    Attributes:
        force: (n, n_mesh) whole normal mesh force k f + c v, with the effects [N].
        torque: (n, n_bodies) torque of the effects alone over the base radius of the body [N],
            positive where u of the body increases.
    """

    force: Array
    torque: Array


def motion(model: Model, series: TimeSeries) -> Motion:
    """Return the motion of a recording that has phase, and x and v of all meshes of the model.

    The mesh frequency is the slope of a straight line through ``phase``; missing channels delta_T,
    T_1 and K have the values of the model.

    Raises:
        AnalysisError: phase, or x or v of a mesh, is missing, or there are fewer than 2 samples.
    """
    p, meshes = model.parameters, model.layout.meshes
    needed = ("phase", *(f"{a}_{m}" for a in "xv" for m in meshes))
    missing = [name for name in needed if name not in series]
    if missing or len(series) < 2:
        raise AnalysisError(
            f"the laws of effects need phase, x and v of every mesh of the {p.model} model over "
            f"time, {', '.join(missing) or 'samples'} missing: record them"
        )
    phase = series["phase"]
    slope = np.polyfit(series.times - series.times[0], phase - phase[0], 1)[0]
    held = [series[n] if n in series else getattr(p, n) for n in ("delta_T", "T_1", "K")]
    columns = [phase, slope, *held]
    now = np.stack([np.broadcast_to(column, phase.shape) for column in columns], axis=1)
    forces = tuple(f"F_{m}" for m in meshes)
    return Motion(
        times=series.times,
        now=np.ascontiguousarray(now, dtype=float),
        x=series.columns(tuple(f"x_{m}" for m in meshes)),
        v=series.columns(tuple(f"v_{m}" for m in meshes)),
        force=series.columns(forces) if all(name in series for name in forces) else None,
    )


def evaluate(
    model: Model, actives: Sequence[Active], moved: Motion, table: Array | None = None
) -> LawForces:
    """Return mesh forces and torques of a gear with effects at a recorded motion.

    States of effects (ring, bearing) start at rest and follow the measured forces, so their first
    few cycles contain a transient.

    Args:
        model: built for the operating point (delta_T sets the backlash).
        actives: the effects.
        moved: the motion.
        table: constants of the meshes as ``gear_table``; None: those of the model.

    Raises:
        AnalysisError: an effect adds states, and no forces were measured to drive them.
        ParameterError: a locus that the gear lacks, or a mesh without the effect's member.
    """
    effect_laws = laws(model, actives)
    if effect_laws.n_added_states and moved.force is None:
        raise AnalysisError(
            "an effect with states of its own is driven by the measured forces, the recording has "
            "none: record F of every mesh"
        )
    n = len(moved.times)
    force = np.empty((n, model.layout.n_mesh))
    torque = np.empty((n, len(model.layout.bodies)))
    with pointers_allowed():
        recorded(
            *effect_laws,
            gear_table(model) if table is None else table,
            moved.times,
            moved.now,
            moved.x,
            moved.v,
            force if moved.force is None else moved.force,
            np.zeros(effect_laws.n_added_states),
            scratch(model, effect_laws.n_added_states),
            SUBSTEPS,
            force,
            torque,
        )
    return LawForces(force, torque)


def forces(model: Model, actives: Sequence[Active], moved: Motion) -> Array:
    """Return normal mesh forces (n, n_mesh) [N], see ``evaluate``."""
    return evaluate(model, actives, moved).force
