"""Where the residual of the recalibrated law lies: meshes, and whatever else it goes with."""

from __future__ import annotations

from typing import Any

import numpy as np

from herringbone_sim.effects.effect import Locus
from herringbone_sim.gap.calibrated import Calibrated
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.residuals.locate import Periodicity, Share, locate
from herringbone_sim.gap.residuals.recalibrate import force_law

SEED = 21  # of the permutations
PERMUTATIONS = 200


def where(campaign: PreparedCampaign, found: Calibrated) -> list[tuple[Locus, float]]:
    """Share of every mesh in what the recalibrated law leaves above the noise; 0 if nothing."""
    if found.per_mesh is None:
        return []
    above = np.maximum(found.per_mesh - 1.0, 0.0)
    shares = above / above.sum() if above.sum() > 0.0 else above
    layout = found.cases[0].run.model.layout
    places = [
        Locus(mesh, planet, side)
        for mesh in ("sp", "rp")
        for side in ("L", "R")
        for planet in (layout.planets if layout.numbered else ("all",))
    ]
    shared = zip(places, (float(s) for s in shares), strict=True)
    return sorted(shared, key=lambda pair: -pair[1])


def structure(campaign: PreparedCampaign, found: Calibrated) -> dict[str, Any]:
    """Shares by contact, phase, load and so on, teeth and shaft orders; empty without forces."""
    if found.per_mesh is None:
        return {}
    cases = found.cases
    laws = [force_law(c.run, c.fused, found.factors) for c in cases]
    rng = np.random.default_rng(SEED)
    located = locate([c.run for c in cases], laws, campaign.meshes, rng, PERMUTATIONS)
    return {
        "shares": {factor: _share(share) for factor, share in located.shares.items()},
        "teeth": {member: _beyond(one) for member, one in located.teeth.items()},
        "shaft_orders": _beyond(located.shaft),
    }


def _share(one: Share) -> list[dict[str, Any]]:
    rows = zip(one.labels, one.share, one.chi2, strict=True)
    return [{"at": at, "share": float(s), "chi2": float(c)} for at, s, c in rows]


def _beyond(one: Periodicity) -> list[str]:
    """What repeats beyond chance."""
    return list(one.beyond)
