"""Whole runs: segments to results, bifurcation diagram, the simulator's own motions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from analysis_support import harmonic_series, henon, logistic, mapped_series

from herringbone_sim.analysis.bifurcation import bifurcation_diagram
from herringbone_sim.analysis.known_gear import gear_of
from herringbone_sim.analysis.pipeline import GearData, Options, SegmentResult, analyze_series
from herringbone_sim.analysis.segments import FREQUENCY
from herringbone_sim.core.integrate import simulate
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters, to_mapping
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import AnalysisError
from herringbone_sim.recording.parameter_file import load_parameters


def _staircase(levels: int = 5, dwell: int = 60) -> TimeSeries:
    n = levels * dwell * 16 + 1
    K = np.minimum(np.arange(n) // (dwell * 16), levels - 1) / 10
    return harmonic_series(levels * dwell, {1.0: 1e-5}, K=K)


def _logistic_run(r: float, delta_T: float) -> TimeSeries:
    x = logistic(1500, r)[500:]
    series = mapped_series(np.hstack((x, 0 * x)))
    data = series.data.copy()
    data[:, 3] = delta_T
    return TimeSeries(series.times, data, series.names)


def test_a_chaotic_map_behind_a_run_is_found() -> None:
    (result,) = analyze_series(mapped_series(henon(1500)), options=Options(noise_share=0.0))
    assert result.label == "chaotic"
    assert result.exponent.value == pytest.approx(0.4192, abs=0.03)
    assert len(result.section) == 1500 - result.dropped_cycles


def test_exponents_per_tau_need_omega_n() -> None:
    series = _staircase(1)
    (bare,) = analyze_series(series)
    assert np.isnan(bare.cycles_per_tau)
    (scaled,) = analyze_series(series, gear=GearData(omega_n=200 * np.pi))
    assert scaled.cycles_per_tau == pytest.approx(1 / (2 * np.pi))


def test_the_models_exponent_is_asked_for_with_the_point_and_turned_to_cycles() -> None:
    asked = []

    def model(point: dict[str, float], section: object) -> tuple[float, float]:
        asked.append(point["K"])
        return -0.01, 0.001

    gear = GearData(omega_n=200 * np.pi, model_exponent=model)  # type: ignore[arg-type]
    results = analyze_series(_staircase(3), gear=gear)
    assert asked == [0.0, 0.1, 0.2]
    assert results[0].model_exponent == pytest.approx((-0.02 * np.pi, 0.002 * np.pi))


def test_transients_are_measured_or_as_told() -> None:
    (told,) = analyze_series(_staircase(1), options=Options(transient_cycles=17))
    assert told.dropped_cycles == 17
    assert len(told.section) == 61 - 17
    assert told.motion.cycles == pytest.approx(43)


def test_short_segments_stay_with_a_reason() -> None:
    n = 100 * 16 + 1
    K = np.where(np.arange(n) < 40, 0.0, 0.3)
    results = analyze_series(harmonic_series(100, {1.0: 1e-5}, K=K))
    assert results[0].period.value is None
    assert "too few" in results[0].period.reason
    assert "too few" in results[0].exponent.reason
    assert results[1].period.value == 1


def test_a_staircase_gives_a_bifurcation_diagram() -> None:
    diagram = bifurcation_diagram(analyze_series(_staircase(5)))
    assert diagram.parameter == "K"
    assert diagram.values == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    assert diagram.periods == (1,) * 5
    assert all(np.ptp(points) < 1e-12 for points in diagram.points)


def test_several_runs_give_the_cascade_of_the_logistic_map() -> None:
    results: list[SegmentResult] = []
    for r in (2.9, 3.3, 3.5, 4.0):
        results += analyze_series(_logistic_run(r, 10 * r), options=Options(noise_share=0.0))
    diagram = bifurcation_diagram(results)
    assert diagram.parameter == "delta_T"
    assert diagram.periods == (1, 2, 4, 0)
    assert [len(np.unique(points.round(6))) for points in diagram.points[:3]] == [1, 2, 4]
    assert diagram.exponents[3, 0] == pytest.approx(np.log(2), abs=0.03)
    assert np.isnan(diagram.exponents[:3, 0]).all()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ([(0.0, 50.0)] * 3, "no parameter that differs"),
        ([(0.0, 50.0), (0.1, 50.0)], "needs 3 different values"),
        ([(0.0, 50.0), (0.1, 60.0), (0.2, 70.0)], "several parameters differ"),
    ],
)
def test_runs_without_one_parameter_give_no_diagram(
    settings: list[tuple[float, float]], words: str
) -> None:
    results: list[SegmentResult] = []
    for K, delta_T in settings:
        results += analyze_series(harmonic_series(60, {1.0: 1e-5}, K=K, delta_T=delta_T))
    with pytest.raises(AnalysisError, match=words):
        bifurcation_diagram(results)


def test_points_of_a_ramp_lie_at_the_value_of_their_moment() -> None:
    n = 600 * 16 + 1
    K = np.arange(n) // 16 / 600
    diagram = bifurcation_diagram(analyze_series(harmonic_series(600, {1.0: 1e-5}, K=K)))
    values = np.concatenate(diagram.point_values)
    assert np.all(np.diff(values) >= 0)
    assert len(np.unique(values)) > 500


def test_exponent_of_the_simulators_chaos_agrees_with_its_tangent_flow() -> None:
    parameters = Parameters(xi=0.12)
    series, _ = simulate(build(parameters), 2500)
    gear = gear_of(to_mapping(parameters), with_model=True)
    (result,) = analyze_series(series, gear=gear)
    value, error = result.model_exponent
    assert result.label == "chaotic"
    assert result.exponent.value == pytest.approx(value, abs=0.04 + 3 * error)
    assert sum(c.drive + c.separated + c.back for c in result.contact) == pytest.approx(4)


def test_a_periodic_motion_that_only_symmetry_keeps_is_said_to_be_unstable() -> None:
    """P3 of the paper's gear: 0.019 per tau is what parts left and right, by `exponents`."""
    parameters = load_parameters(Path(__file__).parents[2] / "config" / "paper.yaml")
    parameters = parameters.changed({"K": 0.02, "delta_T": 50.0, "xi": 0.1})
    series, _ = simulate(build(parameters), 1500)
    (result,) = analyze_series(series, gear=gear_of(to_mapping(parameters), with_model=True))
    assert result.label == "P3"
    assert result.model_exponent[0] == pytest.approx(0.119, abs=0.002)
    assert any(note.startswith("P3 is transversally unstable") for note in result.notes)


