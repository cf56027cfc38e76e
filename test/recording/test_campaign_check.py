"""``campaign check``: what a campaign holds, and which observations its channels allow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from herringbone_sim.__main__ import main
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.gap.campaign_checks import check
from herringbone_sim.gap.data.kinematics import bodies_to_meshes
from herringbone_sim.gap.data.prepare import prepare
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.diagnose import machine_of
from herringbone_sim.gap.feasible_observations import feasible_observations
from herringbone_sim.gap.sensor_calibration import calibrated_sensors
from herringbone_sim.gap.sensors.filter_delay import with_delayed_waves
from herringbone_sim.recording.campaign import read_campaign, write_campaign
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.rig import RigPlan, make_campaign
from herringbone_sim.recording.writer import RunWriter

PREFIXES = ("x_", "v_", "F_", "u_")
ALL = {"force_law", "torque_balance", "consistency"}
FEW = ("u_s_L", "u_s_R", "u_c")
SETS: dict[str, tuple[Callable[[str], bool], set[str]]] = {
    "full": (lambda n: True, ALL),
    "x_and_F": (lambda n: n[0] in "xF", ALL),  # twelve displacements of eight coordinates
    "no_force": (lambda n: n[0] in "xvu", {"torque_balance", "consistency"}),
    "few": (lambda n: n in FEW, {"trajectory"}),
    "nothing": (lambda n: False, set()),
}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rig") / "all"
    nominal = Parameters(model="full", samples_per_cycle=24)
    make_campaign(folder, RigPlan(nominal, runs=3, held_out=1, cycles=30), "bench")
    return folder


def part(rig: Path, folder: Path, keep: Callable[[str], bool]) -> Path:
    """The campaign with some of its channels of meshes and bodies."""
    runs = read_campaign(rig).runs
    for run in runs:
        series = read_recording(run.path).samples
        there = tuple(
            n for n in series.names if n in ("t", "phase") or (n[:2] in PREFIXES and keep(n))
        )
        writer = RunWriter.create(folder, run.path.name, "/rig", {}, there, 0)
        writer.write_samples(series.columns(there))
        writer.close()
    entries = [{"path": r.path.name, **r.point, "role": r.role} for r in runs]
    write_campaign(folder, "bench", entries, {"kind": "white", "rms_share": 0.01})
    return folder


@pytest.mark.parametrize("name", SETS)
def test_it_says_which_observations_can_be_formed(
    name: str, rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    keep, expected = SETS[name]
    folder = part(rig, tmp_path / name, keep)
    assert main(["campaign", "check", str(folder)]) == 0
    said = capsys.readouterr().out
    formed = {o for o in (*ALL, "trajectory") if f"{o}: can be formed" in said}
    assert formed == expected
    assert all(f"{o}: not formed, it needs" in said for o in ALL - expected)
    assert ("would name nothing" in said) == (not expected)
    (line,) = [one for one in said.splitlines() if one.startswith("run_00")]
    assert line.split()[4] == ("12/12" if keep("x_sp1_L") else "0/12")


def test_it_names_the_observations_that_a_diagnosis_forms_behind_a_late_filter(rig: Path) -> None:
    """Displacements that were computed from rotations before the filter count as measured."""

    def filtered(run: PreparedRun) -> PreparedRun:
        x = run.u.values @ bodies_to_meshes(run.model).T - with_delayed_waves(run, 1e-5).waves.e
        alone = run.with_measured("x", replace(run.x, values=x))
        return alone.without("v", run.v.recorded).without("F", run.F.recorded)

    campaign = prepare(rig, Parameters())
    campaign = replace(campaign, runs=tuple(map(filtered, campaign.runs)))
    diagnosed = machine_of(calibrated_sensors(check(campaign)[0]), ()).gear.observation_names
    assert feasible_observations(campaign)[0] == diagnosed
    assert "torque_balance" in diagnosed


def test_a_run_that_cannot_be_read_is_named_and_the_rest_is_told(
    rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = part(rig, tmp_path / "some", SETS["x_and_F"][0])
    file = folder / "campaign.yaml"
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    content["runs"].append(content["runs"][0] | {"path": "run_99"})
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    assert main(["campaign", "check", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "run_99 is not used" in said
    assert "force_law: can be formed" in said


def test_the_nominal_gear_of_the_folder_is_taken(
    rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By a data sheet of four planets the channels of three are not all."""
    folder = part(rig, tmp_path / "four", SETS["x_and_F"][0])
    four = "/**:\n  ros__parameters:\n    n_planets: 4\n    model: full\n"
    (folder / "nominal.yaml").write_text(four, encoding="utf-8")
    assert main(["campaign", "check", str(folder)]) == 0
    assert "12/16" in capsys.readouterr().out


def test_channels_beside_those_of_meshes_and_bodies_are_named(
    rig: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["campaign", "check", str(rig)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [one for one in lines if one.startswith("run_01") and one.endswith("K, delta_T, T_1")]


def test_no_campaign_is_one_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["campaign", "check", str(tmp_path)]) == 2
    assert "campaign.yaml" in capsys.readouterr().err
