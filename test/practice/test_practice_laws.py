"""Laws of effects come from families of curves, foreign causes from random physics."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from herringbone_sim.practice.apply_causes import event
from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.kernel import rate
from herringbone_sim.practice.laws import (
    F_0,
    FAMILIES,
    FROM,
    TO,
    contact,
    damping_factor,
    friction,
    warm,
    window,
)
from herringbone_sim.practice.observe import largest, observe_run, pooled, simulate_run
from herringbone_sim.practice.plan import KINDS, draw_plan
from herringbone_sim.practice.random_physics import INPUTS, KNOWN, TARGETS, function
from herringbone_sim.practice.rig_model import NOMINAL, rig_model
from herringbone_sim.practice.shapes import random_function, read
from herringbone_sim.practice.solve import solve_size
from herringbone_sim.practice.stepper import integrate
from herringbone_sim.practice.tables import GRID, deflections, table

POINTS = [{"delta_T": T, "K": 0.1, "T_1": 800.0, "Omega": 1.0} for T in (10.0, 50.0, 90.0)]
SEEDS = range(40, 50)


def accelerations(cause, point, cycles):
    """What a machine does at states that load every mesh either way; (states, 15).

    Args:
        cycles: first and last mesh cycle of the states.
    """
    p = rig_model(NOMINAL, point)
    if cause is not None:
        p = KINDS[cause.internal].apply(p, cause, point)
    rng = np.random.default_rng(5)
    found = []
    for phase in 2.0 * np.pi * rng.uniform(*cycles, 150):
        y = np.concatenate([3.5e-5 * rng.normal(size=15), 0.5 * rng.normal(size=15)])
        y[9:11] *= 0.02
        y[11:14] = y[2] + 0.05 * y[11:14]
        dy = np.zeros(30)
        rate(p, 0.0, phase, y, dy, np.zeros(12), np.zeros(15), np.zeros(24))
        found.append(dy[15:] * p.mass)
    return np.array(found)


@pytest.mark.parametrize("name", FAMILIES)
def test_a_family_holds_curves_far_from_the_catalogue(name):
    """Of what some add, the best multiple of the catalogue's curve leaves more than a tenth.

    That is as much as the noise where the effect is ten times the noise.
    """
    shares = []
    for seed in SEEDS:
        plan = draw_plan(seed, name, law="other")
        other = plan.causes[0]
        assert other.shape["law"] == "other"
        assert json.loads(json.dumps(other.shape["curve"])) == other.shape["curve"]
        plain = {k: v for k, v in other.shape.items() if k != "curve"}
        both = [other, replace(other, shape={**plain, "law": "catalogue"})]
        cycles = (0.0, 77.0)
        if "at" in other.shape:
            first = event(rig_model(NOMINAL, POINTS[0]), other, 3).event[1, other.meshes > 0.0][0]
            cycles = (first - 1.5, first + 2.5)
        bare = [accelerations(None, at, cycles) for at in POINTS]
        added = [
            np.concatenate(
                [accelerations(c, at, cycles) - b for at, b in zip(POINTS, bare, strict=True)]
            )
            for c in both
        ]
        one, known = (values.ravel() for values in added)
        left = one - known * (one @ known) / (known @ known)
        shares.append(np.linalg.norm(left) / np.linalg.norm(one))
    assert max(shares) > 0.1
    assert min(shares) > 1e-3


@pytest.mark.parametrize("seed", range(8))
def test_curves_are_still_what_the_effect_says(seed):
    rng = np.random.default_rng(seed)
    bump = window(FAMILIES["tooth_crack"](rng))
    assert (bump[0], bump[-1], bump.max()) == (pytest.approx(0, abs=1e-12),) * 2 + (1.0,)
    assert bump.min() > -1e-12
    grows = contact(FAMILIES["contact_nonlinearity"](rng), 0.2)
    assert np.all(np.diff(grows) >= 0.0)
    low, middle, high = np.interp([FROM, F_0, TO], deflections(), grows)
    assert middle == pytest.approx(1.0, abs=0.02)
    assert (high - low) / np.log(TO / FROM) == pytest.approx(0.2, abs=0.05) or low == 0.1
    lives = damping_factor(FAMILIES["damping_law"](rng))
    assert np.all(np.diff(lives) >= -1e-12)
    assert lives[-1] > lives[0] >= 0.0
    rub = friction(FAMILIES["tooth_friction"](rng))
    assert np.all(rub * (GRID - 0.5) >= 0.0)
    assert warm(FAMILIES["thermal_backlash"](rng), 50.0) == 50.0


def test_tables_read_back_what_they_hold():
    values = np.sin(3.0 * GRID)
    found = np.array([read(table(values), z) for z in (0.0, 0.123, 0.5, 1.0, 1.7)])
    at = np.array([0.0, 0.123, 0.5, 1.0, 1.0])
    np.testing.assert_allclose(found[:, 0], np.sin(3.0 * at), atol=1e-5)
    np.testing.assert_allclose(found[:4, 1], 3.0 * np.cos(3.0 * at[:4]), atol=0.02)


def test_a_tooth_of_a_planet_meets_the_ring_half_a_turn_after_the_sun():
    after = {"catalogue": set(), "other": set()}
    for seed in range(120):
        for law, found in after.items():
            cause = draw_plan(seed, "tooth_spall", law=law).causes[0]
            if cause.shape["member"] == "planet" and cause.locus["mesh"] == "all":
                starts = event(rig_model(NOMINAL, POINTS[0]), cause, 4).event[
                    1, cause.meshes > 0.0
                ]
                found.add(float((starts[-1] - starts[0]) % 25.0))
    assert {round(one, 9) for one in after["catalogue"]} == {12.0}
    assert {round(one, 9) for one in after["other"]} == {12.0, 12.5, 13.0}


def test_the_law_stands_in_the_label():
    plans = [draw_plan(seed, "runout") for seed in range(40)]
    other = sum(plan.causes[0].shape["law"] == "other" for plan in plans)
    assert 10 < other < 30
    made = make_campaign(draw_plan(1, "profile_error", 3.0, law="other"))
    (told,) = made.label["effects"]
    assert (made.label["law"], told["law"]) == ("other", "other")
    assert len(told["shape"]["curve"]["riders"]) >= 2
    assert draw_plan(1, "mean_stiffness", law="other").causes[0].shape.get("law") is None
    assert make_campaign(draw_plan(104, "none")).label["law"] == "none"


def wild_causes(count):
    return [draw_plan(seed, "random_physics").causes[0] for seed in range(count)]


def test_random_physics_draws_inputs_targets_and_places_outside_the_catalogue():
    causes = wild_causes(150)
    assert {c.shape["target"] for c in causes} == set(TARGETS[1:])
    assert set().union(*(c.shape["inputs"] for c in causes)) == set(INPUTS)
    assert {len(c.shape["inputs"]) for c in causes} == {1, 2, 3}
    assert len({c.meshes.tobytes() for c in causes}) > 15
    assert all(set(c.shape["inputs"]) not in KNOWN[c.shape["target"]] for c in causes)
    assert {c.effect for c in causes} == {"unknown"}
    rng = np.random.default_rng(3)
    for cause in causes[:20]:
        heights, weights, angles, mean = function(cause.shape)
        scale = [1.5, 1.5, 2.0 * np.pi, 1.5, 1.0, 2.0 * np.pi, 0.6, 1.5]
        at = rng.uniform(0.0, 1.0, (5000, 8)) * scale
        values = np.cos(at @ weights.T + angles) @ heights - mean
        assert 0.2 < np.sqrt(np.mean(values**2)) < 3.0
        used = {INPUTS[i] for i in np.flatnonzero(np.abs(weights).sum(axis=0))}
        assert used == set(cause.shape["inputs"])


def test_a_random_displacement_moves_at_the_rate_it_claims():
    cause = next(c for c in wild_causes(60) if c.shape["target"] == "displacement")
    p = KINDS["random_physics"].apply(rig_model(NOMINAL, POINTS[0], 1e-2), cause, POINTS[0])
    for phase in (0.4, 9.0):
        near = [
            random_function(p, 0.0, 0.0, 0.0, phase + off, (phase + off) / p.omega, 0.0)
            for off in (-1e-5, 1e-5)
        ]
        middle = random_function(p, 0.0, 0.0, 0.0, phase, phase / p.omega, 0.0)
        assert (near[1][0] - near[0][0]) / 2e-5 == pytest.approx(middle[1], rel=1e-5, abs=1e-7)


def test_an_own_state_follows_its_mesh_and_remembers():
    cause = next(c for c in wild_causes(80) if c.shape.get("follows") == "deflection")
    p = KINDS["random_physics"].apply(rig_model(NOMINAL, POINTS[0]), cause, POINTS[0])
    p = p._replace(random=p.random._replace(size=0.0 * p.random.size))
    times = np.arange(4000) * 2e-7
    states, _, _ = integrate(p, 0.0, np.zeros(30), times, 1e-9)
    assert states.shape == (4000, 42)
    x = (states[:, 3] - states[:, 2]) * p.cos_beta - p.error[6] * np.sin(p.omega * times)
    f = 1e5 * (x - np.clip(x, -p.half_back[6], p.half_backlash[6]))
    slope = np.gradient(states[:, 36], times)
    expected = p.random.own_rate * (f - states[:, 36])
    assert np.abs(slope - expected)[5:-5].max() < 0.02 * np.abs(expected).max()
    assert np.ptp(states[:, 36]) > 1e-3


@pytest.mark.parametrize("seed", [1, 4])
def test_random_physics_is_scaled_to_the_detectability(seed):
    plan = draw_plan(seed, "random_physics", 3.0)
    rig = NOMINAL.scaled(plan.factors)
    cause, d = solve_size(plan, rig, plan.causes[0])
    assert d == pytest.approx(3.0, rel=0.15)
    moved = [simulate_run(plan, rig, (cause,), i) for i in range(5)]
    most = largest([one.now for one in moved])
    found = [observe_run(plan, rig, (cause,), i, one, most).measure for i, one in enumerate(moved)]
    assert pooled(found) == pytest.approx(3.0, rel=0.2)
