"""The gap in a residual, for the nominal gear and for the augmented model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.arrays import rms
from herringbone_sim.errors import AnalysisError, listed
from herringbone_sim.gap.attribution.effect_forces import (
    FusedRun,
    effect_contributions,
    expected_forces,
    fused_run,
    with_law_forces,
)
from herringbone_sim.gap.attribution.effect_torques import (
    balance_with_effects,
    effect_accelerations,
    mesh_effects_on_bodies,
)
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.runs import fuse_with_rates
from herringbone_sim.gap.residuals.balance_without_forces import (
    SEED,
    WIDTH,
    fused_noise,
    motion_balance,
)
from herringbone_sim.gap.residuals.recalibrate import force_law
from herringbone_sim.gap.residuals.torque_balance import inertia_parts, window_of
from herringbone_sim.gap.sensors.consistency import consistency_chi2
from herringbone_sim.gap.sensors.correction import is_motion_sensor_effect
from herringbone_sim.gap.verdict.augmented import Augmented

Correction = Callable[[PreparedRun], PreparedRun]

UNITS = {
    "force_law": "N",
    "torque_balance": "m/s^2",
    "consistency": "sigma",
    "trajectory": "sigma",
    "prediction": "m",
    "attractor": "sigma",
}
RESIDUALS = ("force_law", "torque_balance", "consistency")  # metrics of ``residual_gap``


@dataclass(frozen=True)
class RunGap:
    """Gap of one run: difference between rig and model, in the unit of the metric; NaN if unknown.

    Attributes:
        name, role: of the run.
        nominal: gap of the nominal gear.
        augmented: gap of the augmented model.
        floor: gap expected from noise alone.
        runner_up: gap of the model with the best other effect instead of the verdict, a control.
        recalibrated: gap of the recalibrated gear without effects.
    """

    name: str
    role: str
    nominal: float
    augmented: float
    floor: float
    runner_up: float = float("nan")
    recalibrated: float = float("nan")


@dataclass(frozen=True)
class GapNumbers:
    """A gap over several runs, by the keys of ``report.json``; NaN where unknown.

    Attributes:
        metric, unit: of the gap, see ``UNITS``.
        nominal, augmented, noise_floor, runner_up, recalibrated: RMS over runs, see ``RunGap``.
        closure, closure_runner_up: fraction of the gap of the recalibrated gear, above the noise,
            that the augmented model or the runner-up closes.
        closure_with_calibration: fraction of the gap of the nominal gear that the augmented model
            closes.
    """

    metric: str
    unit: str
    nominal: float
    augmented: float
    noise_floor: float
    recalibrated: float = float("nan")
    closure: float = float("nan")
    closure_with_calibration: float = float("nan")
    runner_up: float = float("nan")
    closure_runner_up: float = float("nan")


@dataclass(frozen=True)
class Gap:
    """The gap of several runs in one metric.

    Attributes:
        metric: key of ``UNITS``.
        runs: gap of each run.
    """

    metric: str
    runs: tuple[RunGap, ...]

    @property
    def unit(self) -> str:
        """Unit of the gap."""
        return UNITS[self.metric]

    def rms(self, what: str, role: str | None = "held_out") -> float:
        """Return the RMS over the runs of a role of one number; runs where it is NaN are left out.

        Args:
            what: attribute of ``RunGap``, such as ``nominal``.
            role: ``fit``, ``held_out`` or None: all runs.
        """
        chosen = [run for run in self.runs if role in (run.role, None)]
        values = np.array([getattr(run, what) for run in chosen])
        values = values[np.isfinite(values)]
        return rms(values)

    @property
    def closure(self) -> float:
        """Fraction of the gap above the noise that the augmented model closes on held-out runs."""
        return self.closed()

    def closed(self, what: str = "augmented", role: str | None = "held_out") -> float:
        """Return the fraction of the recalibrated gear's gap above the noise that a model closes.

        1: closed down to the noise; below 0: a larger gap; NaN: no gap above the noise. Without
        recalibration, it is that of the nominal gear's gap.

        Args:
            what: the model, an attribute of ``RunGap``.
            role: ``fit`` or ``held_out`` runs; None: all.
        """
        known = np.isfinite(self.rms("recalibrated", role))
        return self.closed_from("recalibrated" if known else "nominal", what, role)

    def closed_from(self, start: str, what: str, role: str | None) -> float:
        """Return the fraction of the gap of ``start`` above noise that ``what`` closes; or NaN."""
        before, floor = self.rms(start, role), self.rms("floor", role)
        above = before - floor
        return (before - self.rms(what, role)) / above if above > 0.0 else float("nan")

    def numbers(self, role: str | None = "held_out") -> GapNumbers:
        """Return the RMS of the gap over some runs for each model, and the fractions closed.

        Args:
            role: of the runs, ``fit`` or ``held_out``; None: all runs.
        """
        return GapNumbers(
            metric=self.metric,
            unit=self.unit,
            nominal=self.rms("nominal", role),
            augmented=self.rms("augmented", role),
            noise_floor=self.rms("floor", role),
            recalibrated=self.rms("recalibrated", role),
            closure=self.closed("augmented", role),
            closure_with_calibration=self.closed_from("nominal", "augmented", role),
            runner_up=self.rms("runner_up", role),
            closure_runner_up=self.closed("runner_up", role),
        )


def residual_gap(
    runs: Sequence[PreparedRun], correct: Correction, metric: str, model: Augmented
) -> Gap:
    """Measure the gap of runs as a residual, for the nominal gear and the augmented model.

    With ``force_law`` and ``torque_balance`` both gaps are measured after ``correct``: errors of
    motion sensors are in neither, and close nothing. With ``consistency`` the nominal gap is that
    of the run as recorded.

    Args:
        runs: as recorded.
        correct: removes the sensor effects of the verdict from a run.
        metric: one of ``RESIDUALS``. If no forces are measured (``model.motion``), both
            ``force_law`` and ``torque_balance`` give the torque balance with forces of the law.
        model: augmented model.

    Returns:
        In the unit of the metric: N, m/s^2, or standard deviations of the noise. ``runner_up`` and
        ``recalibrated`` are NaN.
    """
    if metric == "consistency":
        return Gap(metric, tuple(_consistency_gap(run, correct) for run in runs))
    model = replace(
        model, actives=tuple(a for a in model.actives if not is_motion_sensor_effect(a))
    )
    cases = [(run, fused_run(m, fuse_with_rates(m))) for run in runs for m in (correct(run),)]
    if model.motion:
        return Gap("torque_balance", tuple(_motion_gap(run, c, model) for run, c in cases))
    run_gap = _balance_gap if metric == "torque_balance" else _force_law_gap
    return Gap(metric, tuple(run_gap(run, c, model) for run, c in cases))


def check_residual(metric: str) -> None:
    """Raise ``AnalysisError`` unless ``residual_gap`` can measure a gap in this metric."""
    if metric not in RESIDUALS:
        raise AnalysisError(
            f"a gap in {metric!r} can't be measured without fitting states to the runs, only one "
            f"in {listed(RESIDUALS)}: diagnose the further runs by themselves"
        )


def _force_law_gap(run: PreparedRun, c: FusedRun, model: Augmented) -> RunGap:
    """Measure the gap in the force law [N] over the meshes with x, v and F."""
    law = force_law(c.run, c.fused, np.ones(6))
    after = expected_forces(c, model.factors, model.actives)
    on = c.usable
    return RunGap(
        run.name,
        run.role,
        rms(law.residual_n[:, on]),
        rms((c.run.F.values - after)[:, on]),
        rms(law.sigma_n[:, on]),
    )


def _balance_gap(run: PreparedRun, c: FusedRun, model: Augmented) -> RunGap:
    """Measure the gap in the torque balance with measured forces [m/s^2]."""
    sensors = tuple(a for a in model.actives if a.effect.level == "sensor")
    error = expected_forces(c, model.factors, sensors) - expected_forces(c, model.factors, ())
    before = balance_with_effects(c, model.factors)
    balance = balance_with_effects(c, model.factors, c.run.F.values - error, model.actives)
    after = balance.measured - np.tensordot(model.inverse, balance.parts, axes=1)
    return RunGap(run.name, run.role, rms(before.residual), rms(after), rms(before.sigma))


def _motion_gap(run: PreparedRun, c: FusedRun, model: Augmented) -> RunGap:
    """Measure the gap in the torque balance with forces of the law [m/s^2]; NaN without x or v."""
    if not c.fused.known_meshes.all():
        return RunGap(run.name, run.role, *(float("nan"),) * 3)
    noise = fused_noise(c.run, np.random.default_rng(SEED))
    before = motion_balance(c.run, c.fused, noise, np.ones(6), np.ones(3))
    balance = motion_balance(c.run, c.fused, noise, model.factors, model.inverse)
    after = balance.residual
    law = force_law(c.run, c.fused, model.factors)
    c = with_law_forces(c, law)
    through = np.tensordot(model.inverse, inertia_parts(c.run.model), axes=1)
    pins = mesh_effects_on_bodies(c, model.actives)
    for active in model.actives:
        if active.effect.level == "body" or active in pins:
            after = after - effect_accelerations(c, model.factors, law, active, WIDTH)
        if active.effect.level == "mesh":
            force = effect_contributions(c, model.factors, law, (active,))[0]
            after = after - window_of(c.run, WIDTH).average(force) @ through.T
    return RunGap(run.name, run.role, rms(before.residual), rms(after), rms(balance.sigma))


def _consistency_gap(run: PreparedRun, correct: Correction) -> RunGap:
    """Measure the gap in the consistency of motion sensors [sigma], as recorded and corrected."""
    before, after = (consistency_chi2([r], [run]) for r in (run, correct(run)))
    return RunGap(run.name, run.role, float(np.sqrt(before)), float(np.sqrt(after)), 1.0)
