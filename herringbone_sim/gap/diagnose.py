"""Diagnose a campaign: from prepared runs to verdict, gap and report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from herringbone_sim.diagnosis.evidence import Evidence, evidence_of
from herringbone_sim.diagnosis.examine import Examination, examine
from herringbone_sim.diagnosis.fits import FittedExplanation
from herringbone_sim.diagnosis.judge import Chance, chances
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.attribution.effect_forces import fused_run
from herringbone_sim.gap.calibrated_fit import Calibrated
from herringbone_sim.gap.campaign_checks import check
from herringbone_sim.gap.data.folds import leave_out_folds
from herringbone_sim.gap.data.prepared import PreparedCampaign, PreparedRun
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.gap_by_run import RowErrors, gap_of, metric_of
from herringbone_sim.gap.named_effects import name_effects
from herringbone_sim.gap.observations.calibration.noise_report import recorded_noise
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.observations.reconstructed_forces import forces_of_run
from herringbone_sim.gap.observations.windows import trajectory
from herringbone_sim.gap.report import Report
from herringbone_sim.gap.sensor_calibration import (
    STRIDE,
    assumed_gain_tolerances,
    calibrated_sensors,
    with_learned_noise,
)
from herringbone_sim.gap.sensors.correction import correct_motion_sensors
from herringbone_sim.gap.verdict.augmented import Augmented, nominal_model
from herringbone_sim.gap.verdict.decide import NamedExplanation, Verdict, decide, explanation_of
from herringbone_sim.gap.verdict.experiment_design import design
from herringbone_sim.gap.verdict.location import residual_by_mesh
from herringbone_sim.gap.verdict.next_experiment import next_experiment
from herringbone_sim.gap.verdict.undecidable import nominal_mismatched, undecidable
from herringbone_sim.gap.verification.residual_gap import Gap, RunGap
from herringbone_sim.gap.verification.senses import measure_senses

Say = Callable[[str], None]


@dataclass(frozen=True)
class Diagnosis:
    """Result of the diagnosis of a campaign.

    Attributes:
        evidence: scores of the explanations; None where nothing could be examined.
        runs: all usable runs, with calibrated sensors and the noise that was assumed.
        calibrated: fit runs and calibration.
        augmented: the nominal model, recalibrated, with the effects of the verdict.
        report: verdict, gap and all other results, as written to ``report.json``.
    """

    evidence: Evidence | None
    runs: tuple[PreparedRun, ...]
    calibrated: Calibrated
    augmented: Augmented
    report: Report


def diagnose(
    campaign: PreparedCampaign, say: Say = lambda text: None, senses: bool = True
) -> Diagnosis:
    """Diagnose a campaign; held-out runs are used only to measure the gap.

    Errors of sensors that differ from run to run, as those of encoders, are estimated for each.

    Args:
        campaign: as prepared.
        say: called with a line of progress.
        senses: whether to also measure the gap as prediction and attractor, reconstruct the mesh
            forces from few channels, and design the next experiment.

    Raises:
        AnalysisError: no run of role ``fit``.
    """
    campaign, findings = check(campaign)
    for finding in findings:
        say(finding.text)
    _fit_runs(campaign, findings)
    campaign = calibrated_sensors(campaign)
    if not nominal_mismatched(findings):
        campaign = with_learned_noise(campaign)
    machine = machine_of(campaign, findings)
    if nominal_mismatched(findings) or not machine.gear.observation_names:
        return _undiagnosed(campaign, findings, machine, senses)
    examined = examine(machine, say, campaign.noise_known)
    assert isinstance(examined.machine, GearMachine)  # the given one, or with more windows
    machine = examined.machine
    evidence = evidence_of(examined, campaign.noise_known)
    judged = chances(evidence)
    fits = {
        i: _fit_of(examined, evidence, c)
        for i, c in enumerate(judged)
        if c.candidate is not None and c.effects
    }
    explanations = {
        i: explanation_of(name_effects(fit.hypotheses, fit.score))
        for i, fit in fits.items()
        if judged[i].whole
    }
    best = next((fits[i] for i in sorted(fits)), None)
    verdict = decide(judged, explanations, metric_of(examined.none, best, examined.counts))
    chosen, other = (
        next((fits[i] for i, e in explanations.items() if e is wanted), None)
        for wanted in (verdict.chosen, verdict.runner_up)
    )
    say("held-out runs")
    model = augmented(examined.none if chosen is None else chosen, verdict.chosen)
    errors = RowErrors(*(of.get(verdict.metric) for of in (examined.noise, examined.offsets)))
    whole = machine.for_runs(campaign.runs)
    if chosen is not None:
        whole = whole.ordered_for(chosen.hypotheses, chosen.score.mean)
    gap = gap_of(whole, campaign, verdict.metric, examined.none, chosen, other, errors)
    calibrated = _calibrated(machine, examined)
    forces = None
    if senses and machine.gear.uses_windows:
        explanation = examined.none if chosen is None or verdict.verdict == "unknown" else chosen
        of_windows = examined.noise.get(trajectory.NAME, 1.0)
        forces = forces_of_run(whole, campaign.runs, explanation, of_windows)
    in_senses = None
    if senses and verdict.metric != trajectory.NAME:
        runner_up = None if other is None else augmented(other, verdict.runner_up)
        correct = partial(correct_motion_sensors, actives=model.actives)
        in_senses = measure_senses(campaign.runs, correct, gap, model, runner_up, say)
    report = _report(campaign, findings, machine, calibrated, verdict, gap)
    if in_senses is not None:
        unknown = [*report.undecidable, *in_senses.unknown]
        report = replace(report, senses=in_senses, undecidable=unknown)
    if senses:
        report = replace(_designed(report, campaign, calibrated, model), forces=forces)
    return Diagnosis(evidence, campaign.runs, calibrated, model, report)


def machine_of(campaign: PreparedCampaign, findings: Sequence[Finding]) -> GearMachine:
    """The gear with the fit runs (thirds of a single one) as the machine of the diagnosis.

    Raises:
        AnalysisError: no run of role ``fit``.
    """
    fit = leave_out_folds(_fit_runs(campaign, findings))
    return GearMachine(
        GearObservations(fit, stride=STRIDE, gain_tolerance=assumed_gain_tolerances(campaign))
    )


def _fit_runs(campaign: PreparedCampaign, findings: Sequence[Finding]) -> tuple[PreparedRun, ...]:
    """Runs of the role ``fit``; raise AnalysisError with the fatal findings if there are none."""
    fit = campaign.of_role("fit")
    if not fit:
        reasons = "; ".join(f.text for f in findings if f.fatal)
        raise AnalysisError(f"no run of role fit is left to learn from: {reasons}")
    return fit


def _fit_of(examined: Examination, evidence: Evidence, chance: Chance) -> FittedExplanation:
    """The fit in an examination that belongs to a judged explanation."""
    every = (examined.none, *examined.singles, *examined.pairs)
    at = next(i for i, c in enumerate(evidence.candidates) if c is chance.candidate)
    return every[at]


def augmented(fit: FittedExplanation, explanation: NamedExplanation | None) -> Augmented:
    """The nominal model with the calibration of a fit and any effects of an explanation."""
    values = {c.name: v for c, v in zip(fit.score.coefficients, fit.score.mean, strict=True)}
    factors = np.array(
        [1.0 + values[f"{q}_{kind}"] for q in "kce" for kind in ("sp", "rp")], dtype=float
    )
    inverse = np.array([1.0 + values[f"M_{body}"] for body in "spc"], dtype=float)
    actives = () if explanation is None else (*explanation.actives, *explanation.departures)
    return Augmented(factors, inverse, actives)


def _calibrated(machine: GearMachine, examined: Examination) -> Calibrated:
    """Fit runs with their fused motion, and the calibration from the fit without effects.

    ``per_mesh`` is the chi2 left in the force law over the number of values of a mesh: that of all
    values, divided among the meshes by the samples of the runs that have them.
    """
    cases = tuple(fused_run(g.run, g.fused) for g in machine.gear.runs)
    rows = examined.none.score.chi2_by_row.get("force_law")
    count = examined.counts.get("force_law", 0.0)
    per_mesh = None
    if rows is not None and count > 0.0:
        samples = (rows > 0.0) * np.array([[len(g.run)] for g in machine.gear.runs])
        values = count * samples.sum(axis=0) / max(float(samples.sum()), 1.0)
        per_mesh = rows.sum(axis=0) / np.maximum(values, 1.0)
    return Calibrated(cases, augmented(examined.none, None).factors, per_mesh)


def _undiagnosed(
    campaign: PreparedCampaign,
    findings: tuple[Finding, ...],
    machine: GearMachine,
    full: bool,
) -> Diagnosis:
    """Result for a campaign without any observation, or with a nominal file of another rig.

    The verdict is ``unknown``, the gap NaN. For ``full`` the next experiment is designed.
    """
    judged = [Chance(("unknown",), None, 0.5), Chance((), None, 0.5)]
    if nominal_mismatched(findings):
        judged = [Chance(("unknown",), None, 1.0)]
    verdict = decide(judged, {}, "force_law")
    nan = float("nan")
    runs = tuple(RunGap(run.name, run.role, nan, nan, nan) for run in campaign.runs)
    cases = tuple(fused_run(g.run, g.fused) for g in machine.gear.runs)
    calibrated = Calibrated(cases, np.ones(6), None)
    gap, model = Gap("force_law", runs), nominal_model()
    report = _report(campaign, findings, machine, calibrated, verdict, gap)
    if full:
        report = _designed(report, campaign, calibrated, model)
    return Diagnosis(None, campaign.runs, calibrated, model, report)


def _report(
    campaign: PreparedCampaign,
    findings: tuple[Finding, ...],
    machine: GearMachine,
    calibrated: Calibrated,
    verdict: Verdict,
    gap: Gap,
) -> Report:
    """Assemble the report of a diagnosis, without what ``diagnose`` measures for ``senses``.

    Args:
        campaign, findings: as checked.
        machine: gear with its fit runs.
        calibrated: fit runs and calibration.
        verdict: of the diagnosis.
        gap: of all runs in the metric of the verdict.
    """
    noise = recorded_noise(machine.gear.runs, campaign.noise_known)
    limits = [f.text for f in findings] + undecidable(campaign, calibrated, verdict, findings)
    return Report(
        campaign=campaign.rig,
        verdict=verdict,
        where=residual_by_mesh(campaign, calibrated, verdict),
        gap=gap,
        undecidable=limits,
        next_experiment=next_experiment(campaign, verdict),
        findings=[f for f in findings if not f.limit],
        channels=[name for name in campaign.nominal.layout.channels if name in noise],
        noise=noise,
        observations=machine.gear.observation_names,
    )


def _designed(
    report: Report, campaign: PreparedCampaign, calibrated: Calibrated, model: Augmented
) -> Report:
    """The report with a designed next experiment."""
    point = design(campaign, calibrated, report.verdict, model)
    return replace(report, next_experiment=next_experiment(campaign, report.verdict, point))
