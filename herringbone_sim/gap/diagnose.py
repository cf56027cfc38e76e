"""A campaign to its report: examine, judge, measure what the verdict closes, say what is open."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.diagnosis.evidence import Evidence, evidence_of
from herringbone_sim.diagnosis.examine import Examined, Found, examine
from herringbone_sim.diagnosis.judge import Chance, chances
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.attribution.hypothesis import case
from herringbone_sim.gap.calibrated import Calibrated
from herringbone_sim.gap.checks import check
from herringbone_sim.gap.data.folds import leave_out_folds
from herringbone_sim.gap.data.prepared import PreparedCampaign, PreparedRun
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.measured import gap_of, metric_of
from herringbone_sim.gap.named import named
from herringbone_sim.gap.observations import trajectory
from herringbone_sim.gap.observations.common_delay import undelayed
from herringbone_sim.gap.observations.gear import Gear
from herringbone_sim.gap.observations.independent import independent
from herringbone_sim.gap.observations.machine import GearMachine
from herringbone_sim.gap.observations.shown import noise_shown
from herringbone_sim.gap.report import report
from herringbone_sim.gap.sensors.correction import correct_sensors, is_motion_sensor_effect
from herringbone_sim.gap.sensors.noise import with_estimated_noise
from herringbone_sim.gap.verdict.augmented import Augmented, nominal_model
from herringbone_sim.gap.verdict.decide import Explanation, Verdict, decide, explanation_of
from herringbone_sim.gap.verdict.design import design
from herringbone_sim.gap.verdict.location import residual_by_mesh, residual_structure
from herringbone_sim.gap.verdict.next_experiment import next_experiment
from herringbone_sim.gap.verdict.undecidable import nominal_mismatched, undecidable
from herringbone_sim.gap.verification.senses import Senses, measure_senses
from herringbone_sim.gap.verification.verify import Gap, RunGap

Array = NDArray[np.float64]
Say = Callable[[str], None]
GAUGE = 0.05  # gain of a strain gauge where nothing is told, data sheet
STRIDE = 2  # samples between comparisons of the force law while hypotheses are sought


@dataclass(frozen=True)
class Diagnosis:
    """All that is known of a campaign.

    Attributes:
        evidence: what the verdict hangs on; None where the nominal file is another rig's.
        calibrated: fit runs and calibration.
        verdict: with probabilities.
        gap: of all runs in the observation that counts, held-out ones included.
        report: plain data after the contract.
        augmented: the model that the verdict makes of the nominal one.
        senses: the gap in all three senses; None where they were not asked for.
        findings: what is wrong with the recording, and what it leaves open.
    """

    evidence: Evidence | None
    calibrated: Calibrated
    verdict: Verdict
    gap: Gap
    report: dict[str, Any]
    augmented: Augmented = field(default_factory=nominal_model)
    senses: Senses | None = None
    findings: tuple[Finding, ...] = ()

    def mend(self, run: PreparedRun) -> PreparedRun:
        """A run without what its sensors were found to add."""
        wrong = [a for a in self.augmented.actives if is_motion_sensor_effect(a)]
        return correct_sensors(run, wrong) if wrong else run


def diagnose(
    campaign: PreparedCampaign, say: Say = lambda text: None, senses: bool = True
) -> Diagnosis:
    """Diagnose a campaign; held-out runs only measure what the verdict closes.

    Args:
        campaign: as prepared.
        say: told of the progress.
        senses: whether to measure the gap as prediction and attractor too.

    Raises:
        AnalysisError: no run of role ``fit``.
    """
    campaign, findings = check(campaign)
    for finding in findings:
        say(finding.text)
    campaign = calibrated_sensors(campaign)
    machine = machine_of(campaign, findings)
    if nominal_mismatched(findings) or not machine.formed:
        return _nothing(campaign, findings, machine, senses)
    found = examine(machine, say, campaign.noise_known)
    evidence = evidence_of(found, campaign.noise_known)
    told = chances(evidence)
    options = {
        i: explanation_of(named(f.hypotheses, f.score, machine.gear.model))
        for i, c in enumerate(told)
        if c.candidate is not None and c.effects
        for f in (_found(found, evidence, c),)
    }
    best = next((_found(found, evidence, c) for c in told if c.candidate and c.effects), None)
    verdict = decide(told, options, metric_of(found.none, best, found.counts))
    taken = _taken(found, evidence, told, options, verdict.chosen)
    other = _taken(found, evidence, told, options, verdict.runner_up)
    say("held-out runs")
    model = augmented(found.none if taken is None else taken, verdict.chosen)
    noise = found.noise.get(verdict.metric, 1.0)
    gap = gap_of(machine, campaign.runs, verdict.metric, found.none, taken, other, noise)
    calibrated = _calibrated(machine, found)
    made = Diagnosis(evidence, calibrated, verdict, gap, {}, model, None, findings)
    measured = None
    if senses and verdict.metric != trajectory.NAME:
        rival = None if other is None else augmented(other, verdict.runner_up)
        measured = measure_senses(campaign.runs, made.mend, gap, model, rival, say)
    return _reported(made, campaign, machine, measured, senses)


def calibrated_sensors(campaign: PreparedCampaign) -> PreparedCampaign:
    """A campaign with noise as recorded, copies counted once, a common delay undone."""
    if not campaign.noise_known:
        campaign = replace(
            campaign, runs=tuple(with_estimated_noise(run) for run in campaign.runs)
        )
    runs = tuple(independent(run) for run in campaign.runs)
    return replace(campaign, runs=undelayed(runs, _gauges(campaign)))


def machine_of(campaign: PreparedCampaign, findings: Sequence[Finding]) -> GearMachine:
    """What is diagnosed: the fit runs of a campaign.

    Raises:
        AnalysisError: no run of role ``fit``.
    """
    fit = leave_out_folds(_fit_runs(campaign, findings))
    return GearMachine(Gear(fit, stride=STRIDE, gain_tolerance=_gauges(campaign)))


def _gauges(campaign: PreparedCampaign) -> tuple[float, ...]:
    """Tolerance of the gain of each force sensor: as told, or that of the data sheet."""
    told = campaign.gain_tolerance
    if campaign.noise_known or any(told):
        return told
    return (GAUGE,) * len(told)


def _fit_runs(campaign: PreparedCampaign, findings: Sequence[Finding]) -> tuple[PreparedRun, ...]:
    fit = campaign.of_role("fit")
    if not fit:
        told = "; ".join(f.text for f in findings if f.fatal)
        raise AnalysisError(f"no run of role fit is left to learn from: {told}")
    return fit


def _found(found: Examined, evidence: Evidence, chance: Chance) -> Found:
    """The fit of an explanation."""
    every = (found.none, *found.singles, *found.pairs)
    at = next(i for i, c in enumerate(evidence.candidates) if c is chance.candidate)
    return every[at]


def _taken(
    found: Examined,
    evidence: Evidence,
    told: Sequence[Chance],
    options: dict[int, Explanation],
    option: Explanation | None,
) -> Found | None:
    at = next((i for i, o in options.items() if o is option), None)
    return None if at is None or option is None else _found(found, evidence, told[at])


def augmented(found: Found, option: Explanation | None) -> Augmented:
    """The nominal model with the tolerances of a fit, and the effects of an explanation."""
    values = {c.name: v for c, v in zip(found.score.coefficients, found.score.mean, strict=True)}
    factors = np.array(
        [1.0 + values[f"{q}_{kind}"] for q in "kce" for kind in ("sp", "rp")], dtype=float
    )
    inverse = np.array([1.0 + values[f"M_{body}"] for body in "spc"], dtype=float)
    actives = () if option is None else (*option.actives, *option.harmonics)
    return Augmented(factors, inverse, actives)


def _calibrated(machine: GearMachine, found: Examined) -> Calibrated:
    cases = tuple(case(g.run, g.fused) for g in machine.gear.runs)
    rows = found.none.score.rows.get("force_law")
    count = found.counts.get("force_law", 0.0)
    per_mesh = None
    if rows is not None and count > 0.0:
        alive = rows.sum(axis=0) > 0.0
        per_mesh = rows.sum(axis=0) / (count / max(int(alive.sum()), 1))
    return Calibrated(cases, augmented(found.none, None).factors, per_mesh)


def _nothing(
    campaign: PreparedCampaign,
    findings: tuple[Finding, ...],
    machine: GearMachine,
    senses: bool,
) -> Diagnosis:
    """A campaign that no observation can be formed of, or of another rig: nothing is decided."""
    told = [Chance(("unknown",), None, 0.5), Chance((), None, 0.5)]
    if nominal_mismatched(findings):
        told = [Chance(("unknown",), None, 1.0)]
    verdict = decide(told, {}, "force_law")
    nan = float("nan")
    runs = tuple(RunGap(run.name, run.role, nan, nan, nan) for run in campaign.runs)
    cases = tuple(case(g.run, g.fused) for g in machine.gear.runs)
    calibrated = Calibrated(cases, np.ones(6), None)
    made = Diagnosis(None, calibrated, verdict, Gap("force_law", runs), {}, findings=findings)
    return _reported(made, campaign, machine, None, senses)


def _reported(
    made: Diagnosis,
    campaign: PreparedCampaign,
    machine: GearMachine,
    senses: Senses | None,
    full: bool,
) -> Diagnosis:
    point = design(campaign, made.calibrated, made.verdict, made.augmented) if full else None
    verdict, findings = made.verdict, made.findings
    open_ = [f.text for f in findings] + undecidable(campaign, made.calibrated, verdict, findings)
    written = report(
        campaign.rig,
        verdict,
        residual_by_mesh(campaign, made.calibrated, verdict),
        made.gap,
        [*open_, *(senses.unknown if senses else ())],
        next_experiment(campaign, verdict, point),
        [f for f in findings if not f.limit],
        senses,
        campaign.nominal.layout.channels,
        residual_structure(campaign, made.calibrated) if full else None,
        noise_shown(machine.gear.runs, campaign.noise_known),
        machine.formed,
    )
    return replace(made, report=written, senses=senses)
