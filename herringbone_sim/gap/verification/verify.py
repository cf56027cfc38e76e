"""How far the gap shrinks on runs that no choice and no fit has seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.gap.attribution.bodies import balance_with_effects, effect_accelerations
from herringbone_sim.gap.attribution.hypothesis import (
    Case,
    case,
    effect_contributions,
    expected_forces,
    with_law_forces,
)
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.residuals.balance import inertia_parts, window_of
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.residuals.motion import SEED, WIDTH, fused_noise, motion_balance
from herringbone_sim.gap.residuals.recalibrate import force_law
from herringbone_sim.gap.sensors.consistency import consistency_chi2
from herringbone_sim.gap.sensors.correction import is_motion_sensor_effect
from herringbone_sim.gap.verdict.augmented import Augmented

Array = NDArray[np.float64]
Mend = Callable[[PreparedRun], PreparedRun]

UNITS = {
    "force_law": "N",
    "torque_balance": "m/s^2",
    "consistency": "sigma",
    "trajectory": "sigma",
    "prediction": "m",
    "attractor": "sigma",
}


@dataclass(frozen=True)
class RunGap:
    """How far a run is from its model: nominal, with the effects of a verdict, and by noise alone.

    In the unit of the gap; NaN where the channels can't give it.

    Attributes:
        name, role: of the run.
        nominal, augmented: before and after.
        floor: what the noise alone would give.
        runner_up: with the best other effect in the place of the verdict, as a control.
        recalibrated: with the tolerances put right, without any effect.
    """

    name: str
    role: str
    nominal: float
    augmented: float
    floor: float
    runner_up: float = float("nan")
    recalibrated: float = float("nan")


@dataclass(frozen=True)
class Gap:
    """The gap in a metric: of each run, over those held out, over all."""

    metric: str
    runs: tuple[RunGap, ...]

    @property
    def unit(self) -> str:
        """Of the runs' numbers."""
        return UNITS[self.metric]

    def over(self, what: str, role: str | None = "held_out") -> float:
        """RMS of ``nominal``, ``augmented``, ``floor`` or ``runner_up`` over the runs of a role.

        None as the role means all; runs where it is not known don't count.
        """
        chosen = [run for run in self.runs if role in (run.role, None)]
        values = np.array([getattr(run, what) for run in chosen])
        values = values[np.isfinite(values)]
        return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")

    @property
    def closure(self) -> float:
        """Part of the gap above the noise that the effects close on held-out runs."""
        return self.closed()

    def closed(self, what: str = "augmented", role: str | None = "held_out") -> float:
        """Part of what calibration leaves above the noise that is closed; NaN if nothing is."""
        known = np.isfinite(self.over("recalibrated", role))
        return self.closed_from("recalibrated" if known else "nominal", what, role)

    def closed_from(self, start: str, what: str, role: str | None) -> float:
        """Part of the gap above the noise that is closed over the runs of a role."""
        before, floor = self.over(start, role), self.over("floor", role)
        above = before - floor
        return (before - self.over(what, role)) / above if above > 0.0 else float("nan")

    def with_runner_up(self, control: Gap | None) -> Gap:
        """The same with what another model leaves as the runner-up."""
        if control is None:
            return self
        pairs = zip(self.runs, control.runs, strict=True)
        return replace(
            self, runs=tuple(replace(one, runner_up=other.augmented) for one, other in pairs)
        )


def measure(runs: Sequence[PreparedRun], mend: Mend, metric: str, model: Augmented) -> Gap:
    """The gap of all runs in the residual that counts, before and after.

    Args:
        runs: as recorded.
        mend: takes from a run what the sensors were found to add.
        metric: ``force_law``, ``torque_balance`` or ``consistency``.
    """
    if metric == "consistency":
        return Gap(metric, tuple(_consistent(run, mend) for run in runs))
    model = replace(
        model, actives=tuple(a for a in model.actives if not is_motion_sensor_effect(a))
    )
    cases = [(run, case(m, fuse(m))) for run in runs for m in (mend(run),)]
    if model.motion:
        return Gap(metric, tuple(_moved(run, c, model) for run, c in cases))
    one = _balance if metric == "torque_balance" else _law
    return Gap(metric, tuple(one(run, c, model) for run, c in cases))


def _law(run: PreparedRun, c: Case, model: Augmented) -> RunGap:
    law = force_law(c.run, c.fused, np.ones(6))
    after = expected_forces(c, model.factors, model.actives)
    on = c.usable
    return RunGap(
        run.name,
        run.role,
        _rms(law.residual_n[:, on]),
        _rms((c.run.F.values - after)[:, on]),
        _rms(law.sigma_n[:, on]),
    )


def _balance(run: PreparedRun, c: Case, model: Augmented) -> RunGap:
    sensors = tuple(a for a in model.actives if a.effect.level == "sensor")
    error = expected_forces(c, model.factors, sensors) - expected_forces(c, model.factors, ())
    before = balance_with_effects(c, model.factors)
    balance = balance_with_effects(c, model.factors, c.run.F.values - error, model.actives)
    after = balance.measured - np.tensordot(model.inverse, balance.parts, axes=1)
    return RunGap(run.name, run.role, _rms(before.residual), _rms(after), _rms(before.sigma))


def _moved(run: PreparedRun, c: Case, model: Augmented) -> RunGap:
    """Accelerations against the law's forces; NaN where x or v is not there."""
    if not (np.isfinite(c.fused.x).all() and np.isfinite(c.fused.v).all()):
        return RunGap(run.name, run.role, *(float("nan"),) * 3)
    noise = fused_noise(c.run, np.random.default_rng(SEED))
    before = motion_balance(c.run, c.fused, noise, np.ones(6), np.ones(3))
    balance = motion_balance(c.run, c.fused, noise, model.factors, model.inverse)
    after = balance.residual
    law = force_law(c.run, c.fused, model.factors)
    c = with_law_forces(c, law)
    through = np.tensordot(model.inverse, inertia_parts(c.run.model), axes=1)
    for one in model.actives:
        if one.effect.level == "body":
            after = after - effect_accelerations(c, model.factors, law, one, WIDTH)
        elif one.effect.level == "mesh":
            more = effect_contributions(c, model.factors, law, (one,))[0]
            after = after - window_of(c.run, WIDTH).average(more) @ through.T
    return RunGap(run.name, run.role, _rms(before.residual), _rms(after), _rms(balance.sigma))


def _consistent(run: PreparedRun, mend: Mend) -> RunGap:
    better = mend(run)
    before, after = (consistency_chi2([r]) for r in (run, better))
    return RunGap(run.name, run.role, float(np.sqrt(before)), float(np.sqrt(after)), 1.0)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
