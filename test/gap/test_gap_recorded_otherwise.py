"""Small motion, counted phases, encoders without a mean, one run, much control: no false alarm.

Runs are of the nominal gear with noise of a fixed seed.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.effect import Locus, active
from herringbone_sim.effects.registry import effect
from herringbone_sim.gap import diagnose as diagnosis
from herringbone_sim.gap.attribution.effect_forces import fused_run
from herringbone_sim.gap.calibrated_fit import Calibrated
from herringbone_sim.gap.campaign_checks import check
from herringbone_sim.gap.data.breaks import longest_part
from herringbone_sim.gap.data.prepare import _check_phase
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.data.units import wrong_units
from herringbone_sim.gap.observations.runs import fuse_with_rates
from herringbone_sim.gap.observations.windows.windows import windows_of_run
from herringbone_sim.gap.planning.synthetic import SensorNoise, simulate_campaign
from herringbone_sim.gap.residuals.foreign_runs import runs_with_other_geometry
from herringbone_sim.gap.run_comparison import run_views
from herringbone_sim.gap.sensors.filter_delay import with_delayed_waves
from herringbone_sim.gap.verdict.augmented import Augmented
from herringbone_sim.gap.verdict.candidate_points import value_ranges
from herringbone_sim.views.figures.gap_arrays import gap_arrays

FULL = Parameters(model="full")
POINT = {"delta_T": 20.0, "K": 0.0, "T_1": 220.0, "Omega": 1.0}
SHAFTS = ("u_s_L", "u_s_R", "u_c")


def recorded(
    sensors: str | tuple[str, ...] = "xvFu",
    points: tuple[dict[str, float], ...] = (POINT,),
    cycles: int = 10,
    share: float = 1e-2,
    nominal: Parameters = FULL,
) -> PreparedCampaign:
    names = sensors
    if isinstance(sensors, str):
        names = tuple(name for q in sensors for name in nominal.layout.channels_of(q))
    return simulate_campaign(nominal, points, names, SensorNoise(share), cycles)


@pytest.mark.parametrize(
    ("e_m", "point"),
    [
        (None, {"Omega": 0.1}),
        (None, {"Omega": 0.05, "T_1": 1000.0}),
        (0.01, {"Omega": 0.5, "T_1": 2000.0, "K": 0.3}),
        (0.0, {}),
    ],
)
def test_motion_that_is_not_of_the_size_of_e_is_in_si(
    e_m: float | None, point: dict[str, float], recwarn: pytest.WarningsRecorder
) -> None:
    nominal = FULL if e_m is None else FULL.changed({"e_m": e_m})
    run = recorded(points=(POINT | point,), nominal=nominal).runs[0]
    assert wrong_units(run)[1] == []
    assert not [w for w in recwarn if w.category is RuntimeWarning]


def test_a_gauge_that_sees_no_planet_weighs_nothing() -> None:
    run = recorded((*SHAFTS, "F_rp1_L"), cycles=20).runs[0]
    blind = np.where(run.F.recorded, np.nan, run.F.values)
    windows = windows_of_run(run.with_measured("F", replace(run.F, values=blind)))
    assert np.isfinite(windows.weight).all()


@pytest.mark.parametrize("per_cycle", [24, 48, 72, 200])
def test_a_phase_in_counts_of_an_encoder_has_no_jumps(per_cycle: int) -> None:
    count, index = 2.0 * np.pi / 100.0, np.arange(100 * per_cycle)
    phase = np.floor(2.0 * np.pi * index / per_cycle / count) * count
    columns = np.column_stack([index * 1e-5, phase, np.sin(phase)])
    series = TimeSeries(columns[:, 0], columns, ("t", "phase", "u_c"))
    _check_phase("run_00", series)
    part, findings = longest_part("run_00", series)
    assert len(part) == len(series)
    assert not findings
    lost = np.delete(columns, slice(500, 500 + per_cycle), axis=0)  # a mesh cycle is lost
    series = TimeSeries(lost[:, 0], lost, series.names)
    part, findings = longest_part("run_00", series)
    assert len(part) < len(series)
    assert findings


def test_a_mesh_that_is_recorded_in_one_run_is_judged_by_its_own_values(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Four times the noise variance at one mesh, in one of five runs."""
    monkeypatch.setattr(diagnosis, "fused_run", lambda run, fused: SimpleNamespace(run=run))
    monkeypatch.setattr(diagnosis, "augmented", lambda *_: SimpleNamespace(factors=np.ones(6)))
    n = 1000
    rows = np.full((5, 12), float(n))
    rows[:, 0] = [4.0 * n, 0.0, 0.0, 0.0, 0.0]
    score = SimpleNamespace(chi2_by_row={"force_law": rows})
    examined = SimpleNamespace(
        none=SimpleNamespace(score=score), counts={"force_law": n * (12 + 4 * 11.0)}
    )
    runs = [SimpleNamespace(run=range(2 * n), fused=None)] * 5
    machine = SimpleNamespace(gear=SimpleNamespace(runs=runs))
    per_mesh = diagnosis._calibrated(machine, examined).per_mesh  # type: ignore[arg-type]
    assert per_mesh == pytest.approx([4.0, *[1.0] * 11])


