"""How far the gap shrinks on runs that no choice and no fit has seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.effects.effect import Active
from herringbone_sim.gap.attribute import SEED, mended
from herringbone_sim.gap.balance import inertia_parts, window_of
from herringbone_sim.gap.bodies import balance_of, response
from herringbone_sim.gap.clock import lateness
from herringbone_sim.gap.consistency import consistency
from herringbone_sim.gap.decide import Verdict
from herringbone_sim.gap.few_runs import gap_of
from herringbone_sim.gap.fusion import fuse
from herringbone_sim.gap.hypothesis import Case, added, case, expected
from herringbone_sim.gap.motion import WIDTH, fused_noise, motion_balance
from herringbone_sim.gap.prepared import PreparedRun
from herringbone_sim.gap.recalibrate import force_law
from herringbone_sim.gap.sensors import SensorCheck
from herringbone_sim.gap.unforced import with_law_forces

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RunGap:
    """RMS residual of a run: nominal, with the effects of a verdict, and the floor of the noise.

    Newtons for the force law, m/s^2 for the torque balance, sigma for consistency; NaN where the
    channels can't give it.
    """

    name: str
    role: str
    nominal: float
    augmented: float
    floor: float


@dataclass(frozen=True)
class Gap:
    """The gap of a metric over the held-out runs, and of each run."""

    metric: str
    runs: tuple[RunGap, ...]

    def over(self, what: str, role: str = "held_out") -> float:
        """RMS over the runs of a role of ``nominal``, ``augmented`` or ``floor``.

        Runs whose channels can't give it are left out.
        """
        values = [getattr(run, what) for run in self.runs if run.role == role]
        values = [value for value in values if np.isfinite(value)]
        return float(np.sqrt(np.mean(np.square(values)))) if values else float("nan")

    @property
    def closure(self) -> float:
        """Part of the gap above the noise that the effects close on held-out runs."""
        nominal, floor = self.over("nominal"), self.over("floor")
        above = nominal - floor
        closed = nominal - self.over("augmented")
        return closed / above if above > 0.0 else float("nan")


@dataclass(frozen=True)
class Augmented:
    """What a verdict changes: calibration of law and balance, effects; ``motion``: no forces."""

    factors: Array
    inverse: Array
    actives: tuple[Active, ...]
    motion: bool = False


def measure(runs: Sequence[PreparedRun], check: SensorCheck, metric: str, model: Augmented) -> Gap:
    """The gap of all runs in a metric, before and after."""
    if metric == "consistency":
        return Gap(metric, tuple(_consistent(run, check) for run in runs))
    cases = [(run, case(m, fuse(m))) for run in runs for m in (mended(run, check),)]
    if model.motion:
        return Gap(metric, tuple(_moved(run, c, model) for run, c in cases))
    one = _balance if metric == "torque_balance" else _law
    return Gap(metric, tuple(one(run, c, model) for run, c in cases))


def chosen_actives(verdict: Verdict) -> tuple[Active, ...]:
    """Effects of the augmented model."""
    return tuple(a for option in verdict.chosen for a in option.actives)


def _law(run: PreparedRun, c: Case, model: Augmented) -> RunGap:
    law = force_law(c.run, c.fused, np.ones(6))
    after = expected(c, model.factors, model.actives)
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
    error = expected(c, model.factors, sensors) - expected(c, model.factors, ())
    before = balance_of(c, model.factors)
    balance = balance_of(c, model.factors, c.run.F.values - error, model.actives)
    after = balance.measured - np.tensordot(model.inverse, balance.parts, axes=1)
    law = force_law(c.run, c.fused, model.factors)
    for one in model.actives:
        if one.effect.level == "body":
            after = after - response(c, model.factors, law, one)
    return RunGap(run.name, run.role, _rms(before.residual), _rms(after), _rms(before.sigma))


def _moved(run: PreparedRun, c: Case, model: Augmented) -> RunGap:
    """Accelerations against the law's forces, or a filter's innovations where v is not there."""
    if not (np.isfinite(c.fused.x).all() and np.isfinite(c.fused.v).all()):
        found = gap_of(c.run, model.factors, model.inverse, model.actives)
        return RunGap(run.name, run.role, *found)
    noise = fused_noise(c.run, np.random.default_rng(SEED))
    before = motion_balance(c.run, c.fused, noise, np.ones(6), np.ones(3))
    balance = motion_balance(c.run, c.fused, noise, model.factors, model.inverse)
    after = balance.residual
    law = force_law(c.run, c.fused, model.factors)
    c = with_law_forces(c, law)
    through = np.tensordot(model.inverse, inertia_parts(c.run.model), axes=1)
    for one in model.actives:
        if one.effect.level == "body":
            after = after - response(c, model.factors, law, one, WIDTH)
        elif one.effect.level == "mesh":
            more = added(c, model.factors, law, (one,))[0]
            after = after - window_of(c.run, WIDTH).average(more) @ through.T
    return RunGap(run.name, run.role, _rms(before.residual), _rms(after), _rms(balance.sigma))


def _consistent(run: PreparedRun, check: SensorCheck) -> RunGap:
    better = mended(run, check)
    before, after = (consistency([r]).chi2 for r in (run, better))
    if any(finding.group.quantity == "xvu" for finding in check.findings):
        before, after = before + lateness([run]), after + lateness([better])
    return RunGap(run.name, run.role, float(np.sqrt(before)), float(np.sqrt(after)), 1.0)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
