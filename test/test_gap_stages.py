"""What stages make of their numbers: when something is there, and when it is not known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from herringbone_sim.gap.attribution.constancy import Varying
from herringbone_sim.gap.attribution.fit import Fit
from herringbone_sim.gap.attribution.unforced import Unforced
from herringbone_sim.gap.sensors.find import SensorCheck, SensorFinding
from herringbone_sim.gap.verdict.evidence import Evidence
from herringbone_sim.gap.verdict.stages import has_shape, stages_of
from herringbone_sim.gap.verdict.thresholds import frozen_thresholds

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import active
from herringbone_sim.effects.registry import effect
from herringbone_sim.gap.attribution.bodies import BodyFit
from herringbone_sim.gap.attribution.hypothesis import name_of
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.sensors.groups import Group
from herringbone_sim.gap.verdict.decide import decide
from herringbone_sim.gap.verdict.questions import undecidable

MOVING = Unforced(np.ones(6), np.ones(3), ())
QUIET = SensorCheck(1.0, 1.0, 1.0, 1.0, ())
T = frozen_thresholds()


def fitted(left_out: float, *names: str) -> Fit:
    actives = tuple(active(effect(name)) for name in names)
    some = np.ones(3)
    count = sum(len(a.theta) for a in actives)
    return Fit(actives, np.ones(6), np.ones(count), left_out, left_out, some, some, np.eye(3)[0])


def balance(left_out: float, *names: str) -> BodyFit:
    actives = tuple(active(effect(name)) for name in names)
    count = sum(len(a.theta) for a in actives)
    return BodyFit(actives, np.ones(count), np.ones(3), left_out, left_out)


def evidence(**changes: Any) -> Evidence:
    quiet = Evidence(
        QUIET,
        (),
        fitted(1.01),
        (),
        (fitted(1.009, "mean_stiffness"), fitted(1.0095, "backlash_offset")),
        (),
        (balance(1.02), balance(1.019, "torque_ripple")),
        0.02,
        {},
        balance_peak=4.2,
    )
    return replace(quiet, **changes)


def test_a_quiet_rig_has_nothing() -> None:
    verdict = decide(evidence())
    assert verdict.verdict == "none"
    assert verdict.probabilities["none"] > 0.8


def test_what_an_effect_explains_is_named() -> None:
    fits = (fitted(1.02, "mean_stiffness"), fitted(3.0, "backlash_offset"))
    verdict = decide(evidence(nominal=fitted(8.0), fits=fits))
    assert verdict.verdict == "mean_stiffness"
    assert verdict.runner_up is not None
    assert verdict.runner_up.actives[0].effect.id == "backlash_offset"


def test_what_nothing_explains_is_unknown() -> None:
    fits = (fitted(7.5, "mean_stiffness"), fitted(7.6, "backlash_offset"))
    assert decide(evidence(nominal=fitted(8.0), fits=fits)).verdict == "unknown"


@pytest.mark.parametrize(
    ("name", "varying", "verdict"),
    [
        ("mean_stiffness", Varying(0.0, 0.0), "mean_stiffness"),
        ("mean_stiffness", Varying(1.0, 0.0), "unknown"),
        ("mean_stiffness", Varying(0.0, 0.1), "unknown"),
        ("tooth_crack", Varying(1.0, 0.0), "unknown"),
        ("tooth_crack", Varying(0.0, 0.1), "tooth_crack"),  # its catalogue shape may err by load
    ],
)
def test_an_effect_that_changes_on_the_way_is_another_one(
    name: str, varying: Varying, verdict: str
) -> None:
    best = fitted(1.1, name)
    found = evidence(nominal=fitted(8.0), fits=(best,), varying={name_of(best.actives): varying})
    assert decide(found).verdict == verdict


@pytest.mark.parametrize(
    ("left_out", "varying", "reason"),
    [
        (4.0, Varying(0.0, 0.0), "it leaves 43% of the excess"),
        (1.1, Varying(1.0, 0.0), "it would have to change during the runs"),
        (1.1, Varying(0.0, 0.1), "it would have to be another one under light load"),
    ],
)
def test_unknown_tells_what_comes_nearest_and_why_it_is_not_that(
    left_out: float, varying: Varying, reason: str
) -> None:
    best = fitted(left_out, "mean_stiffness")
    found = evidence(nominal=fitted(8.0), fits=(best,), varying={name_of(best.actives): varying})
    nothing = PreparedCampaign("rig", Parameters(), (), {}, ())
    said = undecidable(nothing, found, decide(found))
    assert f"nearest to the forces comes mean_stiffness, but {reason}" in said


@pytest.mark.parametrize(
    ("motion", "shown"), [(None, "the torque balance"), (MOVING, "the motion")]
)
def test_without_forces_what_comes_nearest_is_told_of_the_motion(
    motion: Unforced | None, shown: str
) -> None:
    bodies = (balance(9.0), balance(8.0, "torque_ripple"))
    found = evidence(bodies=bodies, motion=motion)
    nothing = PreparedCampaign("rig", Parameters(), (), {}, ())
    said = undecidable(nothing, found, decide(found))
    assert f"nearest to {shown} comes torque_ripple, but it leaves 88% of the excess" in said


@pytest.mark.parametrize(("after", "there"), [(1.0, True), (1.3, False)])
def test_motion_that_v_does_not_follow_between_samples_excuses_the_accelerations(
    after: float, there: bool
) -> None:
    check = SensorCheck(after, after, after, 1.0, ())
    bodies = (balance(2.5), balance(2.49, "torque_ripple"))
    found = evidence(check=check, nominal=None, fits=(), bodies=bodies, motion=MOVING)
    assert (stages_of(found, T)[-1].gap > 0.5) is there


def test_sensors_that_disagree_in_no_known_way_are_unknown() -> None:
    assert decide(evidence(check=SensorCheck(1.5, 1.5, 1.5, 1.5, ()))).verdict == "unknown"


def test_a_short_event_in_the_balance_is_not_nothing() -> None:
    assert decide(evidence(balance_peak=10.0 * T.peak)).verdict == "unknown"


def test_less_may_be_left_where_the_effect_has_no_shape_of_its_own() -> None:
    assert not has_shape((active(effect("mean_stiffness")),))
    assert has_shape((active(effect("tooth_crack")),))
    left = 1.0 + 7.0 * 0.5 * (T.left + T.left_exact)
    chances = []
    for name in ("mean_stiffness", "tooth_crack"):
        verdict = decide(evidence(nominal=fitted(8.0), fits=(fitted(left, name),)))
        chances.append(verdict.probabilities["unknown"])
    assert chances[0] > chances[1]


def test_a_second_effect_must_take_enough_away() -> None:
    fits = (fitted(2.0, "mean_stiffness"), fitted(3.0, "backlash_offset"))
    little = (fitted(1.97, "mean_stiffness", "backlash_offset"),)
    much = (fitted(1.01, "mean_stiffness", "backlash_offset"),)
    assert len(decide(evidence(nominal=fitted(8.0), fits=fits, pairs=little)).effects) < 2
    both = decide(evidence(nominal=fitted(8.0), fits=fits, pairs=much))
    assert set(both.effects) == {"mean_stiffness", "backlash_offset"}


def test_a_law_that_is_missed_excuses_the_balance() -> None:
    bodies = (balance(1.9), balance(1.89, "torque_ripple"))
    missed = evidence(nominal=fitted(200.0), fits=(fitted(20.0, "damping_law"),), bodies=bodies)
    known = evidence(bodies=bodies)
    assert stages_of(missed, T)[-1].gap < stages_of(known, T)[-1].gap


@pytest.mark.parametrize(("pinned", "there"), [(0.0, True), (3.0, False)])
def test_what_a_free_pin_leaves_of_the_balance_is_no_friction(pinned: float, there: bool) -> None:
    found = evidence(
        nominal=fitted(8.0),
        fits=(fitted(1.02, "bearing_clearance"),),
        bodies=(balance(1.77), balance(1.62, "tooth_friction")),
        balance_pinned=pinned,
    )
    assert (stages_of(found, T)[-1].gap > 0.5) is there


def test_a_force_sensor_that_settles_little_of_the_balance_is_not_preferred() -> None:
    fits = (fitted(1.02, "contact_nonlinearity"), fitted(5.0, "sensor_gain"))
    key = "sensor_gain{'channels': ('F',)} all/all/all"
    shaken = evidence(
        nominal=fitted(8.0),
        fits=fits,
        bodies=(balance(4001.0), balance(1.1, "torque_ripple")),
        balance_excess=4000.0,
        by_force={key: 3800.0},
    )
    assert set(decide(shaken).effects) == {"contact_nonlinearity", "torque_ripple"}


@pytest.mark.parametrize("name", ["none", "unknown"])
def test_probabilities_sum_to_one_over_the_catalogue(name: str) -> None:
    chances = decide(evidence()).probabilities
    assert name in chances
    assert sum(chances.values()) == pytest.approx(1.0)


@pytest.mark.parametrize(("corrected", "verdict"), [(1.02, "sensor_bias"), (1.8, "unknown")])
def test_a_sensor_is_named_where_its_error_puts_it_right(corrected: float, verdict: str) -> None:
    names = ("x_sp1_L",)
    where = Group("x", "sp", "1", "L", names, np.arange(33) == 0)
    found = SensorFinding("sensor_bias", where, 1e-6, 1e-9, "m", 1.0, ())
    assert (
        decide(evidence(check=SensorCheck(2.0, 1.0, corrected, 1.0, (found,)))).verdict == verdict
    )


def test_a_cause_is_told_with_the_channels_of_the_residual_that_shows_it() -> None:
    names = ("u_s_L", "u_c")
    found = SensorFinding(
        "channel_swap", Group("u", "", "", "", names, np.arange(33) > 30), 1.0, 0.0, "-", 1.0, ()
    )
    shown = evidence(
        check=SensorCheck(60.0, 1.0, 1.01, 1.0, (found,)),
        fits=(fitted(1.005, "channel_swap"), fitted(1.0095, "backlash_offset")),
    )
    option, i = decide(shown).best["channel_swap"]
    assert option.actives[i].chosen["channels"] == names


def test_motion_between_samples_that_v_does_not_follow_is_no_wrong_sensor() -> None:
    assert decide(evidence(check=SensorCheck(1.5, 1.5, 1.5, 1.0, ()))).verdict == "none"