def test_a_periodic_motion_of_the_simulator_under_noise() -> None:
    series, _ = simulate(build(Parameters(xi=0.15)), 600)
    (clean,) = analyze_series(series)
    data = series.data.copy()
    moving = data[:, 5:13]
    moving += (
        np.random.default_rng(0).normal(size=moving.shape)
        * 0.01
        * np.sqrt(np.mean(moving**2, axis=0))
    )
    (noisy,) = analyze_series(TimeSeries(series.times, data, series.names))
    assert clean.period.value == noisy.period.value
    assert clean.period.value
    assert noisy.noise > 0.004


def test_runs_with_other_meshes_give_no_diagram() -> None:
    """Of a reduced and of a full model: one clear error."""
    results = []
    for model, value in (("reduced", 10.0), ("reduced", 20.0), ("full", 30.0)):
        gear = build(Parameters(model=model, delta_T=value))
        _, settled = simulate(gear, 20)
        series, _ = simulate(gear, 40, settled)
        results += analyze_series(series)
    with pytest.raises(AnalysisError, match="one mesh in every run"):
        bifurcation_diagram(results, "delta_T")


def test_each_mesh_has_its_own_backlash() -> None:
    p = Parameters(b_offset=(0.0, -3e-5, 0.0, -3e-5))
    model = build(p.changed({"delta_T": 20.0}))
    frequency = model.parameters.Omega * model.scales.omega_n / (2.0 * np.pi)
    point = {"delta_T": 20.0, FREQUENCY: frequency}
    half = gear_of(to_mapping(p), with_model=False).half_backlash_m(point)
    wanted = model.half_backlash_m
    assert [half[mesh] for mesh in p.layout.meshes] == pytest.approx(wanted.tolist())
    assert half["sp_R"] < half["sp_L"]


def test_contact_uses_the_backlash_of_effects() -> None:
    parameters, worn = to_mapping(Parameters()), read_effects("backlash_offset:offset=2e-5")
    half_backlash = gear_of(parameters, False, ((), worn)).half_backlash_m
    assert half_backlash is not None
    point = {FREQUENCY: 5000.0}
    before, after = (half_backlash(point | {"effects": number}) for number in (0.0, 1.0))
    assert before is not None
    assert after is not None
    assert after["sp"] - before["sp"] == pytest.approx(2e-5)


def test_points_of_a_ramp_have_their_own_values() -> None:
    """Also where points are dropped at the start of the ramp: x is drawn over its own K."""
    turns = np.arange(400 * 16) / 16
    K = np.floor(turns) / 400
    x = 1e-5 * K * np.cos(2.0 * np.pi * turns)
    data = np.stack([2.0 * np.pi * turns, K, x, np.gradient(x, 1e-3 / 16)], axis=1)
    series = TimeSeries(turns * 1e-3, data, ("phase", "K", "x_sp_L", "v_sp_L"))
    diagram = bifurcation_diagram(analyze_series(series, options=Options(transient_cycles=20)))
    for points, values in zip(diagram.points, diagram.point_values, strict=True):
        np.testing.assert_allclose(1e5 * points, values, atol=1.5 / 400)
