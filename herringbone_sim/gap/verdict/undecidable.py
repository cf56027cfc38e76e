"""Sentences for the report on the questions that a diagnosis leaves open."""

from __future__ import annotations

from collections.abc import Sequence

from herringbone_sim.gap.attribution.undecidable_by_channels import undecidable_by_channels
from herringbone_sim.gap.calibrated_fit import Calibrated
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.verdict.decide import CLASS_PROBABILITY, Verdict
from herringbone_sim.gap.verdict.effect_texts import effect_names, in_words

# Probability above which an effect outside the verdict is reported as not excluded.
POSSIBLE = 1.0 - CLASS_PROBABILITY
OTHER = {
    "none": "that there is no gap beyond tolerance and noise",
    "unknown": "a cause outside the catalogue",
}
LEAST_VALUES = {"delta_T": 3, "T_1": 3, "Omega": 2}  # least number of different values in fit runs


def nominal_mismatched(findings: Sequence[Finding]) -> bool:
    """Whether a finding says that the nominal file describes another rig."""
    return any(finding.what == "nominal" for finding in findings)


def undecidable(
    campaign: PreparedCampaign,
    calibrated: Calibrated,
    verdict: Verdict,
    findings: Sequence[Finding] = (),
) -> list[str]:
    """Sentences on what the data can't decide, by channels, operating points and verdict.

    Empty if the nominal file describes another rig.
    """
    if nominal_mismatched(findings):
        return []
    limits = undecidable_by_channels(calibrated.cases)
    points = [run.point for run in campaign.of_role("fit")]
    for name, least in LEAST_VALUES.items():
        different = len({round(float(p[name]), 6) for p in points if name in p})
        if different < least:
            values = "value" if different == 1 else "values"
            limits.append(
                f"{different} {values} of {name} in the fit runs, {least} or more are asked"
            )
    return [*limits, *_other_explanations(verdict)]


def _other_explanations(verdict: Verdict) -> list[str]:
    """Sentences on other explanations that the data do not exclude."""
    alike, chances = verdict.ambiguous_with, verdict.probabilities
    sentences = []
    if alike:
        odds = [f"{name} ({chances[name]:.0%})" for name in alike]
        sentences.append(
            f"{in_words(odds)} change the forces alike at these operating points: any of them may "
            "be the cause"
        )
    if verdict.verdict == "unknown" and not verdict.unobserved:
        sentences.append("no effect of the catalogue explains the gap: what it comes from is open")
        if verdict.chosen is not None:
            sentences.append(
                f"nearest comes {effect_names(verdict.chosen.actives)}, but it leaves too much"
            )
    incomplete = [c for c in verdict.chances if not c.whole]
    second = sum(c.probability for c in incomplete if c.effects[0] in verdict.effects)
    if second > POSSIBLE:
        sentences.append(
            f"something beside {in_words(verdict.effects)} that was not found is not excluded: "
            f"probability {second:.0%}"
        )
    alone = dict(chances)
    alone["unknown"] = alone.get("unknown", 0.0) - 0.5 * sum(c.probability for c in incomplete)
    mentioned = {*alike, *verdict.effects, verdict.verdict}
    others = [name for name in alone if alone[name] > POSSIBLE and name not in mentioned]
    for name in sorted(others, key=lambda other: -alone[other]):
        sentences.append(f"{OTHER.get(name, name)} is not excluded: probability {alone[name]:.0%}")
    return sentences
