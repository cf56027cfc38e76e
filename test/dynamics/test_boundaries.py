"""Boundaries with known places: flips, folds, Neimark-Sacker, transverse, grazing; the gear's."""

from __future__ import annotations

import numpy as np
import pytest
from gears import samples, state_at
from orbit_support import (
    SWAP,
    OneSidedOscillator,
    branch_of,
    coupled,
    delayed_logistic,
    henon,
    logistic,
    repelling,
)

from herringbone_sim.core.mirror import layout_mirror
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.boundaries import find_boundaries
from herringbone_sim.dynamics.cascade import CascadeOptions, trace_cascade
from herringbone_sim.dynamics.continuation import StepControl
from herringbone_sim.dynamics.curve import Family
from herringbone_sim.dynamics.flow import GearFlow, iterate, settle
from herringbone_sim.dynamics.gear_family import gear_family
from herringbone_sim.dynamics.orbits import closest_return, find_orbit
from herringbone_sim.dynamics.turning import border_passes, turning_points

# Three equally spaced planets can't be assembled with the paper's teeth.


def test_the_flip_and_the_fold_of_the_henon_map():
    curve, branch = branch_of(henon, -0.5, 0.5, [0.7, 0.2], 0.2, steps=StepControl(points=250))
    found = {one.kind: one for one in find_boundaries(curve, branch)}
    assert set(found) == {"flip", "fold"}
    assert found["fold"].value == pytest.approx(-(0.7**2) / 4, abs=1e-9)
    assert found["fold"].multiplier == pytest.approx(1.0, abs=1e-6)
    assert found["flip"].value == pytest.approx(3 * 0.7**2 / 4, abs=1e-9)
    assert found["flip"].multiplier == pytest.approx(-1.0, abs=1e-6)
    assert found["flip"].width < 1e-9
    assert all(one.changes_stability for one in found.values())


def test_the_cascade_of_the_logistic_map_from_one_orbit():
    """Flips at 3, 1 + sqrt(6), 3.5440903596 and 3.5644072661 (OEIS A086180, A091517)."""
    found = trace_cascade(
        Family(logistic, 2.5, 3.57), [(2.8, np.array([[0.6]]))], None, CascadeOptions(16)
    )
    assert [one.period for one in found] == [1, 2, 4, 8, 16]
    flips = [b.value for one in found for b in one.boundaries if b.kind == "flip"][:4]
    expected = [3.0, 1 + np.sqrt(6), 3.5440903596, 3.5644072661]
    assert flips == pytest.approx(expected, abs=1e-8)


def test_the_cascade_is_the_same_from_its_middle():
    """From P4 on, its parents are found where it halves, and no branch twice."""
    start = closest_return(logistic(3.5), np.array([0.38282]), 4, 100)
    found = trace_cascade(Family(logistic, 2.5, 3.54), [(3.5, start)], None, CascadeOptions(4))
    assert sorted(one.period for one in found) == [1, 2, 4]
    assert sorted(b.value for one in found for b in one.boundaries) == pytest.approx(
        [3.0, 1 + np.sqrt(6)], abs=1e-8
    )


def test_period_three_of_the_logistic_map_is_born_in_a_fold():
    start = closest_return(logistic(3.84), np.array([0.1494]), 3, 100)
    curve, branch = branch_of(logistic, 3.7, 3.86, start, 3.84)
    kinds = [(one.kind, one.value) for one in find_boundaries(curve, branch)]
    assert ("fold", pytest.approx(1 + np.sqrt(8), abs=1e-9)) in kinds
    assert ("flip", pytest.approx(3.8414990075, abs=1e-8)) in kinds


def test_the_neimark_sacker_boundary_of_the_delayed_logistic_map():
    curve, branch = branch_of(delayed_logistic, 1.5, 2.3, [0.4, 0.4], 1.7)
    (one,) = find_boundaries(curve, branch)
    assert one.kind == "Neimark-Sacker"
    assert one.value == pytest.approx(2.0, abs=1e-9)
    assert one.multiplier.real == pytest.approx(0.5, abs=1e-6)
    assert (one.before, one.after) == ((0, 0), (2, 0))


