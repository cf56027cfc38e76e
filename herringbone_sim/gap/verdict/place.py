"""Where the residual of the recalibrated law lies: meshes, and whatever else it goes with."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.effects.effect import Locus
from herringbone_sim.gap.attribution.channel_sets import planets_indistinguishable
from herringbone_sim.gap.calibrated import Calibrated
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.residuals.locate import Periodicity, Share, locate
from herringbone_sim.gap.residuals.recalibrate import force_law
from herringbone_sim.gap.verdict.decide import Verdict

Array = NDArray[np.float64]

SEED = 21  # of the permutations
PERMUTATIONS = 200


def where(
    campaign: PreparedCampaign, found: Calibrated, verdict: Verdict
) -> list[tuple[Locus, float]]:
    """Share of every mesh in what the recalibrated law leaves above the noise; 0 if nothing.

    Without a force at a mesh it is the probability that the cause sits there: that of each effect,
    even over the meshes of its likeliest place, and over planets that nothing tells apart.
    """
    above = found.per_mesh
    if above is None:
        above = _probable(campaign, verdict)
        if above is not None and planets_indistinguishable(found.cases):
            planets = campaign.nominal.layout.n_classes
            above = np.repeat(above.reshape(-1, planets).mean(axis=1), planets)
    else:
        above = np.maximum(above - 1.0, 0.0)
    if above is None:
        return []
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


def _probable(campaign: PreparedCampaign, verdict: Verdict) -> Array | None:
    """(n_mesh,) probability of the effects at each mesh; None where no effect is named."""
    if not verdict.effects:
        return None
    layout = campaign.nominal.layout
    total = np.zeros(layout.n_mesh)
    for effect, (option, place) in verdict.best.items():
        on = option.actives[place].locus.mask(layout) if option.actives else np.zeros(len(total))
        if on.any():
            total += verdict.probabilities[effect] * on / on.sum()
    return total


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
