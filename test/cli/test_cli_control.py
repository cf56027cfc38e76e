"""The verb ``control``: tables, figures, going on, refusals."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from gears import PAPER
from matplotlib.figure import Figure

from herringbone_sim.__main__ import main
from herringbone_sim.cli import control_parts, control_text
from herringbone_sim.cli.control_parts import Size
from herringbone_sim.cli.control_text import TARGETS
from herringbone_sim.control.amplitude import LeastAmplitude, Staircase, Survey, Target, run_survey
from herringbone_sim.control.realisation import Actuator, TorqueDemand
from herringbone_sim.control.robustness import Survival
from herringbone_sim.control.runs import MotionRunner, Motions, RunSettings
from herringbone_sim.control.starts import Starts
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.recording.parameter_file import load_parameters
from herringbone_sim.sweeps.grid import Axis
from herringbone_sim.views.figures import torques
from herringbone_sim.views.figures.control import amplitude_figure
from herringbone_sim.views.figures.torques import realisation_figure

COMMAND = ["control", "--parameters", str(PAPER), "--set", "xi=0.085", "--quick"]
SMALL = Size(2, 6, 4, (0.5, 0.6180339887498949, 1.0), 3, RunSettings(transient=60, cycles=60))


def rows(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    out = tmp_path_factory.mktemp("control") / "new"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("herringbone_sim.cli.control.QUICK", SMALL)
        assert main([*COMMAND, "--out", str(out)]) == 0
    return out


def test_every_run_of_the_survey_is_a_row(written):
    runs = rows(written / "amplitude.csv")
    assert len(runs) == 2 * 6 * 6
    assert {one["start"].split()[0] for one in runs} == {"zero", "running", "alike", "parted"}
    least = rows(written / "least.csv")
    assert len(least) == 2 * 3 * 4
    for one in least:
        if one["least_K"] and one["held_from_K"]:
            assert float(one["least_K"]) <= float(one["held_from_K"])
            assert one["pockets"]


def test_the_carrier_realises_the_control_of_the_paper(written):
    found = {one["actuator"]: one for one in rows(written / "actuators.csv")}
    carrier = found["carrier"]
    assert {carrier[f"share_{mesh}"] for mesh in ("sp_L", "sp_R", "rp_L", "rp_R")} == {"1"}
    assert 0.3 * float(carrier["n_m_per_K_c"]) == pytest.approx(1.05e5, rel=0.01)
    assert float(found["sun"]["n_m_per_K_c"]) == 0.0
    for one in rows(written / "needed.csv"):
        if one["K"]:
            torques = [float(v) for k, v in found[one["actuator"]].items() if "n_m" in k]
            expected = float(one["K"]) * max(map(abs, torques))
            assert float(one["torque_n_m"]) == pytest.approx(expected, rel=1e-4)


def test_maps_are_whole(written):
    assert len(rows(written / "phase.csv")) == 4 * 6
    orders = rows(written / "order.csv")
    assert len(orders) == 3 * 6
    golden = [one for one in orders if one["control_order"] == "0.618033989" and one["K"] != "0"]
    assert {one["period"] for one in golden} == {"0"}
    assert len(rows(written / "survival.csv")) == 2 * 6 * 4
    for one in rows(written / "starts.csv"):
        assert int(one["reached"]) + int(one["parted"]) <= int(one["starts"]) == 3
        low, share, high = (float(one[name]) for name in ("low", "share", "high"))
        assert low - 1e-12 <= share <= high + 1e-12


@pytest.mark.parametrize("part", sorted(control_parts.PARTS))
def test_each_part_is_drawn(written, part):
    for kind in ("png", "svg"):
        assert (written / f"control_{part}.{kind}").stat().st_size > 20_000


def forced_survey():
    """Periods of 3, 3, 6 and 0 mesh cycles at four K, from each of two starts, forced every 3."""
    K = np.array([0.0, 0.1, 0.2, 0.3])
    period = np.repeat([3.0, 3.0, 6.0, 0.0], 2)
    motions = Motions(period, *[np.zeros(8)] * 7, np.zeros((8, 8)))
    starts, delta_T = Starts(alike=0, parted=0), Axis("delta_T", (20.0,))
    states = np.zeros((1, 2, 8))
    return Survey(Parameters(), delta_T, K, starts, states, RunSettings(), motions, 3)


def test_motions_are_named_by_the_period_of_the_forcing():
    survey = forced_survey()
    first, second = control_text.window_lines(survey)
    for line in (first, second):
        assert line.endswith("0.00-0.10 P1, 0.20-0.20 P2, 0.30-0.30 aperiodic")
    (line,) = control_text.contact_lines(survey)
    assert line.startswith("P1 from the zero start, 1 runs with K > 0")


def test_motions_are_drawn_by_the_period_of_the_forcing():
    figure = amplitude_figure(forced_survey(), [], 1.0)
    left, right = (axes.collections[0].get_array().ravel() for axes in figure.axes[:2])
    assert left.tolist() == [1.0, 1.0, 2.0, 0.0]  # places of P1, P1, P2, aperiodic
    assert right.tolist() == [3.0, 3.0, 2.0, 0.0]
    assert "periods of the forcing" in figure.axes[0].get_title(loc="left")


def test_a_second_run_computes_nothing(written, monkeypatch, capsys):
    monkeypatch.setattr("herringbone_sim.cli.control.QUICK", SMALL)
    monkeypatch.setattr("herringbone_sim.control.runs.run_batch", None)
    before = (written / "least.csv").read_bytes()
    assert main([*COMMAND, "--only", "amplitude", "--out", str(written)]) == 0
    assert (written / "least.csv").read_bytes() == before
    assert "firm" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--only", "magic"], "--only takes amplitude"),
        (["--workers", "0"], "--workers must be"),
        (["--set", "model=full"], "model: reduced"),
        (["--set", "delta_T=900"], "half-backlash"),
    ],
)
def test_what_cannot_be_done_is_said(tmp_path, capsys, more, message):
    assert main([*COMMAND, *more, "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_is_said(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main([*COMMAND, "--only", "shape", "--out", str(tmp_path / "file" / "out")]) == 2
    assert "--out" in capsys.readouterr().err


@pytest.mark.parametrize("T_1", [220.0, -220.0, 0.0, 1e6])
def test_all_torques_lie_within_the_axes(T_1):
    carrier = Actuator("carrier", (1.0,) * 4, (0.0, 0.0, 3.4e5, 0.0, 0.0))
    needs = [TorqueDemand(carrier, Target(n, "all"), 0.0, 1.2, 2.0, 4.08e5) for n in (1, 2)]
    low, high = realisation_figure([carrier], [], needs, T_1).axes[1].get_xlim()
    assert low < 4.08e5 < high
    assert not T_1 or low < abs(T_1) < high


def test_nothing_is_told_of_transverse_exponents_that_are_not_known():
    gear = load_parameters(PAPER).changed({"xi": 0.085, "k_factor": (1.02, 1.0, 1.02, 1.0)})
    axis, K = Axis("delta_T", (70.0,)), np.array([0.0, 0.4])
    alike, settings = Starts(0, 0, running=False), RunSettings(200, 80, True)
    across = run_survey(MotionRunner(), gear, axis, K, alike, settings)
    assert control_text.transverse_lines(across) == []


def test_the_distance_of_the_running_gear_is_named_so():
    case = Survival("k_factor", 0.01, 1, 2.0, False, True, 0, 8, 0.006)
    assert "distance of that from running" in control_text.survival_lines([case])[0]


def test_the_error_alone_has_its_own_amplitude():
    stair = Staircase(0.2, 0.2, 0.2, ((0.2, 1.0),), 0.8)
    least = LeastAmplitude(0.0, TARGETS[0], stair, 0.01)
    (line,) = control_text.error_lines([least], Parameters(e_amp=(0.5,)))
    assert line.endswith("alone is 0.175")  # e_m of 0.35 by half


def test_temperatures_without_a_gear_are_left_out(tmp_path):
    gear = load_parameters(PAPER).changed({"xi": 0.085, "b": 0.2, "delta_T": 10.0})
    control_parts.robustness(MotionRunner(), gear, SMALL, tmp_path)
    found = {float(one["delta_T"]) for one in rows(tmp_path / "starts.csv")}
    assert found == {20.0, 50.0}  # at 70 K the backlash is used up


@pytest.mark.parametrize(("torque", "scales"), [(3.5e5, 1), (float("nan"), 0)])
def test_torques_on_the_carrier_are_drawn_if_it_can_be_the_control(torque, scales):
    axes = amplitude_figure(forced_survey(), [], torque).axes[1]
    assert len(axes.child_axes) == scales


def test_a_motion_from_the_running_gear_alone_has_the_mark_of_what_was_wanted():
    case = Survival("k_factor", 0.01, 1, 2.0, False, True, 0, 8, 0.006)
    axes = Figure().add_subplot()
    torques._draw_survival(axes, [case])
    assert [line.get_marker() for line in axes.lines if list(line.get_xdata()) == [1.0]][-1] == "o"
