"""A campaign to its report: gather, decide, verify, and say what can't be decided."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from herringbone_sim.effects.effect import Locus
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.attribute import Evidence, gather
from herringbone_sim.gap.channel_sets import cannot_tell
from herringbone_sim.gap.checks import check
from herringbone_sim.gap.decide import Verdict, decide
from herringbone_sim.gap.fusion import fuse
from herringbone_sim.gap.hypothesis import case
from herringbone_sim.gap.parts import to_leave_out
from herringbone_sim.gap.prepared import PreparedCampaign
from herringbone_sim.gap.report import report
from herringbone_sim.gap.screen import Finding
from herringbone_sim.gap.sensors import SensorCheck
from herringbone_sim.gap.verify import Augmented, Gap, chosen_actives, measure

Say = Callable[[str], None]

FAR = 0.3  # a probability from which a rival is worth an experiment
LEAST = {"delta_T": 3, "T_1": 3, "Omega": 2}


@dataclass(frozen=True)
class Diagnosis:
    """All that is known of a campaign.

    Attributes:
        evidence: of the fit runs.
        verdict: with probabilities.
        gap: of all runs, held-out ones included.
        control: the same with the runner-up in the place of the verdict; None without one.
        report: plain data after the contract.
        findings: what is wrong with the recording, and what it leaves open.
    """

    evidence: Evidence
    verdict: Verdict
    gap: Gap
    control: Gap | None
    report: dict[str, Any]
    findings: tuple[Finding, ...] = ()


def diagnose(campaign: PreparedCampaign, say: Say = lambda text: None) -> Diagnosis:
    """Diagnose a campaign; held-out runs only measure what the verdict closes.

    Raises:
        AnalysisError: no run of role ``fit``.
    """
    campaign, findings = check(campaign)
    for finding in findings:
        say(finding.text)
    evidence = evidence_of(campaign, findings, say)
    verdict = decide(evidence)
    say("held-out runs")
    gap = measure(campaign.runs, evidence.check, verdict.metric, augmented(evidence, verdict))
    control = None
    if verdict.runner_up is not None:
        other = _with(evidence, verdict.runner_up.actives, verdict.runner_up.fit)
        control = measure(campaign.runs, evidence.check, verdict.metric, other)
    made = report(
        campaign.rig,
        verdict,
        where(campaign, evidence),
        gap,
        [*(f.text for f in findings), *undecidable(campaign, evidence, verdict, findings)],
        next_experiment(campaign, verdict),
        [f for f in findings if not f.limit],
    )
    return Diagnosis(evidence, verdict, gap, control, made, findings)


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
    nothing = SensorCheck(float("nan"), float("nan"), ())
    return Evidence(nothing, cases, None, (), (), (), (), 0.0, {})


def mismatched(findings: Sequence[Finding]) -> bool:
    """Whether the nominal file is that of another rig."""
    return any(finding.what == "nominal" for finding in findings)


def augmented(evidence: Evidence, verdict: Verdict) -> Augmented:
    """The nominal model recalibrated, with the effects of the verdict."""
    fits = [option.fit for option in verdict.chosen if option.fit is not None]
    return _with(evidence, chosen_actives(verdict), fits[0] if fits else None)


def _with(evidence: Evidence, actives: Any, fitted: Any) -> Augmented:
    law = fitted or evidence.nominal
    factors = np.ones(6) if law is None else law.factors
    bodies = [b for b in evidence.bodies if not b.actives or b.actives[0] in actives]
    inverse = bodies[-1].inverse if bodies else np.ones(3)
    if evidence.motion is not None:
        both = evidence.motion.inverse + inverse - 1.0
        return Augmented(evidence.motion.factors, both, tuple(actives), True)
    return Augmented(factors, inverse, tuple(actives))


def where(campaign: PreparedCampaign, evidence: Evidence) -> list[tuple[Locus, float]]:
    """Share of every mesh in the residual above the noise of the recalibrated law."""
    if evidence.nominal is None:
        return []
    above = np.maximum(evidence.nominal.per_mesh - 1.0, 0.0)
    shares = above / above.sum() if above.sum() > 0.0 else np.full(above.shape, 1 / above.size)
    layout = evidence.cases[0].run.model.layout
    places = [
        Locus(mesh, planet, side)
        for mesh in ("sp", "rp")
        for side in ("L", "R")
        for planet in (layout.planets if layout.numbered else ("all",))
    ]
    found = zip(places, (float(s) for s in shares), strict=True)
    return sorted(found, key=lambda pair: -pair[1])


def undecidable(
    campaign: PreparedCampaign,
    evidence: Evidence,
    verdict: Verdict,
    findings: Sequence[Finding] = (),
) -> list[str]:
    """What these data can't tell, in sentences."""
    if mismatched(findings):
        return []
    said = cannot_tell(evidence.cases)
    points = [run.point for run in campaign.of_role("fit")]
    for name, least in LEAST.items():
        different = len({round(float(p[name]), 6) for p in points if name in p})
        if different < least:
            said.append(f"{different} values of {name} in the fit runs, {least} or more are asked")
    if verdict.ambiguous_with:
        said.append(f"{', '.join(verdict.ambiguous_with)}: alike at these operating points")
    return said


def next_experiment(campaign: PreparedCampaign, verdict: Verdict) -> dict[str, Any]:
    """An operating point that the fit runs lack most, and why it would help."""
    points = [run.point for run in campaign.of_role("fit")]
    known = {n: sorted(float(p[n]) for p in points if n in p) for n in LEAST}
    loads, heats, speeds = known["T_1"], known["delta_T"], known["Omega"]
    rivals = [n for n, p in verdict.probabilities.items() if p > FAR]
    why = (
        f"tells {' from '.join(rivals)}" if len(rivals) > 1 else "widens the range of the fit runs"
    )
    return {
        "delta_T": round(_gap_in(heats), 1),
        "K": 0.0,
        "T_1": round(_gap_in(loads), 0),
        "Omega": round(_gap_in(speeds), 3),
        "why": f"{why}: a load, temperature and speed between those that lie furthest apart",
    }


def _gap_in(values: list[float]) -> float:
    """Middle of the widest gap between sorted values; the value if there is but one."""
    if len(values) < 2:
        return values[0] if values else float("nan")
    widths = np.diff(values)
    i = int(np.argmax(widths))
    return 0.5 * (values[i] + values[i + 1])
