"""Late channels, gaps, missing channels and small loads are no gap between rig and simulator."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from herringbone_sim.core.integrate import simulate
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.channels import between
from herringbone_sim.effects.effect import Locus, active
from herringbone_sim.effects.registry import effect
from herringbone_sim.effects.stepper import simulate as simulate_with
from herringbone_sim.gap.attribution.effect_forces import fused_run
from herringbone_sim.gap.campaign_checks import _wrong_torque
from herringbone_sim.gap.data.breaks import longest_part, unwrap_phase
from herringbone_sim.gap.data.mesh_excitation import waves
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.data.units import wrong_units
from herringbone_sim.gap.observations.runs import fuse_with_rates
from herringbone_sim.gap.planning.synthetic import SensorNoise, simulate_campaign
from herringbone_sim.gap.residuals.balance_without_forces import fused_noise
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.run_comparison import _motion
from herringbone_sim.gap.sensors.filter_delay import compensate_filter, with_delayed_waves
from herringbone_sim.gap.verdict.augmented import Augmented, nominal_model
from herringbone_sim.gap.verdict.candidate_points import candidate_points, predict_run
from herringbone_sim.gap.verdict.next_experiment import _new_value
from herringbone_sim.gap.verification.attractor import model_motion
from herringbone_sim.gap.verification.residual_gap import residual_gap
from herringbone_sim.gap.verification.short_prediction import horizon_of, prediction_error
from herringbone_sim.gap.verification.simulator import simulator_of

FULL = Parameters(model="full")
POINT = {"delta_T": 50.0, "K": 0.0, "T_1": 220.0, "Omega": 1.0}


def recorded(
    quantities: str, nominal: Parameters = FULL, cycles: int = 40, share: float = 1e-3
) -> PreparedRun:
    """A run of the nominal gear, of which all channels of some quantities are recorded."""
    channels = [name for q in quantities for name in nominal.layout.channels_of(q)]
    return simulate_campaign(nominal, [POINT], channels, SensorNoise(share), cycles).runs[0]


def late(run: PreparedRun, delay: float) -> PreparedRun:
    def of(m: Measured) -> Measured:
        columns = [between(run.times, c, run.times - delay) for c in m.values.T]
        return replace(m, values=np.stack(columns, axis=1))

    return replace(run, **{q: of(getattr(run, q)) for q in "xvFu"})


def test_a_simulation_starts_at_the_phase_of_the_motion_that_channels_show() -> None:
    """Channels late by a common filter: an error of the phase would be ten times as large."""
    run = with_delayed_waves(late(recorded("xvFu", cycles=60), 8e-6), 8e-6)
    fused, horizon = fuse(run), horizon_of(run, float("nan"))
    errors = [
        prediction_error(one, fused, simulator_of(run, nominal_model()), horizon)
        for one in (run, replace(run, delay_rad=0.0))
    ]
    assert errors[0] < 0.1 * errors[1]


@pytest.mark.parametrize("samples", [16.0, 16.4, 7.45])
def test_an_attractor_is_simulated_from_the_first_measured_state(samples: float) -> None:
    """At its phase, also where samples per mesh cycle are no whole number."""
    run = recorded("xvFu")
    run = replace(run, phase=2.0 * np.pi / samples * np.arange(len(run)), delay_rad=0.1)
    seen: list[float] = []

    def simulated(z: object, rate: object, start: np.ndarray, turn: float, n: int) -> None:
        seen.append(float(start[0] + (n - len(run)) * turn))
        raise StopIteration

    fused = fuse(run)
    noise = fused_noise(run, np.random.default_rng(0))
    with pytest.raises(StopIteration):
        model_motion(run, fused, noise, SimpleNamespace(run=simulated), ())  # type: ignore[arg-type]
    assert seen[0] == pytest.approx(-0.1, abs=1e-9)
    assert fused.z.shape[0] == len(run)


@pytest.mark.parametrize("own", [{"e_mean": 2.0}, {"e_factor": (1.0,) * 11 + (0.0,)}])
def test_the_common_delay_is_found_for_any_mesh_error(own: dict[str, float]) -> None:
    """With a mean, over no whole number of mesh cycles; and with one mesh without error."""
    run = late(recorded("xvFu", FULL.changed(own), cycles=20), 5e-6)
    parts = {q: replace(getattr(run, q), values=getattr(run, q).values[:-4]) for q in "xvFu"}
    w = run.waves
    short = replace(
        run,
        times=run.times[:-4],
        phase=run.phase[:-4],
        waves=type(w)(w.k[:-4], w.e[:-4], w.e_rate[:-4]),
        **parts,
    )
    (found,) = compensate_filter([short])
    assert found.delay_rad / found.omega_rad_per_s == pytest.approx(5e-6, rel=0.05)


def test_without_mesh_error_no_delay_is_found() -> None:
    (found,) = compensate_filter([recorded("xvFu", FULL.changed({"e_m": 0.0}))])
    assert found.delay_rad == 0.0


@pytest.mark.parametrize("gap", [slice(0), slice(50, 60)])
def test_forces_in_kilonewtons_are_noticed_without_displacements(gap: slice) -> None:
    """Also of gauges with gaps; forces in newtons are not."""
    run = recorded("Fu")
    values = run.F.values / 1e3
    values[gap] = np.nan
    wrong = replace(run, F=replace(run.F, values=values, sigma=run.F.sigma / 1e3))
    assert wrong_units(run)[1] == []
    (finding,) = wrong_units(wrong)[1]
    assert len(finding.channels) == 12


def test_gaps_of_gauges_are_no_wrong_torque() -> None:
    run = recorded("Fu")
    values = run.F.values.copy()
    values[50:60] = np.nan
    assert _wrong_torque(replace(run, F=replace(run.F, values=values))) == []


def test_displacements_and_forces_without_rates_have_a_gap() -> None:
    """Rates are slopes of the displacements; the gap of the nominal gear is its floor."""
    run = recorded("xF", cycles=60)
    gap = residual_gap([run], lambda r: r, "force_law", nominal_model()).runs[0]
    assert gap.nominal == gap.augmented
    assert gap.floor < gap.nominal < 3.0 * gap.floor


def test_a_free_pin_closes_the_gap_of_a_rig_without_forces() -> None:
    """By what it does to the carrier, too: the forces of the law alone close nothing."""
    pin = active(
        effect("bearing_clearance"),
        Locus("all", "1", "all"),
        {"clearance": 5e-6, "stiffness": 3e10, "damping": 0.1},
    )
    model = build(FULL.changed(POINT))
    _, settled = simulate_with(model, (pin,), 60)
    series, _ = simulate_with(model, (pin,), 60, settled)
    rng, omega = np.random.default_rng(1), model.parameters.Omega * model.scales.omega_n

    def measured(q: str) -> Measured:
        values = series.columns(model.layout.channels_of(q))
        sigma = 1e-4 * np.sqrt(np.mean(values**2, axis=0))
        noisy = values + sigma * rng.normal(size=values.shape)
        return Measured(noisy, np.ones(len(sigma), dtype=bool), sigma)

    run = replace(
        recorded("xvu", cycles=60),
        times=series.times - series.times[0],
        phase=series["phase"],
        waves=waves(model, series["phase"], omega),
        **{q: measured(q) for q in "xvu"},
    )
    with_pin = Augmented(np.ones(6), np.ones(3), (pin,), motion=True)
    gap = residual_gap([run], lambda r: r, "torque_balance", with_pin).runs[0]
    assert gap.augmented < 0.85 * gap.nominal


def test_a_wrapped_phase_with_a_gap_is_unwrapped() -> None:
    """All before the gap is left, as of a phase that is counted on."""
    model = build(FULL)
    _, settled = simulate(model, 3)
    series, _ = simulate(model, 30, settled)
    at = series.names.index("phase")
    lost = np.r_[0:420, 424 : len(series)]
    for gap in (lost, slice(None)):
        data = series.data.copy()
        data[:, at] %= 2.0 * np.pi
        if isinstance(gap, slice):
            data[420:424] = np.nan
        cut = TimeSeries(series.times[gap], data[gap], series.names)
        unwrapped, findings = unwrap_phase("run", cut)
        assert len(findings) == 1
        assert len(longest_part("run", unwrapped)[0]) == 420


def test_a_run_without_rates_is_predicted_with_slopes_as_it_was_compared() -> None:
    """Else its force law says nothing, and no proposed point tells explanations apart."""
    run = recorded("xF")
    case = fused_run(run, fuse_with_rates(run))
    predicted = predict_run((case,), FULL, FULL, np.ones(6), POINT)
    assert predicted is not None
    np.testing.assert_array_equal(predicted.case.usable, case.usable)
    assert case.usable.all()


def test_small_loads_have_points_of_their_own() -> None:
    """Torque of a small rig is not rounded to whole newton metres."""
    points = [{**POINT, "T_1": torque} for torque in (0.2, 0.3, 0.4)]
    assert len({p["T_1"] for p in candidate_points(points)}) == 16
    assert min(p["T_1"] for p in candidate_points(points)) > 0.0
    assert _new_value("T_1", [0.2, 0.4], (0.1, 0.5))[0] == pytest.approx(0.3)
    assert _new_value("T_1", [200.0, 240.9], (100.0, 300.0))[0] == 220.0


def test_a_portrait_starts_at_phase_0_of_a_dense_recording(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Eight times as many samples as the nominal gear has."""
    run = recorded("xvFu", FULL.changed({"samples_per_cycle": 128}), cycles=50)
    coarse = recorded("xvFu", cycles=10).model
    run = replace(run, phase=run.phase + 0.4 * 2.0 * np.pi, model=coarse)
    starts = []

    def simulated(gear: object, effects: object, n: int, state: object) -> None:
        starts.append(state)
        raise StopIteration

    monkeypatch.setattr("herringbone_sim.gap.run_comparison.simulate", simulated)
    fused = fuse(run)
    with pytest.raises(StopIteration):
        _motion(run.model, (), fused_run(run, fused))
    at = int(np.argmin(np.abs(fused.z - starts[0].y[:8] * run.model.scales.b_c).sum(axis=1)))
    turns = run.phase[at] / (2.0 * np.pi)
    assert turns == pytest.approx(round(turns), abs=0.01)
