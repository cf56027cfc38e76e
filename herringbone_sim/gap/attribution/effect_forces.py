"""Forces that effects of the catalogue cause in the calibrated gear at the recorded motion.

The laws of the effects are those of the simulation. The contribution of effects is the difference
of the law with and without them at fused x and v. It is added to the expectation of the force law
over the noise of x (``residuals.mesh_law``), which the noise does not bias.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.arrays import Array, Flags
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.channels import distort, on_channels
from herringbone_sim.effects.effect import Active, Parameter
from herringbone_sim.effects.evaluate import Motion, evaluate
from herringbone_sim.effects.gear import gear_table
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.residuals.fusion import Fused
from herringbone_sim.gap.residuals.recalibrate import (
    ForceLaw,
    by_mesh,
    force_function,
    force_law,
)
from herringbone_sim.gap.residuals.torque_balance import ForceFunction


@dataclass(frozen=True)
class FusedRun:
    """A run with its fused motion and the nominal force law.

    Attributes:
        run: the run.
        fused: its fused motion.
        now: (n, 5) operating point at the samples, see ``instants``.
        usable: (n_mesh,) meshes with x, v and F.
        floor: (n, n_mesh) standard deviation of the residual of the nominal force law [N].
    """

    run: PreparedRun
    fused: Fused
    now: Array
    usable: Flags
    floor: Array


def fused_run(run: PreparedRun, fused: Fused) -> FusedRun:
    """Combine a run with its fused motion, the usable meshes and the noise of the force law."""
    usable = fused.known_meshes & np.isfinite(run.F.values).all(axis=0)
    floor = force_law(run, fused, np.ones(6)).sigma_n
    return FusedRun(run, fused, instants(run), usable, floor)


def instants(run: PreparedRun) -> Array:
    """(n, 5) phase of the gear [rad], mesh frequency [rad/s], delta_T [K], T_1 [N m] and K."""
    p = run.model.parameters
    columns = (run.gear_phase, run.omega_rad_per_s, p.delta_T, p.T_1, p.K)
    now = np.stack([np.broadcast_to(column, run.phase.shape) for column in columns], axis=1)
    return np.ascontiguousarray(now, dtype=float)


def expected_forces(
    case: FusedRun,
    factors: Array,
    actives: Sequence[Active],
    law: ForceLaw | None = None,
) -> Array:
    """Forces (n, n_mesh) [N] that the force sensors would record if the effects were present.

    Args:
        case: run with its fused motion.
        factors: (6,) on k, c and e, see ``recalibrate``.
        actives: effects; only those in the meshes and on force sensors change the forces.
        law: force law with these factors; None: computed here.
    """
    law = law or force_law(case.run, case.fused, factors)
    force = law.modelled_n
    if any(a.effect.level == "mesh" for a in actives):
        force = force + effect_contributions(case, factors, law, actives)[0]
    names = case.run.model.layout.channels_of("F")
    sensors = on_channels(names, actives)
    if sensors:
        known = np.isfinite(force)
        shown = distort(TimeSeries(case.run.times, np.where(known, force, 0.0), names), sensors)
        force = np.where(known, shown.columns(names), np.nan)
    return force


def effect_contributions(
    case: FusedRun,
    factors: Array,
    law: ForceLaw,
    actives: Sequence[Active],
) -> tuple[Array, Array]:
    """Contribution of effects to mesh forces (n, n_mesh) [N] and body torques (n, n_bodies) [N].

    Torques are divided by the base radius of the body. For the arguments see ``expected_forces``.
    """
    motion = Motion(
        case.run.times,
        case.now,
        np.nan_to_num(law.x_m),
        np.nan_to_num(law.v_m_per_s),
        _driving_forces(case.run.F.values, law.modelled_n),
    )
    return _contributions(case, factors, motion, actives)


def force_function_with_effects(
    case: FusedRun, factors: Array, actives: Sequence[Active]
) -> ForceFunction:
    """Return the force law with the mesh effects among ``actives``, as a function of the motion.

    The function is as of ``recalibrate.force_function``, at points equidistant over the run.
    """
    plain = force_function(case.run, factors)
    on_meshes = tuple(a for a in actives if a.effect.level == "mesh")
    if not on_meshes:
        return plain

    def law(phase: Array, deflection: Array, rate: Array) -> Array:
        at = np.linspace(0.0, len(case.run) - 1.0, len(phase))
        index = np.arange(len(case.run))
        now = case.now[np.minimum(np.rint(at).astype(int), len(case.run) - 1)].copy()
        now[:, 0] = phase - case.run.delay_rad
        w = case.run.waves_at(phase)
        _, _, e = by_mesh(factors, deflection.shape[1])
        measured = np.stack([np.interp(at, index, f) for f in case.run.F.values.T], axis=1)
        modelled = plain(phase, deflection, rate)
        motion = Motion(
            np.interp(at, index, case.run.times),
            now,
            deflection - e * w.e,
            rate - e * w.e_rate,
            _driving_forces(measured, modelled),
        )
        return modelled + _contributions(case, factors, motion, on_meshes)[0]

    return law


def _driving_forces(measured: Array, modelled: Array) -> Array:
    """Forces (n, n_mesh) that drive the states of effects: measured, or those of the law."""
    known: Array = np.nan_to_num(np.where(np.isfinite(measured), measured, modelled))
    return known


def _contributions(
    case: FusedRun, factors: Array, motion: Motion, actives: Sequence[Active]
) -> tuple[Array, Array]:
    """Mesh forces and body torques by the effects at a motion, see ``effect_contributions``.

    Args:
        case: run with its fused motion.
        factors: (6,) on k, c and e.
        motion: with x and v relative to the calibrated e(t).
        actives: the effects.
    """
    gear = calibrated_gear_table(case, factors)
    laws, without = (evaluate(case.run.model, a, motion, gear) for a in (actives, ()))
    return laws.force - without.force, laws.torque


def calibrated_gear_table(case: FusedRun, factors: Array) -> Array:
    """``effects.gear.gear_table`` of the gear of a run, with factors (6,) on k, c and e."""
    table = gear_table(case.run.model)
    k, c, e = by_mesh(factors, table.shape[1])
    table[0] *= k
    table[1] *= c
    table[3] *= e
    for row in range(4, len(table)):
        table[row] *= k if (row - 4) % 4 < 2 else e
    return table


def with_law_forces(c: FusedRun, law: ForceLaw) -> FusedRun:
    """Copy with forces of the law in ``F.values`` where none are measured.

    They are the input of effects that depend on force, as friction; ``recorded``, ``sigma`` and
    ``usable`` stay those of the measured forces.
    """
    values = np.where(np.isfinite(c.run.F.values), c.run.F.values, law.modelled_n)
    return replace(c, run=replace(c.run, F=replace(c.run.F, values=values)))


def step_of(p: Parameter) -> float:
    """Step of a parameter for finite differences: 1e-3 of its start minus its neutral value.

    Where these are equal, 1e-4 of its range, at most 1.
    """
    neutral = 0.0 if p.neutral is None or np.isinf(p.neutral) else p.neutral
    size = abs(p.start - neutral)
    return 1e-3 * size if size > 0.0 else min(1.0, 1e-4 * (p.high - p.low))
