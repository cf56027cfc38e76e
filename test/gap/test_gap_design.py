"""The next operating point tells rivals apart, or the report says that none in reach does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gap_support import NOMINAL, OMEGA_N, noisy, prepared

from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import ALL, Active, active
from herringbone_sim.effects.registry import effect
from herringbone_sim.effects.stepper import simulate
from herringbone_sim.gap.attribution.effect_forces import FusedRun, fused_run
from herringbone_sim.gap.calibrated_fit import Calibrated
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.verdict.augmented import nominal_model
from herringbone_sim.gap.verdict.candidate_points import (
    LEVELS,
    candidate_points,
    predict_run,
    value_ranges,
)
from herringbone_sim.gap.verdict.decide import NamedExplanation, Verdict
from herringbone_sim.gap.verdict.discrimination import (
    BALANCE,
    FORCES,
    MOTION,
    ExplanationAtFit,
    linear_predictions,
    separation,
)
from herringbone_sim.gap.verdict.experiment_design import Design, design, leading_explanations
from herringbone_sim.gap.verdict.next_experiment import next_experiment
from herringbone_sim.gap.verdict.undecidable import undecidable

Point = Mapping[str, float]
ONE_HEAT = (
    {"delta_T": 50.0, "K": 0.0, "T_1": 283.0, "Omega": 0.942},
    {"delta_T": 50.0, "K": 0.0, "T_1": 1500.0, "Omega": 0.4},
    {"delta_T": 50.0, "K": 0.05, "T_1": 1000.0, "Omega": 0.7},
)
ONE_LOAD = tuple(
    {"delta_T": hot, "K": 0.0, "T_1": 900.0, "Omega": speed}
    for hot, speed in ((20.0, 0.15), (50.0, 0.25), (80.0, 0.2))
)
QUIET = NOMINAL.changed({"e_m": 0.0005, "k_amp": [0.02]})


def planted(name: str, **values: Any) -> Active:
    return active(effect(name), ALL, values)


def rig(truth: Sequence[Active], points: Sequence[Point], gear: Parameters) -> PreparedCampaign:
    """Runs of a gear with effects, 1 % of noise on every channel."""
    runs = []
    for i, point in enumerate(points):
        model = build(gear.changed({**point, "omega_n": OMEGA_N}))
        _, settled = simulate(model, truth, 60)
        series, _ = simulate(model, truth, 40, settled)
        runs.append(prepared(noisy(series, 0.01, i), point, name=f"run_{i:02d}", nominal=gear))
    return PreparedCampaign("planted", gear, tuple(runs), ())


def cases_of(campaign: PreparedCampaign) -> tuple[FusedRun, ...]:
    return tuple(fused_run(run, fuse(run)) for run in campaign.runs)


def calibrated(campaign: PreparedCampaign) -> Calibrated:
    return Calibrated(cases_of(campaign), np.ones(6), None)


def between(truth: Active, rival: Active) -> Verdict:
    """Two explanations that the runs so far leave alike."""
    options = {one.effect.id: NamedExplanation((one,)) for one in (truth, rival)}
    first, second = options
    chances = {first: 0.5, second: 0.5}
    best = {name: (option, 0) for name, option in options.items()}
    alike = (first, second)
    return Verdict(
        "ambiguous", (first,), chances, best, alike, "force_law", options[first], None, ()
    )


THERMAL = (
    (planted("thermal_backlash", rate=2e-7), planted("backlash_offset", offset=1e-5)),
    (planted("thermal_stiffness", rate=2e-3), planted("mean_stiffness", factor=0.9)),
)


@pytest.mark.parametrize(("truth", "rival"), THERMAL, ids=lambda one: one.effect.id)
def test_asks_for_another_temperature_where_only_that_tells_rivals_apart(
    truth: Active, rival: Active
) -> None:
    campaign = rig((truth,), ONE_HEAT, NOMINAL)
    verdict = between(truth, rival)
    found = design(campaign, calibrated(campaign), verdict, nominal_model())
    assert found is not None
    assert abs(found.point["delta_T"] - 50.0) >= 15.0
    assert found.separation_so_far < 0.1 < 1.0 < found.separation_at_point
    assert not found.separated_so_far
    assert found.separated_with_point


def test_asks_for_another_load_where_only_that_tells_rivals_apart() -> None:
    truth, rival = planted("profile_error", cos=4e-8, sin=0.0), planted("stiffness_harmonic")
    campaign = rig((truth,), ONE_LOAD, QUIET)
    found = design(campaign, calibrated(campaign), between(truth, rival), nominal_model())
    assert found is not None
    assert abs(np.log(found.point["T_1"] / 900.0)) > np.log(1.25)
    assert found.separation_so_far < 0.2 < 0.3 < found.separation_at_point


def test_points_in_reach_hold_the_range_of_the_runs_and_more() -> None:
    ranges, points = value_ranges(ONE_HEAT), candidate_points(ONE_HEAT)
    assert ranges["delta_T"] == (30.0, 70.0)
    assert ranges["T_1"][0] < 283.0 < 1500.0 < ranges["T_1"][1]
    assert ranges["Omega"][0] >= 0.2
    for name in ("delta_T", "T_1", "Omega"):
        values = {one[name] for one in points}
        assert len(values) == LEVELS
        low, high = ranges[name]
        assert (min(values), max(values)) == (pytest.approx(low, 0.01), pytest.approx(high, 0.01))
    assert sum(one["K"] == 0.0 for one in points) == LEVELS // 2


def test_a_predicted_run_has_none_of_the_sensor_errors_of_the_fit_runs() -> None:
    """Its motion is simulated: e(t) is neither late nor filtered, and a and pins are not known."""
    run = rig((), ONE_HEAT[:1], QUIET).runs[0]
    pin = replace(run.u, values=run.u.values[:, :3], recorded=run.u.recorded[:3])
    errors = np.full(2 * run.u.recorded.size, 1e-6)
    seen = replace(run, delay_rad=0.1, e_share=0.9, encoder_errors=errors, a=run.u, pin=pin)
    case = fused_run(seen, fuse(seen))
    predicted = predict_run((case,), QUIET, QUIET, np.ones(6), dict(ONE_HEAT[1]))
    assert predicted is not None
    found = predicted.case.run
    np.testing.assert_array_equal(found.waves_at(found.phase).e, found.waves.e)
    assert found.encoder_errors is None
    for channels in (found.a, found.pin):
        assert len(channels.values) == len(found)
        assert not channels.recorded.any()


def test_leading_are_the_class_or_the_verdict_and_its_runner_up() -> None:
    first, second, other = (
        NamedExplanation((planted(n),)) for n in ("mean_stiffness", "runout", "stagger")
    )
    best = {"mean_stiffness": (first, 0), "runout": (second, 0), "stagger": (other, 0)}
    one = Verdict("runout", ("runout",), {}, best, (), "force_law", second, other, ())
    assert leading_explanations(one) == (second, other)
    alike = replace(one, verdict="ambiguous", ambiguous_with=("mean_stiffness", "stagger"))
    assert leading_explanations(alike) == (first, other)
    assert leading_explanations(replace(one, verdict="none", effects=(), chosen=None)) == ()
    assert leading_explanations(replace(one, verdict="unknown", effects=())) == ()


@pytest.mark.parametrize("where", [FORCES, BALANCE, MOTION])
def test_rivals_leave_nothing_of_themselves_and_something_of_each_other(where: str) -> None:
    one = cases_of(rig((), ONE_HEAT[:1], NOMINAL))[0]
    names = (
        ("tooth_friction", "torque_ripple") if where == BALANCE else ("stagger", "mean_stiffness")
    )
    rivals = [ExplanationAtFit((planted(name),), np.ones(6), np.ones(3)) for name in names]
    first, second = linear_predictions(one, rivals, where)
    assert separation(first, first).least < 1e-6 * (1.0 + float(first.values @ first.values))
    assert separation(first, second).least / separation(first, second).count > 1e-3


FOUND = Design(("a", "b"), {"delta_T": 70.0, "K": 0.1, "T_1": 440.0, "Omega": 0.6}, 2.0, 0.05)
CHANCES = {"a": 0.7, "b": 0.2, "none": 0.1}
VERDICT = Verdict("a", ("a",), CHANCES, {}, (), "force_law", None, None, ())


def _campaign(points: Sequence[Point]) -> PreparedCampaign:
    run = rig((), ONE_HEAT[:1], NOMINAL).runs[0]
    runs = tuple(replace(run, point=point) for point in points)
    return PreparedCampaign("rig", NOMINAL, runs, ())


def test_the_reason_names_the_rivals_and_by_how_much_they_differ() -> None:
    campaign = _campaign(ONE_HEAT)
    asked = next_experiment(campaign, VERDICT, replace(FOUND, separated_with_point=True))
    assert asked.point == FOUND.point
    assert asked.why.startswith("tells a from b: ")
    assert "2 times the noise floor there, 0.05 times in the runs so far" in asked.why
    known = next_experiment(
        campaign, VERDICT, replace(FOUND, separated_so_far=True, force_ratio=1.4)
    )
    assert known.why.startswith("checks that it is a and not b: ")
    assert known.why.endswith("the largest mesh force there is 1.4 times theirs")


def test_says_when_no_point_would_do_or_none_was_worked_out() -> None:
    campaign = _campaign(ONE_HEAT)
    hopeless = next_experiment(campaign, VERDICT, replace(FOUND, separation_at_point=0.02))
    assert set(hopeless.point) == {"delta_T", "K", "T_1", "Omega"}
    assert "no operating point in reach tells a and b apart" in hopeless.why
    nothing = next_experiment(campaign, replace(VERDICT, verdict="none", effects=()))
    assert nothing.why.startswith("nothing was found; ")
    assert "no temperature rise but 50 K, load between 283 and 1000 N m" in nothing.why
    assert nothing.point["delta_T"] != 50.0
    unknown = next_experiment(campaign, replace(VERDICT, verdict="unknown", effects=()))
    assert "no effect explains the gap" in unknown.why


def test_names_a_class_and_what_is_not_excluded() -> None:
    campaign = _campaign(ONE_HEAT)
    chances = {"stagger": 0.45, "runout": 0.35, "none": 0.15, "unknown": 0.05}
    verdict = replace(
        VERDICT,
        verdict="ambiguous",
        effects=("stagger",),
        probabilities=chances,
        ambiguous_with=("stagger", "runout"),
    )
    said = undecidable(campaign, calibrated(campaign), verdict)
    assert any(one.startswith("stagger (45%) and runout (35%) change the forces") for one in said)
    assert any("no gap beyond tolerance and noise is not excluded" in one for one in said)
    assert not any("outside the catalogue" in one for one in said)
