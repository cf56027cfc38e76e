"""``gap plan``: what sensors would tell agrees with what recordings with effects leave."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gap_support import NOMINAL, POINTS, noisy, prepared, sampled

from herringbone_sim.__main__ import main
from herringbone_sim.cli.gap_plan import also_table, noise_of, point_of
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.diagnosis.information import Information
from herringbone_sim.diagnosis.search import Search
from herringbone_sim.effects.effect import Active, Locus
from herringbone_sim.effects.written import parse_effect
from herringbone_sim.errors import ParameterError
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.planning.plan import Detectability, Plan, plan
from herringbone_sim.gap.planning.summary import (
    effect_summaries,
    place_text,
    plan_to_dict,
    ranked_runs,
)
from herringbone_sim.gap.planning.synthetic import SensorNoise, known_sensors, simulate_campaign
from herringbone_sim.gap.sensors.detrended import only_windows_possible

SHAFTS = ("u_s_L", "u_s_R", "u_c")
ONE_MESH = ("x_sp1_L", "v_sp1_L", "F_sp1_L")
TWO = POINTS[:2]
CYCLES = 50


@pytest.fixture(scope="module")
def of_mesh() -> Plan:
    """Displacement, rate and force of one mesh at two points, 40 dB."""
    return plan(NOMINAL, TWO, ONE_MESH, SensorNoise(), CYCLES)


def left(sensors: Sequence[str], actives: Sequence[Active]) -> float:
    """Squares that the nominal machine, tolerances fitted, leaves of a rig with effects.

    The mean over five draws of the noise: one draw scatters by a tenth.
    """
    motions = [sampled({}, point, CYCLES, actives) for point in TWO]
    squares = []
    for draw in range(5):
        runs = []
        for i, (point, motion) in enumerate(zip(TWO, motions, strict=True)):
            series = noisy(motion, 0.01, 10 * draw + i)
            names = tuple(n for n in series.names if n in ("t", "phase", *sensors))
            runs.append(prepared(TimeSeries(series.times, series.columns(names), names), point))
        squares.append(Search(GearMachine(GearObservations(runs))).null.in_sample)
    return float(np.mean(squares))


@pytest.mark.parametrize(
    ("sensors", "effect", "size", "within"),
    [
        # size: the parameter over that of the catalogue's curves; within: a factor. A rig's motion
        # changes with the effect, a force law does not: there the linear response is exact.
        (ONE_MESH, "mean_stiffness@sp/1/L:factor=0.95", 0.5, 1.2),
        (ONE_MESH, "backlash_offset@sp/1/L:offset=2e-6", 0.4, 1.3),
        (SHAFTS, "backlash_offset@sp/1/L:offset=6e-6", 1.2, 2.0),
        (SHAFTS, "mean_stiffness@sp/1/L:factor=0.9", 1.0, 2.0),
    ],
)
def test_the_squares_of_a_plan_are_those_of_recordings(
    sensors: Sequence[str], effect: str, size: float, within: float
) -> None:
    one = parse_effect(effect)
    search = Search(
        GearMachine(
            GearObservations(simulate_campaign(NOMINAL, TWO, sensors, SensorNoise(), CYCLES).runs)
        )
    )
    search = search.onwards(search.machine)
    hypotheses = [
        h
        for h in search.machine.hypotheses()
        if h.effect == one.effect.id and h.locus == one.locus
    ]
    told = Information(search.campaign, hypotheses, hypotheses).seen(0, size)
    found = left(sensors, (one,)) - left(sensors, ())
    assert told == pytest.approx(found, rel=within - 1.0)


def test_an_effect_within_the_tolerances_is_not_named_by_a_little(of_mesh: Plan) -> None:
    """Half a per cent of stiffness of all meshes is nothing beside a tolerance of two."""
    of_all = [o for o in of_mesh.of_effect("mean_stiffness") if o.locus.mesh == "all"]
    assert of_all
    assert min(o.named_from for o in of_all) > 0.02


def test_what_a_mesh_does_not_feel_is_not_told(of_mesh: Plan) -> None:
    assert {o.locus.side for o in of_mesh.detectabilities} <= {"L", "all"}
    assert "torque_ripple" in of_mesh.not_sought
    assert "ring_flexibility" in of_mesh.not_planned


def test_a_plan_names_the_channels_of_sensor_effects(of_mesh: Plan) -> None:
    gains = of_mesh.of_effect("sensor_gain")
    places = [place_text(one) for one in gains]
    assert len(set(places)) == len(places)
    assert "F sp/1/L" in places
    exchanged = replace(gains[0], options=(("channels", ("u_s_L", "u_c")),))
    assert place_text(exchanged) == "u_s_L and u_c"
    of_kind = replace(gains[0], options=(("channels", NOMINAL.layout.channels_of("x")),))
    assert place_text(of_kind).startswith("x ")
    assert max(map(len, [*places, place_text(of_kind)])) < 26
    data = plan_to_dict(of_mesh, [{} for _ in TWO], CYCLES, {})
    of = [e["options"]["channels"] for e in data["effects"] if e["effect"] == "sensor_gain"]
    assert [list(dict(one.options)["channels"]) for one in gains] == of


def test_more_noise_asks_for_larger_effects(of_mesh: Plan) -> None:
    loud = plan(NOMINAL, TWO, ONE_MESH, SensorNoise(0.1), CYCLES)
    quiet = {row.effect: row.best for row in effect_summaries(of_mesh)}
    both = [(quiet[row.effect], row.best) for row in effect_summaries(loud) if row.effect in quiet]
    assert all(b >= a for a, b in both)
    assert np.median([b / a for a, b in both if np.isfinite(b)]) > 3.0


def test_the_runs_of_a_plan_share_what_is_told(of_mesh: Plan) -> None:
    for one in of_mesh.detectabilities:
        assert sum(one.run_shares) == pytest.approx(1.0)
    order = ranked_runs(of_mesh)
    assert sorted(r for r, _ in order) == [0, 1]
    assert order[-1][1] == pytest.approx(1.0)


def test_all_channels_of_the_contract_can_be_planned() -> None:
    """Accelerations and pins follow from the forces: M a = loads - G' F, by differences of u."""
    (run,) = simulate_campaign(
        NOMINAL.changed({"samples_per_cycle": 240}),
        POINTS[1:2],
        known_sensors(NOMINAL.layout),
        SensorNoise(1e-9),
        8,
    ).runs
    twice = np.diff(run.u.values, 2, axis=0) / run.step_s**2
    off = twice - run.a.values[1:-1]
    # What a simulator of relative coordinates records lacks the swing of the whole gear; K is 0.
    assert np.sqrt(np.mean(off**2)) < 0.02 * np.sqrt(np.mean(run.a.values**2))
    forces = run.F.values[:, [0, 3, 6, 9]].sum(axis=1)
    assert run.pin.values[:, 0] == pytest.approx(forces, rel=1e-6, abs=1e-3)