def test_rotations_that_are_not_used_are_told() -> None:
    names = [n for q in "xvF" for n in FULL.layout.channels_of(q)]
    angles = [f"angle_{body}" for body in FULL.layout.bodies]
    campaign = recorded((*names, *angles), tuple(POINT | {"T_1": t} for t in (220.0, 420.0)))
    checked, findings = check(replace(campaign, gain_tolerance=(0.0,) * 12))
    assert not any(run.u.recorded.any() for run in checked.runs)
    told = [f for f in findings if f.what == "no_mean"]
    assert len(told) == 2
    assert all("u_c" in f.channels for f in told)


def test_a_prefix_of_one_letter_is_a_quantity() -> None:
    noise = SensorNoise(0.01, {}, {"a": 3.0})
    assert noise.sigma("a_c", 1.0) == 3.0
    assert noise.sigma("angle_c", 1.0) == 0.01


def test_a_sensor_effect_closes_the_gap_of_fit_runs_too() -> None:
    campaign = recorded(points=tuple(POINT | {"T_1": t} for t in (220.0, 320.0, 420.0)), cycles=30)
    off = np.where(np.arange(12) == 0, 2e-5, 0.0)
    runs = tuple(
        replace(run.with_measured("x", replace(run.x, values=run.x.values + off)), role=role)
        for run, role in zip(campaign.runs, ("fit", "fit", "held_out"), strict=True)
    )
    machine = diagnosis.machine_of(replace(campaign, runs=runs, gain_tolerance=(0.0,) * 12), ())
    cases = tuple(fused_run(g.run, g.fused) for g in machine.gear.runs)
    bias = active(effect("sensor_bias"), Locus(), {"bias": 2e-5, "channels": ("x_sp1_L",)})
    seen = SimpleNamespace(
        augmented=Augmented(np.ones(6), np.ones(3), (bias,)),
        calibrated=Calibrated(cases, np.ones(6), None),
        runs=runs,
    )
    assert all(view.reduced_chi2["augmented"][0] < 2.0 for view in run_views(seen))


def test_a_run_with_much_control_is_of_the_same_gear() -> None:
    points = (
        {"K": 2.0},
        {"K": 2.0, "T_1": 500.0, "Omega": 0.8},
        {"K": 1.0, "T_1": 1000.0, "Omega": 0.9},
        {},
        {"T_1": 300.0, "Omega": 0.8},
    )
    campaign = recorded(points=tuple(POINT | point for point in points))
    assert runs_with_other_geometry(campaign.runs) == []


def test_the_residual_is_drawn_over_the_phase_of_the_gear() -> None:
    run = recorded(cycles=30, share=1e-3).runs[0]
    force = run.F.values.copy()
    force[:, 0] += 3000.0 * np.cos(run.phase)  # largest at phase 0 of the gear
    run = run.with_measured("F", replace(run.F, values=force))
    peaks = []
    for delay in (0.0, 1e-5):
        late = replace(run, phase=run.phase + run.omega_rad_per_s * delay)
        late = with_delayed_waves(late, delay)
        case = fused_run(late, fuse_with_rates(late))
        drawn = gap_arrays(Calibrated((case,), np.ones(6), np.ones(12)))
        peaks.append(np.angle(np.nansum(drawn.residual_n[:, 0] * np.exp(1j * drawn.phase))))
    assert peaks[1] == pytest.approx(peaks[0], abs=0.02)


def test_points_to_run_next_go_beside_a_reversed_torque_too() -> None:
    low, high = value_ranges([{"T_1": -220.0}])["T_1"]
    assert low < high
