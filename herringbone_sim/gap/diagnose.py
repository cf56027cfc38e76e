"""A campaign to its report: gather, decide, verify, and say what can't be decided."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.attribution.hypothesis import case
from herringbone_sim.gap.checks import check
from herringbone_sim.gap.data.parts import to_leave_out
from herringbone_sim.gap.data.prepared import PreparedCampaign, PreparedRun
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.report import report
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.sensors.find import SensorCheck, contradictions
from herringbone_sim.gap.sensors.noise import quieter
from herringbone_sim.gap.verdict.augmented import Augmented, augmented, nominal_model, runner_up
from herringbone_sim.gap.verdict.decide import Verdict, decide
from herringbone_sim.gap.verdict.design import design
from herringbone_sim.gap.verdict.evidence import Evidence, gather, mended
from herringbone_sim.gap.verdict.place import structure, where
from herringbone_sim.gap.verdict.questions import mismatched, next_experiment, undecidable
from herringbone_sim.gap.verification.senses import Senses, measure_senses
from herringbone_sim.gap.verification.verify import Gap, measure

Say = Callable[[str], None]


@dataclass(frozen=True)
class Diagnosis:
    """All that is known of a campaign.

    Attributes:
        evidence: of the fit runs.
        verdict: with probabilities.
        gap: of all runs in the residual that counts, held-out ones included.
        control: the same with the runner-up in the place of the verdict; None without one.
        report: plain data after the contract.
        augmented: the model that the verdict makes of the nominal one.
        senses: the gap in all three senses; None where they were not asked for.
        findings: what is wrong with the recording, and what it leaves open.
    """

    evidence: Evidence
    verdict: Verdict
    gap: Gap
    control: Gap | None
    report: dict[str, Any]
    augmented: Augmented = field(default_factory=nominal_model)
    senses: Senses | None = None
    findings: tuple[Finding, ...] = ()


def diagnose(
    campaign: PreparedCampaign, say: Say = lambda text: None, senses: bool = True
) -> Diagnosis:
    """Diagnose a campaign; held-out runs only measure what the verdict closes.

    Args:
        campaign: as prepared.
        say: told of the progress.
        senses: whether to measure the gap as prediction and attractor too, and to work out which
            operating point would tell the leading rivals apart.

    Raises:
        AnalysisError: no run of role ``fit``.
    """
    campaign, findings = check(campaign)
    if not campaign.noise_known:
        campaign = replace(campaign, runs=tuple(quieter(run) for run in campaign.runs))
    for finding in findings:
        say(finding.text)
    evidence = replace(evidence_of(campaign, findings, say), noise_known=campaign.noise_known)
    findings = (*findings, *contradictions(evidence.check))
    verdict = decide(evidence)
    say("held-out runs")
    model, other = augmented(evidence, verdict), runner_up(evidence, verdict)

    def mend(run: PreparedRun) -> PreparedRun:
        return mended(run, evidence.check)

    gap = measure(campaign.runs, mend, verdict.metric, model)
    control = None if other is None else measure(campaign.runs, mend, verdict.metric, other)
    gap = gap.with_runner_up(control)
    found, next_point = None, None
    if senses and not mismatched(findings):
        found = measure_senses(campaign.runs, mend, gap, model, other, say)
        say("next operating point")
        next_point = design(campaign, evidence, verdict)
    open_ = [f.text for f in findings] + undecidable(campaign, evidence, verdict, findings)
    made = report(
        campaign.rig,
        verdict,
        where(campaign, evidence),
        gap,
        [*open_, *(found.unknown if found else ())],
        next_experiment(campaign, verdict, next_point),
        [f for f in findings if not f.limit],
        found,
        campaign.nominal.layout.channels,
        structure(campaign, evidence) if senses else None,
    )
    return Diagnosis(evidence, verdict, gap, control, made, model, found, findings)


def evidence_of(campaign: PreparedCampaign, findings: Sequence[Finding], say: Say) -> Evidence:
    """Evidence of the fit runs; that of sensors and effects is not asked of another rig's nominal.

    Raises:
        AnalysisError: no fit run is left.
    """
    fit = campaign.of_role("fit")
    if not fit:
        told = "; ".join(f.text for f in findings if f.fatal)
        raise AnalysisError(f"no run of role fit is left to learn from: {told}")
    if not mismatched(findings):
        return gather(to_leave_out(fit), say)
    cases = tuple(case(run, fuse(run)) for run in fit)
    nothing = SensorCheck(float("nan"), float("nan"), float("nan"), float("nan"), ())
    return Evidence(nothing, cases, None, (), (), (), (), 0.0, {})