def test_multipliers_that_meet_off_the_circle_are_no_boundary():
    curve, branch = branch_of(repelling, 2.2, 2.7, [0.0, 0.0], 2.3)
    (one,) = find_boundaries(curve, branch)
    assert one.kind == "crossing"
    assert one.value == pytest.approx(2.5, abs=1e-9)
    assert (one.before, one.after) == ((2, 0), (1, 0))


def test_symmetry_breaks_where_the_transverse_multiplier_says():
    """Within the symmetric states the flip is at r = 3, across them at 2 + 1 / 0.8."""
    curve, branch = branch_of(lambda r: coupled(r, 0.1), 2.5, 3.5, [0.6, 0.6], 2.6, SWAP)
    flip, transverse = find_boundaries(curve, branch)
    assert (flip.kind, transverse.kind) == ("flip", "transverse")
    assert flip.value == pytest.approx(3.0, abs=1e-9)
    assert transverse.value == pytest.approx(2 + 1 / 0.8, abs=1e-9)
    assert transverse.detail == "multiplier -1"
    assert (transverse.before, transverse.after) == ((1, 0), (1, 1))


def test_a_branch_with_unlike_sides_leaves_a_symmetric_one():
    family = Family(lambda r: coupled(r, 0.1), 2.5, 3.5, SWAP)
    starts = [(2.6, np.array([[0.6, 0.6]]))]
    without = trace_cascade(family, starts, None, CascadeOptions(2))
    found = trace_cascade(family, starts, None, CascadeOptions(2, asymmetric=True))
    assert all(one.symmetric for one in without)
    apart = [one for one in found if not one.symmetric]
    assert len(found) == len(without) + len(apart)
    assert apart[0].branch.points[0].value == pytest.approx(3.25, abs=1e-3)
    points = apart[0].branch.points[-1].orbit.points
    assert points == pytest.approx(points[::-1, SWAP], abs=1e-7)
    assert np.abs(points[:, 0] - points[:, 1]).max() > 0.1


def test_grazing_is_where_the_free_motion_reaches_the_stop():
    """Below it the orbit does not know of the stop; what grazes here does not lose stability."""
    reach = OneSidedOscillator(1.0).amplitude
    curve, branch = branch_of(
        OneSidedOscillator, 0.95 * reach, 1.05 * reach, OneSidedOscillator(9.0).free.orbit, reach
    )
    found = find_boundaries(curve, branch, lambda gap, y: OneSidedOscillator(gap).touches(y))
    (grazing,) = [one for one in found if one.kind == "grazing"]
    assert grazing.value == pytest.approx(reach, rel=1e-5)
    assert grazing.detail == "stop"
    assert grazing.before == (0, 0)
    assert grazing.changes_stability == (grazing.after != (0, 0))


def test_turning_points_of_a_sine():
    t = np.arange(64) * 2 * np.pi / 64
    heights = turning_points(0.3 + np.sin(t - 0.4), np.cos(t - 0.4), t[1])
    assert np.sort(heights) == pytest.approx([-0.7, 1.3], abs=2e-7)


@pytest.fixture
def paper():
    """The paper's gear."""
    return Parameters(thermal_rp="sun", projection="torque", gamma=1.2e-5)


def make_at(p, delta_T, **values):
    return build(p.changed({"delta_T": delta_T} | values))


def test_borders_are_passed_an_even_number_of_times(paper):
    family, watch = gear_family(paper, "delta_T", 60.0, 100.0)
    flow = family.flow_at(85.0)
    assert isinstance(flow, GearFlow)
    y = settle(flow, flow.start(), 400)
    passes = watch(85.0, y[None])
    assert set(passes) == {
        f"{k}_L = {k}_R {side}" for k in ("sp", "rp") for side in ("drive", "back")
    }
    assert all(count % 2 == 0 for count in passes.values())
    assert sum(passes.values()) > 0
    single = border_passes(flow, y[None])
    assert single["sp_L drive"] == single["sp_R drive"] == passes["sp_L = sp_R drive"]


