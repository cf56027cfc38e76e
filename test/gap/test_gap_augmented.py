"""The augmented model is a parameter file: what the node runs is what the diagnosis found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from gap_support import NOMINAL, POINTS, prepared, sampled

from herringbone_sim.core.mesh import backlash
from herringbone_sim.core.model import build
from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.diagnosis.coefficients import Coefficient
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.diagnosis.score import Score
from herringbone_sim.effects.effect import Locus, active
from herringbone_sim.effects.gear import gear_table
from herringbone_sim.effects.registry import effect
from herringbone_sim.effects.stepper import simulate
from herringbone_sim.gap.attribution.effect_forces import calibrated_gear_table, fused_run
from herringbone_sim.gap.data.kinematics import coordinates_to_meshes
from herringbone_sim.gap.data.mesh_excitation import waves
from herringbone_sim.gap.named_effects import name_effects
from herringbone_sim.gap.observations.hypotheses.moving_parts import MovingPart
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.run_comparison import run_view
from herringbone_sim.gap.verdict.augmented import (
    Augmented,
    from_parameters,
    nominal_model,
    parameters_of,
    save_augmented,
)
from herringbone_sim.gap.verification.simulator import GearSimulator
from herringbone_sim.recording.parameter_file import load_gear

FOUND = Augmented(
    np.array([1.012, 0.985, 1.03, 0.97, 0.99, 1.015]),
    np.array([1.01, 0.99, 1.018]),
    (
        active(effect("backlash_offset"), Locus("sp", "2", "all"), {"offset": 3e-6}),
        active(effect("sensor_gain"), Locus("rp"), {"gain": 1.05}),
    ),
)


def test_the_file_gives_back_what_was_found(tmp_path: Path) -> None:
    save_augmented(tmp_path / "augmented.yaml", NOMINAL, FOUND, "rig")
    own, actives = load_gear(tmp_path / "augmented.yaml")
    back = from_parameters(NOMINAL, own, actives)
    np.testing.assert_allclose(back.factors, FOUND.factors, rtol=1e-12)
    np.testing.assert_allclose(back.inverse, FOUND.inverse, rtol=1e-12)
    assert back.actives == FOUND.actives
    assert own.model == "full"
    assert own.omega_n == pytest.approx(build(NOMINAL).scales.omega_n, rel=1e-14)


@pytest.mark.parametrize("point", POINTS)
def test_the_loaded_gear_has_the_force_law_with_the_factors(
    tmp_path: Path, point: dict[str, float]
) -> None:
    save_augmented(tmp_path / "augmented.yaml", NOMINAL, FOUND, "rig")
    own = build(load_gear(tmp_path / "augmented.yaml")[0].changed(point))
    nominal = build(NOMINAL.changed(point))
    rng = np.random.default_rng(3)
    z, rate = 2e-4 * rng.normal(size=(40, 8)), 2.0 * rng.normal(size=(40, 8))
    phase = rng.uniform(0.0, 50.0, 40)
    force = GearSimulator(own).run(z, rate, phase, 0.1, 1).force_n[:, 0]
    k, c, e = (np.repeat(FOUND.factors[i : i + 2], 6) for i in (0, 2, 4))
    w = waves(nominal, phase, point["Omega"] * nominal.scales.omega_n)
    D = coordinates_to_meshes(nominal.layout)
    spring = k * w.k * backlash(z @ D.T - e * w.e, nominal.half_backlash_m)
    expected = spring + c * nominal.damping_n_s_per_m * (rate @ D.T - e * w.e_rate)
    np.testing.assert_allclose(force, expected, rtol=1e-9, atol=1e-6)


def test_the_fit_and_the_node_have_the_same_gear() -> None:
    run = prepared(sampled({}, POINTS[2], 6), POINTS[2])
    one = fused_run(run, fuse(run))
    own = build(parameters_of(run.model.parameters, FOUND))
    fitted = calibrated_gear_table(one, FOUND.factors)
    np.testing.assert_allclose(gear_table(own), fitted, rtol=1e-12)


@pytest.mark.parametrize("own", [{"e_mean": 0.5}, {"e_offset": (2e-6,) * 6 + (-1e-6,) * 6}, {}])
def test_the_factor_on_e_scales_all_of_it(own: dict[str, float]) -> None:
    """Mean and offsets too, as in the force law to which it is fitted."""
    nominal = NOMINAL.changed({"model": "full", **own})
    changed = Augmented(np.array([1.0, 1.0, 1.0, 1.0, 1.5, 0.7]), np.ones(3))
    phase = np.linspace(0.0, TWO_PI, 7)
    before, after = (
        waves(build(p), phase, 1.0).e for p in (nominal, parameters_of(nominal, changed))
    )
    np.testing.assert_allclose(after, before * np.repeat([1.5, 0.7], 6), atol=1e-18)


def test_phase_portraits_of_both_models_are_relative_to_the_nominal_error() -> None:
    """As the recorded one is: a rig with half as much error again, and a model that has it."""
    run = prepared(sampled({"e_factor": (1.5,)}, POINTS[0], cycles=60), POINTS[0])
    larger_error = Augmented(np.array([1.0, 1.0, 1.0, 1.0, 1.5, 1.5]), np.ones(3))
    planes = run_view(fused_run(run, fuse(run)), larger_error).planes
    for end in (np.min, np.max):
        measured, model = (end(planes[name], axis=0) for name in ("measured", "augmented"))
        np.testing.assert_allclose(model, measured, rtol=0.02)


def test_the_control_stays_the_torque_that_the_data_sheet_gives() -> None:
    nominal, own = build(NOMINAL), build(parameters_of(NOMINAL, FOUND))
    assert own.scales.M_c == pytest.approx(nominal.scales.M_c / FOUND.inverse[2])
    for name in ("control_q", "control_r"):
        torque = [getattr(m.packed, name) * m.scales.M_c for m in (nominal, own)]
        np.testing.assert_allclose(*torque, rtol=1e-12)


def test_a_model_that_changes_nothing_is_the_nominal_one() -> None:
    one, other = build(NOMINAL), build(parameters_of(NOMINAL, nominal_model()))
    np.testing.assert_allclose(gear_table(other), gear_table(one), rtol=1e-14)
    assert other.scales.M_c == one.scales.M_c


def test_runs_from_any_phase_are_those_of_the_simulation() -> None:
    model = build(NOMINAL.changed(POINTS[0]))
    series, _ = simulate(model, (), 3)
    D = coordinates_to_meshes(model.layout)
    w = waves(model, series["phase"], POINTS[0]["Omega"] * model.scales.omega_n)
    x, v = (series.columns(tuple(f"{q}_{m}" for m in model.layout.meshes)) for q in "xv")
    pull = np.linalg.pinv(D).T
    z, rate = (x + w.e) @ pull, (v + w.e_rate) @ pull
    start, ahead = np.array([5, 20, 37]), 24
    turn = TWO_PI / 24
    found = GearSimulator(model).run(
        z[start], rate[start], series["phase"][start], turn, ahead + 1
    )
    np.testing.assert_allclose(found.z[:, -1], z[start + ahead], atol=2e-8)
    forces = series.columns(tuple(f"F_{m}" for m in model.layout.meshes))
    np.testing.assert_allclose(found.force_n[:, 0], forces[start], rtol=1e-6, atol=1e-3)


@pytest.mark.parametrize(
    ("name", "order", "own", "others", "expected"),
    [
        ("profile_error", 3, ("cos", "sin"), ("2 cos", "2 sin"), {2: [3e-6, 4e-6]}),
        ("torque_ripple", 5, ("1 cos", "1 sin"), ("2 cos", "2 sin"), {10: [0.5, -0.927295218]}),
    ],
)
def test_other_orders_of_a_learned_wave_are_effects_too(
    name, order, own, others, expected
) -> None:
    """Cosine and sine of each order, and of a ripple amplitude 0.5 and phase -atan2(0.4, 0.3)."""
    coefficients = tuple(Coefficient(c, 1.0, np.inf, {}) for c in (*own, *others))
    h = Hypothesis(name, (("order", order),), Locus(), coefficients, 2)
    mean = np.array([0.1, 0.2, 0.3, 0.4]) * (1e-5 if name == "profile_error" else 1.0)
    score = Score(coefficients, mean, np.eye(4), mean[None], mean[:1], 0.0, 0.0, 1.0, {})
    [found] = name_effects((h,), score)
    assert {dict(a.options)["order"]: pytest.approx(list(a.theta)) for a in found.departures} == (
        expected
    )


def test_a_ring_whose_stiffness_is_hardly_known_has_an_interval_with_an_end() -> None:
    """Stiffness is known by its logarithm; the interval ends where the catalogue's range does."""
    ring = MovingPart("ring_flexibility", Locus("rp", "all", "all"), (1e11, 0.1, 0.3, 0.3))
    names = ("present", *ring.names)
    every = tuple(Coefficient(name, 1.0, np.inf, {}) for name in names)
    h = Hypothesis("ring_flexibility", (), ring.locus, every, len(every), ring)
    mean, spread = np.eye(5)[0], np.diag([0.0, 9.0, 1.0, 0.0, 0.0])
    score = Score(every, mean, spread, mean[None], mean[:1], 0.0, 0.0, 1.0, {})
    [found] = name_effects((h,), score)
    low, high = found.intervals[0]
    assert 0.0 < low < 1e11 < high <= 1.1e12
    assert found.active.theta[0] == pytest.approx(1e11)
