"""Planted effects are found again with their place and size; a healthy rig names none."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from herringbone_sim.gap.attribution.constancy import varying
from herringbone_sim.gap.attribution.fit import fit
from herringbone_sim.gap.attribution.shortlist import base, shortlist
from herringbone_sim.gap.sensors.find import SensorCheck
from herringbone_sim.gap.verdict.evidence import Evidence, gather
from herringbone_sim.gap.verdict.stages import Option

from herringbone_sim.core.model import build
from herringbone_sim.effects.effect import Active, Locus, active
from herringbone_sim.effects.registry import effect
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.attribution.hypothesis import Case, added, case, expected, fine_law_with
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.data.waves import waves
from herringbone_sim.gap.report import check_report, report
from herringbone_sim.gap.residuals.fusion import Fused
from herringbone_sim.gap.residuals.recalibrate import force_law
from herringbone_sim.gap.verdict.decide import Verdict, decide
from herringbone_sim.gap.verification.verify import Gap, RunGap
from herringbone_sim.recording.parameter_file import load_parameters

NOMINAL = Path(__file__).parents[1] / "config" / "rig.yaml"
POINTS = (
    {"delta_T": 20.0, "K": 0.0, "T_1": 300.0, "Omega": 1.0},
    {"delta_T": 90.0, "K": 0.0, "T_1": 2000.0, "Omega": 0.4},
    {"delta_T": 50.0, "K": 0.2, "T_1": 900.0, "Omega": 0.8},
)
GAP = Gap("force_law", (RunGap("run_00", "held_out", 3.0, 1.2, 1.0),))
TOLERANCE = np.array([1.01, 0.99, 1.0, 1.01, 0.99, 1.012])


def made(actives: tuple[Active, ...], seed: int = 1) -> list[Case]:
    """Runs of random smooth motion whose forces are those of a rig with effects and noise."""
    rng = np.random.default_rng(seed)
    return [_made(point, actives, rng, i) for i, point in enumerate(POINTS)]


def _made(
    point: dict[str, float], actives: tuple[Active, ...], rng: np.random.Generator, number: int
) -> Case:
    model = build(load_parameters(NOMINAL).changed({"model": "full"}).changed(point))
    n, per = 1200, 24
    omega = point["Omega"] * model.scales.omega_n
    phase = 2.0 * np.pi * np.arange(n) / per
    times = phase / omega
    x, v = np.zeros((n, 12)), np.zeros((n, 12))
    for order in (0.13, 0.5, 1.0, 2.0):
        size, shift = rng.normal(size=12) * 6e-5, rng.uniform(0, 6, 12)
        x += size * np.cos(order * phase[:, None] + shift)
        v -= size * order * omega * np.sin(order * phase[:, None] + shift)
    x += rng.choice([-3e-5, 6e-5], 12)
    nothing = Measured(np.zeros((n, 9)), np.ones(9, dtype=bool), np.ones(9))
    seen = np.ones(12, dtype=bool)
    run = PreparedRun(
        f"run_{number}",
        "fit",
        point,
        times,
        phase,
        Measured(x, seen, np.full(12, 1e-9)),
        Measured(v, seen, np.full(12, 1e-5)),
        Measured(np.zeros((n, 12)), seen, np.ones(12)),
        nothing,
        model,
        waves(model, phase, omega),
        {},
        (),
    )
    none = np.zeros((n, 8))
    sigma_x, sigma_v = np.full(12, 1e-9), np.full(12, 1e-5)
    fused = Fused(none, none, np.eye(8), np.eye(8), x, v, sigma_x, sigma_v, np.ones(12))
    bare = case(run, fused)
    force = expected(bare, TOLERANCE, actives)
    noise = 0.01 * np.sqrt(np.mean(force**2, axis=0))
    force = force + noise * rng.normal(size=force.shape)
    return case(replace(run, F=Measured(force, seen, noise)), fused)


def planted(name: str, locus: Locus, **values: object) -> Active:
    return active(effect(name), locus, values)


PLANTED = (
    planted("mean_stiffness", Locus("sp", "2", "L"), factor=1.15),
    planted("stagger", Locus("all", "all", "R"), phase=0.15),
    planted("tooth_crack", Locus("sp", "1", "L"), depth=0.4, position=11.2, width=1.3),
    planted("profile_error", Locus("rp"), order=3, cos=2e-6, sin=-1e-6),
)


@pytest.mark.parametrize("truth", PLANTED, ids=lambda one: one.effect.id)
def test_finds_a_planted_effect_with_its_place_and_size(truth: Active) -> None:
    cases = made((truth,))
    best = shortlist(base(cases, np.ones(6)), [effect(p.effect.id) for p in PLANTED])[0].active
    assert (best.effect.id, best.locus) == (truth.effect.id, truth.locus)
    found = fit(cases, np.ones(6), (best,))
    assert found.left_out == pytest.approx(1.0, abs=0.05)
    assert found.actives[0].theta[0] == pytest.approx(truth.theta[0], rel=0.05)
    low, high = found.interval(0, 0)
    assert low < found.actives[0].theta[0] < high


def test_a_spring_of_the_ring_is_not_missed_between_those_tried() -> None:
    truth = planted("ring_flexibility", Locus("rp"), stiffness=1.5e11, damping=0.04)
    cases = made(())
    for _ in range(20):  # the ring follows the forces that it changes
        cases = [_with_forces(c, expected(c, TOLERANCE, (truth,))) for c in cases]
    best = shortlist(base(cases, np.ones(6)), [effect("ring_flexibility")])[0].active
    found = fit(cases, np.ones(6), (best,))
    assert found.actives[0].theta[0] == pytest.approx(1.5e11, rel=0.05)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_spring_too_stiff_for_the_steps_is_the_last_choice() -> None:
    rng = np.random.default_rng(2)
    cases = [_made({**point, "Omega": 0.05}, (), rng, i) for i, point in enumerate(POINTS)]
    start = planted("ring_flexibility", Locus("rp"), stiffness=1e12, damping=0.02)
    assert fit(cases, np.ones(6), (start,)).left_out == np.inf


def _with_forces(c: Case, force: np.ndarray) -> Case:
    return replace(c, run=replace(c.run, F=replace(c.run.F, values=force)))


def test_a_run_predicts_badly_what_the_wrong_effect_has_fitted() -> None:
    cases = made((PLANTED[0],))
    right = fit(cases, np.ones(6), (PLANTED[0],))
    wrong = fit(cases, np.ones(6), (planted("mean_stiffness", Locus("rp", "1", "R")),))
    assert wrong.left_out > 1.5 * right.left_out


@pytest.mark.parametrize("course", ["steady", "growing", "by_load"])
def test_an_effect_that_is_not_the_same_everywhere_shows(course: str) -> None:
    truth = PLANTED[0]
    cases = [_changing(c, truth, course) for c in made((truth,))]
    found = varying(cases, fit(cases, np.ones(6), (truth,)))
    excess = fit(cases, np.ones(6), ()).left_out - 1.0
    assert (found.by_time > 0.05 * excess) is (course == "growing")
    assert (found.by_load > 0.003 * excess) is (course == "by_load")


def _changing(c: Case, truth: Active, course: str) -> Case:
    """A case whose effect is taken off at the start of the run, or where the load is light."""
    change = expected(c, TOLERANCE, (truth,)) - expected(c, TOLERANCE, ())
    depth = np.abs(force_law(c.run, c.fused, TOLERANCE).f_m)
    gone = {
        "steady": np.zeros_like(change),
        "growing": np.linspace(1.0, 0.0, len(change))[:, None] * np.ones_like(change),
        "by_load": np.exp(-depth / 2e-5),
    }[course]
    return _with_forces(c, c.run.F.values - gone * change)


def _verdict_of(cases: list[Case]) -> Verdict:
    start = fit(cases, np.ones(6), ())
    singles = tuple(fit(cases, start.factors, (one,)) for one in PLANTED)
    ranked = tuple(sorted(singles, key=lambda f: f.left_out))
    nothing = SensorCheck(1.0, 1.0, 1.0, 1.0, ())
    return decide(Evidence(nothing, tuple(cases), start, (), ranked, (), (), 0.0, {}))


def test_names_none_on_a_healthy_rig_within_its_tolerance() -> None:
    verdict = _verdict_of(made(()))
    assert verdict.verdict == "none"
    assert verdict.effects == ()


def test_says_unknown_where_no_effect_of_the_catalogue_fits() -> None:
    cases = made(())
    rng = np.random.default_rng(3)
    odd = []
    for c in cases:
        slow = np.cos(0.0371 * c.run.phase[:, None] + rng.uniform(0, 6, 12))
        force = c.run.F.values + 20.0 * c.run.F.sigma * slow
        odd.append(case(replace(c.run, F=replace(c.run.F, values=force)), c.fused))
    assert _verdict_of(odd).verdict == "unknown"


def test_report_follows_the_contract() -> None:
    verdict = _verdict_of(made((PLANTED[1],)))
    assert verdict.verdict == "stagger"
    good = report("rig", verdict, [(Locus(), 1.0)], GAP, [], {"delta_T": 20.0})
    assert check_report(good) == []
    assert good["gap"]["closure"] == pytest.approx(0.9)
    bad = copy.deepcopy(good)
    bad["causes"][0]["probability"] += 0.1
    assert any("sum to 1" in rule for rule in check_report(bad))
    del good["gap"]
    assert check_report(good) == ["gap is missing"]


def test_a_clock_is_told_with_the_channel_that_it_is() -> None:
    drift = active(effect("clock_drift"), values={"ppm": 200.0})
    verdict = _verdict_of(made(()))
    option = Option("consistency", (drift,), 0.0, None, (((190.0, 210.0),),))
    verdict = replace(verdict, best={"clock_drift": (option, 0)})
    told = report("rig", verdict, [], GAP, [], {"delta_T": 20.0})["causes"]
    cause = next(one for one in told if one["effect"] == "clock_drift")
    assert cause["parameters"]["channels"]["value"] == ["t"]
    assert cause["parameters"]["ppm"]["ci90"] == [190.0, 210.0]


def test_a_late_sensor_beside_a_force_that_no_step_follows_is_no_crash() -> None:
    one = made(())[0]
    late = planted("sensor_delay", Locus(), delay=1e-6, channels=("F",))
    wild = one.run.F.values.copy()
    wild[600, 3] = np.inf
    law = replace(force_law(one.run, one.fused, np.ones(6)), modelled_n=wild)
    force = expected(one, np.ones(6), (late,), law)
    assert np.isnan(force[600, 3])
    assert np.isfinite(np.delete(force, 3, axis=1)).all()


def test_refuses_held_out_runs() -> None:
    cases: list[PreparedRun] = [replace(c.run, role="held_out") for c in made(())]
    with pytest.raises(AnalysisError, match="held_out"):
        gather(cases)


def test_effects_between_samples_are_those_at_the_samples() -> None:
    one = made((PLANTED[2],))[0]
    run, factors = one.run, np.ones(6)
    law = fine_law_with(one, factors, (PLANTED[2],))
    deflection = one.fused.x + run.waves.e
    rate = one.fused.v + run.waves.e_rate
    change = law(run.phase, deflection, rate) - fine_law_with(one, factors, ())(
        run.phase, deflection, rate
    )
    at_samples = added(one, factors, force_law(run, one.fused, factors), (PLANTED[2],))[0]
    assert np.abs(at_samples).max() > 100.0
    assert change == pytest.approx(at_samples, abs=1e-3)