def test_at_a_grazing_of_the_gear_a_mesh_turns_back_on_its_border(paper):
    """P1 over delta_T: the ring mesh just reaches x = -b' there, by 2048 samples of the cycle."""
    family, watch = gear_family(paper, "delta_T", 63.0, 67.0)
    flow = family.flow_at(66.0)
    orbit = find_orbit(flow, settle(flow, flow.start(), 600), mirror=family.mirror)
    (one,) = trace_cascade(family, [(66.0, orbit.points)], watch, CascadeOptions(1))
    (grazing,) = one.boundaries
    assert (grazing.kind, grazing.detail) == ("grazing", "rp_L = rp_R back")
    assert not grazing.changes_stability
    model = make_at(paper, grazing.value, samples_per_cycle=2048)
    y = np.array(grazing.point.orbit.points[0])
    x = samples(model, 1, state_at(y)).rows[:, 5:9] / model.scales.b_c
    assert x[:, 2].min() == pytest.approx(-model.packed.b[2], abs=1e-6)


def test_the_flip_of_the_gear_is_where_its_simulated_period_doubles(paper):
    p = paper.changed({"delta_T": 50.0})
    family, watch = gear_family(p, "xi", 0.155, 0.175)
    flow = family.flow_at(0.17)
    orbit = find_orbit(flow, settle(flow, flow.start(), 500), mirror=layout_mirror(p.layout))
    found = trace_cascade(family, [(0.17, orbit.points)], watch, CascadeOptions(2))
    flip = next(b for one in found for b in one.boundaries if b.kind == "flip")
    assert [one.period for one in found] == [1, 2]
    for away, period in ((-5e-4, 2), (5e-4, 1)):
        near = family.flow_at(flip.value + away)
        last = iterate(near, settle(near, near.start(), 5000), 3)
        assert (np.abs(last[1] - last[0]).max() > 1e-4) == (period == 2)
        assert last[2] == pytest.approx(last[0], abs=1e-5)


def test_period_four_of_the_gear_ends_in_the_flip_of_period_two(paper):
    """And does not fall onto period two before: its last orbit is at the flip of that branch."""
    family, _ = gear_family(paper.changed({"delta_T": 50.0}), "xi", 0.135, 0.15)
    flow = family.flow_at(0.14)
    start = closest_return(flow, settle(flow, flow.start(), 600), 4, 20)
    four, two = trace_cascade(family, [(0.14, start)], None, CascadeOptions(4))
    assert (four.period, two.period) == (4, 2)
    assert four.branch.ends[1] == "halved"
    flip = next(one for one in two.boundaries if one.kind == "flip")
    assert four.branch.points[-1].value == pytest.approx(flip.value, abs=1e-6)
    assert any(one.kind == "fold" and one.value > flip.value for one in four.boundaries)


def test_period_two_of_the_gear_ends_in_a_fold_beside_a_stable_period_one(paper):
    """Over delta_T, the branch of P2 turns back while P1 is stable on both sides."""
    family, _ = gear_family(paper, "delta_T", 76.0, 100.0)
    flow = family.flow_at(78.0)
    start = closest_return(flow, settle(flow, flow.start(), 500), 2, 10)
    (two,) = trace_cascade(family, [(78.0, start)], None, CascadeOptions(2))
    (fold,) = [b for b in two.boundaries if b.kind == "fold"]
    below = family.flow_at(fold.value - 0.05)
    above = family.flow_at(fold.value + 0.05)
    kept, lost = (
        iterate(f, settle(f, fold.point.orbit.points[0], 3000), 2) for f in (below, above)
    )
    assert np.abs(kept[1] - kept[0]).max() > 1e-3
    assert lost[1] == pytest.approx(lost[0], abs=1e-6)
