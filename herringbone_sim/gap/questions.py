"""What a diagnosis leaves open, where the residual lies, and what to measure next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from herringbone_sim.effects.effect import Locus
from herringbone_sim.gap.attribute import Evidence
from herringbone_sim.gap.channel_sets import cannot_tell
from herringbone_sim.gap.decide import Verdict
from herringbone_sim.gap.prepared import PreparedCampaign
from herringbone_sim.gap.screen import Finding

FAR = 0.3  # a probability from which a rival is worth an experiment
LEAST = {"delta_T": 3, "T_1": 3, "Omega": 2}


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


def mismatched(findings: Sequence[Finding]) -> bool:
    """Whether the nominal file is that of another rig."""
    return any(finding.what == "nominal" for finding in findings)


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
