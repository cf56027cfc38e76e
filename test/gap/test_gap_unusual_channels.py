"""Late channels beside effects, channels of some runs only, short gaps, several sampling rates.

Runs are of the nominal gear, or of the gear with one effect, with noise of a fixed seed.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.diagnosis.flexible import RegressionInputs, predict_residuals
from herringbone_sim.diagnosis.search import Search
from herringbone_sim.effects.effect import Locus, active
from herringbone_sim.effects.registry import effect
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.attribution.effect_forces import (
    effect_contributions,
    force_function_with_effects,
    fused_run,
)
from herringbone_sim.gap.campaign_checks import _other_operating_point
from herringbone_sim.gap.data.noise import spectral_floor
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations import force_law
from herringbone_sim.gap.observations.calibration.common_delay import remove_common_delay
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.planning.plan import plan
from herringbone_sim.gap.planning.synthetic import SensorNoise, simulate_campaign
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.residuals.mesh_law import law
from herringbone_sim.gap.residuals.recalibrate import force_law as calibrated_law
from herringbone_sim.gap.sensors.filter_delay import with_delayed_waves

FULL = Parameters(model="full", samples_per_cycle=20)
POINTS = (
    {"delta_T": 60.0, "K": 0.0, "T_1": 500.0, "Omega": 0.8},
    {"delta_T": 30.0, "K": 0.0, "T_1": 900.0, "Omega": 1.1},
)
SHAFTS = ("u_s_L", "u_s_R", "u_c")
DELAY_S = 5e-6  # the longest that the data sheet allows the sensors


def recorded(
    quantities: str = "xvFu", nominal: Parameters = FULL, points: object = POINTS, cycles: int = 25
) -> tuple[PreparedRun, ...]:
    channels = [name for q in quantities for name in nominal.layout.channels_of(q)]
    return simulate_campaign(nominal, points, channels, SensorNoise(), cycles).runs


def late(run: PreparedRun, delay: float) -> PreparedRun:
    """The channels are those of a phase ``delay`` [s] before the recorded one."""
    later = replace(run, phase=run.phase + run.omega_rad_per_s * delay)
    return replace(later, waves=later.waves_at(later.phase))


def without_force(run: PreparedRun, mesh: int = 0) -> PreparedRun:
    return run.without("F", np.arange(12) == mesh)


def test_waves_of_effects_are_late_like_those_of_the_gear() -> None:
    run = with_delayed_waves(recorded(points=POINTS[1:])[0], DELAY_S)
    gear = GearObservations([run])
    for m in (gear.runs[0].motion, gear.runs[0].strided):
        wave = next(f for f in gear.law_functions if f.name == "k 1 cos").values(m, law(m))
        own = m.k[:, 0] / m.k_m[0] - 1.0
        (share,) = FULL.k_amp  # the nominal k(t) is one cosine, Eq. (7)
        assert own == pytest.approx(share * np.asarray(wave), abs=1e-9)


def test_windows_take_waves_at_the_phase_of_the_gear() -> None:
    run = with_delayed_waves(recorded("u", points=POINTS[1:])[0], DELAY_S)
    few = run.without("u", np.arange(9) >= 3)
    trajectory = GearObservations([few]).trajectory_of(0)
    phase = trajectory.recorded.phase[::2]
    m = trajectory.motion(np.zeros((len(phase), 18)), phase)
    assert m.phase == pytest.approx(phase - few.delay_rad)
    assert m.k[:, 0] == pytest.approx(few.waves_at(phase).k[:, 0])


def test_laws_of_effects_are_evaluated_at_the_phase_of_the_gear() -> None:
    """A harmonic of k at a late run: its force is that of the run that is not late."""
    (on_time,) = recorded(points=POINTS[1:])
    run = with_delayed_waves(late(on_time, DELAY_S), DELAY_S)
    harmonic = active(effect("stiffness_harmonic"), Locus(), {"order": 5, "cos": 0.1})
    forces, functions = [], []
    for one in (on_time, run):
        case = fused_run(one, fuse(one))
        law_now = calibrated_law(one, case.fused, np.ones(6))
        forces.append(effect_contributions(case, np.ones(6), law_now, [harmonic])[0])
        at = force_function_with_effects(case, np.ones(6), [harmonic])
        functions.append(at(one.phase, law_now.x_m, law_now.v_m_per_s))
    for made in (forces, functions):
        assert made[1] == pytest.approx(made[0], abs=1e-6 * np.abs(made[0]).max())


def test_a_delay_is_found_where_e_has_no_first_harmonic() -> None:
    nominal = FULL.changed({"e_amp": (0.0, 1.0)})
    runs = [late(run, 2e-6) for run in recorded(nominal=nominal)]
    found = remove_common_delay(runs, ())
    delays = [run.delay_rad / run.omega_rad_per_s for run in found]
    assert delays == pytest.approx([2e-6, 2e-6], rel=0.1)


def test_balances_that_threads_form_side_by_side_are_kept_once() -> None:
    gear = GearObservations(recorded(points=POINTS[1:], cycles=12))
    made = list(gear._balances)
    del gear.__dict__["_balances"]
    gear._measured_balances.clear()
    formed = GearObservations._balance

    def twice(self: GearObservations, *args: object) -> object:
        """A thread that comes second has formed them in the meantime."""
        if not gear._measured_balances:
            gear._measured_balances.extend(made)
        return formed(self, *args)  # type: ignore[arg-type]

    gear._balance = partial(twice, gear)  # type: ignore[method-assign]
    assert len(gear._balances) == len(gear.runs)


def test_few_sensors_of_four_planets_are_refused_with_the_reason() -> None:
    four = FULL.changed({"n_planets": 4})
    runs = simulate_campaign(four, POINTS[:1], SHAFTS, SensorNoise(), 20).runs
    assert not GearObservations(runs).uses_windows
    with pytest.raises(AnalysisError, match="made for three planets"):
        plan(four, POINTS, SHAFTS, SensorNoise(), 20)


def test_a_balance_needs_the_force_of_a_mesh_or_its_displacement() -> None:
    run = without_force(recorded("vF", points=POINTS[:1])[0])
    assert "torque_balance" not in GearObservations([run]).observation_names
    fitted = GearObservations([without_force(recorded("xvF", points=POINTS[:1])[0])])
    assert "torque_balance" in fitted.observation_names
    assert fitted.has_balance_of(0)
    assert not fitted.for_runs([run]).has_balance_of(0)


def test_noise_of_short_parts_is_estimated_from_all_of_them() -> None:
    """White noise of 1 in ten parts of eight samples."""
    values = np.full(400, np.nan)
    rng = np.random.default_rng(0)
    for first in range(0, 400, 40):
        values[first : first + 8] = rng.normal(size=8)
    assert 0.6 < spectral_floor(values[:, None])[0] < 1.7
    sparse = np.where(np.arange(400) % 4 == 0, rng.normal(size=400), np.nan)  # of another rate
    assert 0.6 < spectral_floor(sparse[:, None])[0] < 1.7


def test_each_run_counts_with_its_own_share_of_independent_values() -> None:
    """Two runs of a wave that the regression predicts, in both orders."""
    rng = np.random.default_rng(0)
    angles = np.linspace(0.0, 60.0 * np.pi, 600)
    residual = 3.0 * np.cos(2.0 * angles)[:, None] + rng.normal(size=(600, 1))
    runs = [residual, residual[::2]]
    inputs = [
        RegressionInputs(np.zeros((len(r), 1, 0)), a[:, None], np.ones((len(r), 1, 1)))
        for r, a in zip(runs, (angles, angles[::2]), strict=True)
    ]
    blocks = [np.arange(len(r)) * 30 // len(r) for r in runs]
    shares = np.array([0.2, 0.4])
    first, second = (
        predict_residuals(runs[::way], inputs[::way], blocks[::way], shares[::way])
        for way in (1, -1)
    )
    assert first.predicted == pytest.approx(second.predicted, rel=1e-6)
    whole = 0.2 * 600 * 4.5 + 0.4 * 300 * 4.5  # the mean square of the wave is 4.5
    assert first.predicted == pytest.approx(whole, rel=0.15)


def test_a_gauge_that_the_first_run_lacks_has_its_tolerance() -> None:
    runs = simulate_campaign(FULL, POINTS, (*SHAFTS, "F_pin1"), SensorNoise(), 20).runs
    without_pin = runs[0].without("pin", np.ones(3, dtype=bool))
    machine = GearMachine(GearObservations((without_pin, runs[1])))
    assert machine.gear.gauges == ("F_pin1",)
    assert Search(machine).null.in_sample > 0.0


def test_gauges_of_different_runs_are_all_followed() -> None:
    runs = simulate_campaign(FULL, POINTS, (*SHAFTS, "F_pin1", "F_pin2"), SensorNoise(), 20).runs
    first, second = (
        run.without("pin", np.array([n != own for n in range(3)])) for own, run in enumerate(runs)
    )
    gear = GearObservations((first, second))
    assert gear.gauges == ("F_pin1", "F_pin2")
    assert Search(GearMachine(gear)).null.in_sample > 0.0


def test_gaps_of_a_recorded_operating_point_contradict_nothing() -> None:
    run = recorded(points=POINTS[:1], cycles=12)[0]
    temperature = np.full(len(run), 60.0)
    temperature[5:9] = np.nan
    assert _other_operating_point(replace(run, recorded_point={"delta_T": temperature})) == []
    temperature[20] = 65.0
    assert len(_other_operating_point(replace(run, recorded_point={"delta_T": temperature}))) == 1


def test_a_force_that_is_not_used_adds_no_noise_to_the_balance() -> None:
    first, second = recorded(points=POINTS)
    part, none = (
        GearObservations(runs).blocks({}, {}, ("torque_balance",))[0]["torque_balance"]
        for runs in (
            (first, without_force(second)),
            (without_force(first), without_force(second)),
        )
    )
    assert part.sigma == pytest.approx(none.sigma, rel=1e-9)


def test_derivatives_of_the_waves_are_those_of_the_phase_at_few_samples() -> None:
    """Ten samples a cycle of which every second is used: differences of samples lose 24 %."""
    coarse = FULL.changed({"samples_per_cycle": 10})
    m = GearObservations(recorded(nominal=coarse, points=POINTS[:1])).runs[0].strided
    k, rate = (m.waves_at(m.phase + a) for a in (0.01, -0.01))
    assert force_law.shift_k(m, law(m)) == pytest.approx(
        (k.k - rate.k) / 0.02 / m.k_m, abs=1e-3 * np.ptp(m.k / m.k_m)
    )
    assert force_law.shift_e_rate(m, law(m)) == pytest.approx(
        (rate.e_rate - k.e_rate) / 0.02, abs=1e-3 * np.ptp(m.e_rate)
    )
