"""Forces and motion of the runs of a diagnosis: measured, by nominal and by augmented model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model, build
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.stepper import simulate, stepper
from herringbone_sim.errors import HerringboneError
from herringbone_sim.gap.attribution.effect_forces import FusedRun, expected_forces, fused_run
from herringbone_sim.gap.data.mesh_excitation import waves
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.diagnose import Diagnosis
from herringbone_sim.gap.observations.runs import fuse_with_rates
from herringbone_sim.gap.residuals.recalibrate import force_law
from herringbone_sim.gap.sensors.correction import correct_motion_sensors
from herringbone_sim.gap.verdict.augmented import Augmented, parameters_of

COLUMNS = ("measured", "nominal", "augmented")
TRANSIENT, CYCLES = 150, 40  # mesh cycles simulated before a view, and mesh cycles of a view


@dataclass(frozen=True)
class RunView:
    """The last ``CYCLES`` of a run, measured and by both models; NaN where a channel is missing.

    Attributes:
        run: the run.
        meshes: n names.
        times: (k,) [s].
        force: by ``COLUMNS``, (k, n) [N]: measured, and the two laws at the measured motion.
        planes: by ``COLUMNS``, displacement [m] and rate [m/s] relative to the nominal e(t):
            measured (k, n, 2); of each model (j, n, 2), at its own samples. A model starts from
            the measured state near the start of the run; where that is unknown, from its own start
            state ``TRANSIENT`` cycles earlier, and may then follow another attractor. A motion
            that is not known is left out.
        reduced_chi2: by model, (n,) mean square of its residual over the noise of the nominal
            law in all samples of the run; NaN if unknown.
        notes: sentences on motions that are left out.
    """

    run: PreparedRun
    meshes: tuple[str, ...]
    times: Array
    force: dict[str, Array]
    planes: dict[str, Array]
    reduced_chi2: dict[str, Array]
    notes: tuple[str, ...]


def run_views(diagnosis: Diagnosis) -> list[RunView]:
    """Views of all runs that the diagnosis could use, in the campaign's order."""
    model = diagnosis.augmented
    known = {c.run.name: c for c in diagnosis.calibrated.cases}
    views = []
    for run in diagnosis.runs:
        case, corrected = known.get(run.name), correct_motion_sensors(run, model.actives)
        if case is None or corrected is not run:
            case = fused_run(corrected, fuse_with_rates(corrected))
        views.append(run_view(case, model))
    return views


def run_view(case: FusedRun, model: Augmented) -> RunView:
    """Compare one run with the nominal and the augmented model."""
    run = case.run
    law = force_law(run, case.fused, np.ones(6))
    after = expected_forces(case, model.factors, model.actives)
    last = _last_cycles(run)
    forces = (run.F.values, law.modelled_n, after)
    residuals = {"nominal": law.residual_n, "augmented": run.F.values - after}
    planes, notes = _planes(case, model, last)
    return RunView(
        run=run,
        meshes=run.model.layout.meshes,
        times=run.times[last:],
        force={name: f[last:] for name, f in zip(COLUMNS, forces, strict=True)},
        planes=planes,
        reduced_chi2={n: np.mean((r / law.sigma_n) ** 2, axis=0) for n, r in residuals.items()},
        notes=notes,
    )


def mesh_shares(views: Sequence[RunView]) -> dict[str, dict[str, float | None]]:
    """Residual of every mesh over the nominal model's total.

    None for a mesh unknown in any view, and for all where the nominal model leaves but noise.

    By model, ``nominal`` and ``augmented``, then by mesh. Residuals are chi2 per sample, averaged
    over the views, less 1 for noise, at least 0. The fractions of ``augmented`` sum to the part of
    the total that is left.
    """
    shares: dict[str, dict[str, float | None]] = {}
    above = {
        name: np.maximum(np.mean([view.reduced_chi2[name] for view in views], axis=0) - 1.0, 0.0)
        for name in COLUMNS[1:]
    }
    total = float(np.nansum(above["nominal"]))
    for name, excess in above.items():
        shares[name] = {
            mesh: float(value) / total if np.isfinite(value) and total > 0.0 else None
            for mesh, value in zip(views[0].meshes, excess, strict=True)
        }
    return shares


def _last_cycles(run: PreparedRun) -> int:
    return int(np.searchsorted(run.phase, run.phase[-1] - 2.0 * np.pi * CYCLES))


def _turns(run: PreparedRun) -> Array:
    """Mesh phase (n,) of the motion that the channels show at each sample, in mesh cycles."""
    return np.asarray(run.gear_phase / (2.0 * np.pi), dtype=np.float64)


def _planes(
    case: FusedRun, model: Augmented, last: int
) -> tuple[dict[str, Array], tuple[str, ...]]:
    planes, notes = {}, []
    seen = np.isfinite(case.fused.x).any() and np.isfinite(case.fused.v).any()
    if seen:
        planes["measured"] = np.stack([case.fused.x[last:], case.fused.v[last:]], axis=2)
    else:
        notes.append("no displacement and rate of a mesh: no measured phase portrait")
    gears = {
        "nominal": (case.run.model, ()),
        "augmented": (build(parameters_of(case.run.model.parameters, model)), model.actives),
    }
    for name, (gear, actives) in gears.items():
        try:
            planes[name] = _motion(gear, actives, case)
        except HerringboneError as error:
            notes.append(f"no motion of the {name} model: {error}")
    return planes, tuple(notes)


def _motion(gear: Model, actives: Sequence[Active], case: FusedRun) -> Array:
    """Simulated displacement and rate (j, n, 2) of the last ``CYCLES`` of a run.

    Relative to the nominal e(t), as recorded ones are.

    The simulation starts from the measured state, so that of coexisting attractors it follows the
    rig's; where that is not known, from the start state of the model.
    """
    machine = tuple(a for a in actives if a.effect.level != "sensor")
    start, before = stepper(gear, machine).start(), TRANSIENT
    two_cycles = round(2.0 * case.run.cycle_s / case.run.step_s)
    turns = _turns(case.run)
    at = int(np.argmin(np.abs(turns - np.round(turns))[:two_cycles]))
    measured = np.concatenate([case.fused.z[at], case.fused.z_rate[at]])
    if np.isfinite(measured).all():
        s = gear.scales
        unit = np.repeat([s.b_c, s.velocity_m_per_s], len(measured) // 2)
        y = np.concatenate([measured / unit, start.y[len(measured) :]])
        start = replace(start, y=y, cycle=round(turns[at]))
        before = max(round(turns[-1] - turns[at]) - CYCLES, 1)
    _, settled = simulate(gear, machine, before, start)
    series, _ = simulate(gear, machine, CYCLES, settled)
    x, v = (series.columns(gear.layout.channels_of(q)) for q in "xv")
    omega = gear.parameters.Omega * gear.scales.omega_n
    own, nominal = (waves(m, series["phase"], omega) for m in (gear, case.run.model))
    return np.stack([x + own.e - nominal.e, v + own.e_rate - nominal.e_rate], axis=2)
