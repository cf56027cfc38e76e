"""What each set of channels leaves open is said, whatever was found with it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from gap_support import rig, without

from herringbone_sim.gap.attribution.channel_sets import (
    FEW,
    FULL,
    NO_FORCE,
    NOTHING,
    cannot_tell,
    channel_set,
)
from herringbone_sim.gap.attribution.hypothesis import case
from herringbone_sim.gap.residuals.fusion import fuse

pytestmark = pytest.mark.filterwarnings("ignore::herringbone_sim.core.parameters.ParameterWarning")


def test_each_set_of_channels_says_what_it_cannot_decide() -> None:
    whole = rig({}, cycles=10).runs[0]
    layout = whole.model.layout
    no_force = replace(whole, F=without(whole.F, layout.meshes, layout.meshes))
    planets = tuple(b for b in layout.bodies if b.startswith("p"))
    few = replace(
        no_force,
        x=without(whole.x, layout.meshes, layout.meshes),
        v=without(whole.v, layout.meshes, layout.meshes),
        u=without(whole.u, layout.bodies, planets),
    )
    nothing = replace(few, u=without(whole.u, layout.bodies, layout.bodies))
    said = {}
    for one in (whole, no_force, few, nothing):
        cases = [case(one, fuse(one))]
        said[channel_set(cases)] = " ".join(cannot_tell(cases))
    assert list(said) == [FULL, NO_FORCE, FEW, NOTHING]
    assert said[FULL] == ""
    assert "errors of force sensors can't be told" in said[NO_FORCE]
    assert "worked out from that of the suns and the carrier" in said[FEW]
    assert "no motion of both suns is recorded" in said[NOTHING]


def test_a_mesh_without_force_is_named() -> None:
    whole = rig({}, cycles=10).runs[0]
    one = replace(whole, F=without(whole.F, whole.model.layout.meshes, ("sp2_L", "rp1_R")))
    (said, balance) = cannot_tell([case(one, fuse(one))])
    assert said.startswith("sp2_L, rp1_R: displacement, rate or force is missing")
    assert balance.startswith("friction and torque ripple can't be told")
