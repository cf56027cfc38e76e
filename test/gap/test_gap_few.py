"""What each set of channels leaves open is said, whatever was found with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_support import of_shafts, rig, without

from herringbone_sim.core.model import build
from herringbone_sim.diagnosis.judge import Chance
from herringbone_sim.effects.effect import Active, Locus
from herringbone_sim.effects.registry import effects
from herringbone_sim.gap.attribution.effect_forces import fused_run
from herringbone_sim.gap.attribution.undecidable_by_channels import (
    FEW,
    FULL,
    NO_FORCE,
    NOTHING,
    channel_set,
    planets_indistinguishable,
    undecidable_by_channels,
)
from herringbone_sim.gap.calibrated_fit import Calibrated
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.verdict.decide import NamedExplanation, decide
from herringbone_sim.gap.verdict.location import residual_by_mesh


def test_planets_are_alike_where_neither_phase_nor_channel_tells_one_from_another() -> None:
    """In phase: each change of the gear or of the channels by itself parts them."""
    whole = rig({}, cycles=10).runs[0]
    shafts = of_shafts(whole)
    other = build(shafts.model.parameters.changed({"phasing": "geometric"}))
    gauge = without(whole.F, whole.model.layout.meshes, whole.model.layout.meshes[1:])
    for run, alike in (
        (shafts, True),
        (replace(shafts, model=other), False),
        (replace(shafts, F=gauge), False),
        (replace(shafts, u=whole.u), False),
    ):
        cases = [fused_run(run, fuse(run))]
        assert planets_indistinguishable(cases) == alike
        assert ("any other" in " ".join(undecidable_by_channels(cases))) == alike


def test_a_share_is_spread_over_planets_that_are_alike() -> None:
    """Half of it at each kind of mesh, evenly over three planets and two sides."""
    campaign = rig({}, cycles=10)
    cases = tuple(fused_run(run, fuse(run)) for run in map(of_shafts, campaign.runs))
    pin = Active(effects()["pin_position"], (1e-5,), Locus(planet="2"))
    verdict = decide(
        [Chance(("pin_position",), None, 1.0)], {0: NamedExplanation((pin,))}, "trajectory"
    )
    shares = residual_by_mesh(campaign, Calibrated(cases, np.ones(6), None), verdict)
    assert [share for _, share in shares] == pytest.approx([1.0 / 12.0] * 12)


def test_each_set_of_channels_says_what_it_cannot_decide() -> None:
    whole = rig({}, cycles=10).runs[0]
    layout = whole.model.layout
    no_force = replace(whole, F=without(whole.F, layout.meshes, layout.meshes))
    few = of_shafts(whole)
    nothing = replace(few, u=without(whole.u, layout.bodies, layout.bodies))
    said = {}
    for one in (whole, no_force, few, nothing):
        cases = [fused_run(one, fuse(one))]
        said[channel_set(cases)] = " ".join(undecidable_by_channels(cases))
    assert list(said) == [FULL, NO_FORCE, FEW, NOTHING]
    assert said[FULL] == ""
    assert "errors of force sensors can't be told" in said[NO_FORCE]
    assert "worked out from that of the suns and the carrier" in said[FEW]
    assert "no motion of both suns is recorded" in said[NOTHING]


def test_rotations_of_all_bodies_are_followed_by_windows() -> None:
    """Their slopes are no rates; with rates recorded the balance is formed."""
    whole = rig({}, cycles=10).runs[0]
    meshes = whole.model.layout.meshes
    rates = replace(whole, **{q: without(getattr(whole, q), meshes, meshes) for q in "xF"})
    rotations = replace(rates, v=without(whole.v, meshes, meshes))
    assert GearObservations([rotations]).observation_names == ("trajectory",)
    assert "trajectory" not in GearObservations([rates]).observation_names
    cases = [fused_run(rotations, fuse(rotations))]
    assert channel_set(cases) == FEW
    assert "rates of the bodies are worked out" in " ".join(undecidable_by_channels(cases))


def test_a_mesh_without_force_is_named() -> None:
    whole = rig({}, cycles=10).runs[0]
    one = replace(whole, F=without(whole.F, whole.model.layout.meshes, ("sp2_L", "rp1_R")))
    (said,) = undecidable_by_channels([fused_run(one, fuse(one))])
    assert said.startswith("sp2_L, rp1_R: displacement, rate or force is missing")
