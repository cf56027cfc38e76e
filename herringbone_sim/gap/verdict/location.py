"""Locate the residual on the gear: fraction at each mesh."""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.effects.effect import Locus
from herringbone_sim.gap.attribution.undecidable_by_channels import planets_indistinguishable
from herringbone_sim.gap.calibrated_fit import Calibrated
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.verdict.decide import Verdict


def residual_by_mesh(
    campaign: PreparedCampaign, calibrated: Calibrated, verdict: Verdict
) -> list[tuple[Locus, float]]:
    """Meshes with their fraction of the residual of the calibrated force law, largest first.

    Fractions are of chi2 above the noise; they sum to 1, or are all 0. Without a force-law
    residual, they are of the probability of a cause: that of each effect is divided equally among
    the meshes of its most probable locus, and among planets that the data can't distinguish. Empty
    where no effect is named either.
    """
    weight = calibrated.per_mesh
    if weight is None:
        weight = _cause_probability(campaign, verdict)
        if weight is not None and planets_indistinguishable(calibrated.cases):
            planets = campaign.nominal.layout.n_classes
            weight = np.repeat(weight.reshape(-1, planets).mean(axis=1), planets)
    else:
        weight = np.maximum(weight - 1.0, 0.0)
    if weight is None:
        return []
    shares = weight / weight.sum() if weight.sum() > 0.0 else weight
    layout = calibrated.cases[0].run.model.layout
    places = [
        Locus(mesh, planet, side)
        for mesh in ("sp", "rp")
        for side in ("L", "R")
        for planet in (layout.planets if layout.numbered else ("all",))
    ]
    shared = zip(places, (float(s) for s in shares), strict=True)
    return sorted(shared, key=lambda pair: -pair[1])


def _cause_probability(campaign: PreparedCampaign, verdict: Verdict) -> Array | None:
    """Sum the probabilities of effects, each divided equally among its meshes, to (n_mesh,).

    Its meshes are those of its place in ``Verdict.best``, perhaps none. None if
    ``Verdict.effects`` is empty.
    """
    if not verdict.effects:
        return None
    layout = campaign.nominal.layout
    total = np.zeros(layout.n_mesh)
    for effect, (option, place) in verdict.best.items():
        on = option.actives[place].locus.mask(layout) if option.actives else np.zeros(len(total))
        if on.any():
            total += verdict.probabilities[effect] * on / on.sum()
    return total