def test_the_command_writes_a_page_and_data(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "plan"
    point = "delta_T=72,K=0,T_1=2150,Omega=0.314"
    words = ["gap", "plan", "--nominal", "config/rig.yaml", "--sensors", ",".join(ONE_MESH)]
    words += ["--points", point, "--cycles", "20", "--also", "F_sp2_L", "--out", str(out)]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "backlash_offset" in said
    assert "one further sensor" in said
    content = json.loads((out / "plan.json").read_text())
    assert content["schema"] == "herringbone_sim/gap-plan/1"
    assert content["observations"] == ["force_law", "consistency"]
    assert {e["effect"] for e in content["effects"]} >= {"backlash_offset", "mean_stiffness"}
    assert list(content["also"]) == ["F_sp2_L"]
    assert "Which sensor to add first" in (out / "plan.html").read_text()


def test_bad_input_is_named() -> None:
    with pytest.raises(ParameterError, match=r"noise is 40dB .* got 'u=fast'"):
        noise_of("u=fast")
    with pytest.raises(ParameterError, match=r"got '1e-7'"):
        noise_of("1e-7")
    with pytest.raises(ParameterError, match=r"a point is .* got 'speed=1'"):
        point_of("speed=1", NOMINAL)
    with pytest.raises(ParameterError, match=r"sensors are some of .* got u_sun"):
        simulate_campaign(NOMINAL, TWO, ("u_sun",), SensorNoise(), 10)
    with pytest.raises(ParameterError, match=r"8 mesh cycles or more, got 0"):
        simulate_campaign(NOMINAL, TWO, SHAFTS, SensorNoise(), 0)


def test_raw_angles_are_rotations_whose_mean_is_not_known() -> None:
    """Their noise is in rad: 2e-6 at the base circle of the carrier."""
    noise = SensorNoise(values={"angle_c": 2e-6})
    run = simulate_campaign(NOMINAL, TWO[:1], ("u_s_L", "angle_c"), noise, CYCLES).runs[0]
    assert np.flatnonzero(run.u.recorded).tolist() == [0, 2]
    assert run.detrended == ("u_c",)
    assert run.u.sigma[2] == pytest.approx(2e-6 * run.model.scales.r_bc)
    # Beside a mesh whose force law is known they tell nothing, and take nothing away.
    beside = simulate_campaign(NOMINAL, TWO[:1], (*ONE_MESH, "angle_c"), noise, CYCLES).runs
    assert not only_windows_possible(beside)
    assert only_windows_possible(
        simulate_campaign(
            NOMINAL, TWO[:1], ("angle_s_L", "angle_s_R", "angle_c"), noise, CYCLES
        ).runs
    )


def test_noise_goes_by_the_longest_name() -> None:
    noise = noise_of("60dB,u=1e-7,F_pin=20dB")
    assert noise.sigma("u_c", 1.0) == 1e-7
    assert noise.sigma("F_pin1", 200.0) == pytest.approx(20.0)
    assert noise.sigma("F_sp1_L", 200.0) == pytest.approx(0.2)


def test_a_sensor_without_sizes_to_compare_has_no_gain() -> None:
    """No effect is named at half of its places, without the sensor or with it."""
    never = (np.inf, np.inf, "pin_position", 0.5, 0.0, (1.0,))
    one = Detectability("runout", Locus(), (), "m", 1e-5, *never)
    nothing = Plan(("u_c",), ("trajectory",), 100.0, (one,), (), ())
    content = plan_to_dict(nothing, [{"delta_T": 1.0}], 40, {"a_c": nothing})
    assert json.loads(json.dumps(content, allow_nan=False))["also"]["a_c"]["gain"] is None
    assert "nan" not in also_table(nothing, {"a_c": nothing})
