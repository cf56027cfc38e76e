"""Parameters and commands: taken, refused as a whole, acting without a jump."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterType
from rclpy.exceptions import ParameterException
from std_msgs.msg import Float64
from support import Bench, values, wait_until

from herringbone_sim.core.parameters import live_names
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.reader import read_recording


def test_an_integer_is_taken_where_a_double_is_meant(bench: Bench) -> None:
    node = bench.simulator(delta_T=80)
    assert bench.set(K=1)[0].successful
    assert node.get_parameter("K").value == 1.0
    assert node.get_parameter("delta_T").value == 80.0


def test_describe_reads_like_a_manual(bench: Bench) -> None:
    bench.simulator()
    for about in bench.describe(*live_names(), "real_time_factor", "publish_rate"):
        assert len(about.description) > 15
        assert not about.read_only
        ranges = [*about.floating_point_range, *about.integer_range]
        assert len(ranges) == 1
        assert about.type in (ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_INTEGER)
    assert "Eq. (2) [K]" in bench.describe("delta_T")[0].description
    assert bench.describe("z_s")[0].read_only


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e9])
def test_values_that_no_gear_has_are_refused(bench: Bench, bad: float) -> None:
    node = bench.simulator()
    names = ("K", "delta_T", "xi", "Omega", "real_time_factor", "publish_rate")
    for name in names:
        assert not bench.set(**{name: bad})[0].successful, name
    assert node.refused == len(names)
    assert "publish_rate" in node.last_refused
    assert node.get_parameter("K").value == 0.0


def test_a_refusal_says_rule_value_and_next_move(bench: Bench) -> None:
    bench.simulator()
    refused = bench.set(delta_T=400.0)[0]
    assert not refused.successful
    assert "half-backlash" in refused.reason
    assert "lower delta_T" in refused.reason


def test_a_set_is_taken_or_refused_as_a_whole(bench: Bench) -> None:
    node = bench.simulator()
    assert not bench.set_whole(K=0.2, delta_T=400.0).successful
    assert node.get_parameter("K").value == 0.0
    assert bench.set_whole(K=0.2, delta_T=40.0, xi=0.1).successful
    assert [node.get_parameter(n).value for n in ("K", "delta_T", "xi")] == [0.2, 40.0, 0.1]


def test_structure_is_read_only_while_running(bench: Bench) -> None:
    bench.simulator()
    for name, value in (("z_s", 30), ("model", "full"), ("b_c", 2e-4), ("order", 8)):
        assert not bench.set(**{name: value})[0].successful, name


def test_a_pace_at_which_samples_would_be_too_rare_is_refused(bench: Bench) -> None:
    bench.simulator()
    refused = bench.set(real_time_factor=1e-6)[0]
    assert not refused.successful
    assert "samples_per_cycle" in refused.reason


@pytest.mark.parametrize(
    "wrong",
    [{"K": "much"}, {"model": "half"}, {"n_planets": 0}, {"delta_T": 400.0}],
)
def test_a_node_with_impossible_parameters_does_not_start(
    bench: Bench, wrong: dict[str, object]
) -> None:
    with pytest.raises((ParameterError, ParameterException), match=next(iter(wrong))):
        bench.simulator(**wrong)


def test_parameters_of_other_nodes_are_warned_of_and_ignored(
    bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    """A file for all nodes (``/**:``) holds what is another's; a slip of the pen is shown."""
    node = bench.simulator(frame_id="map", kk=1.0, deltaT=70.0, K=0.25, start_paused=True)
    warned = capfd.readouterr().err
    assert "no parameter frame_id: ros2 param list shows what there is; it is ignored" in warned
    assert "no parameter kk: did you mean K?; it is ignored" in warned
    assert "no parameter deltaT: did you mean delta_T?; it is ignored" in warned
    assert node.get_parameter("K").value == 0.25
    assert not node.has_parameter("kk")


def test_an_unknown_parameter_is_refused_by_its_name(bench: Bench) -> None:
    bench.simulator(start_paused=True)
    (refused,) = bench.set(kk=1)
    assert not refused.successful
    assert refused.reason == "no parameter kk: did you mean K?"
    whole = bench.set_whole(K=0.3, no_such_thing=1)
    assert not whole.successful
    assert "no_such_thing" in whole.reason
    assert bench.simulators[0].get_parameter("K").value == 0.0


def test_values_are_taken_as_tools_of_ros_send_them(bench: Bench) -> None:
    """YAML 1.1 reads 1e-1 as a text; ``ros2 param set`` sends it so."""
    node = bench.simulator(start_paused=True)
    assert bench.set(xi="1e-1")[0].successful
    assert node.get_parameter("xi").value == 0.1
    for wrong in ("much", "nan", "", "[1.0]", True):
        assert not bench.set(xi=wrong)[0].successful, wrong
    assert node.get_parameter("xi").value == 0.1


def test_commands_steer_and_the_parameter_follows(bench: Bench) -> None:
    node = bench.simulator()
    for name, value in (("K", 0.3), ("delta_T", 62.5)):
        command = bench.client.create_publisher(Float64, f"/herringbone_sim/cmd/{name}", 10)
        wait_until(lambda c=command: c.get_subscription_count() > 0)
        command.publish(Float64(data=value))
        wait_until(lambda n=name, v=value: node.get_parameter(n).value == v)
    wait_until(lambda: node.loop.model.parameters.K == 0.3)
    assert bench.set(K=0.1)[0].successful  # the last writer wins
    wait_until(lambda: node.loop.model.parameters.K == 0.1)


def test_bad_commands_are_refused_counted_and_reported(bench: Bench) -> None:
    node = bench.simulator()
    command = bench.client.create_publisher(Float64, "/herringbone_sim/cmd/K", 10)
    wait_until(lambda: command.get_subscription_count() > 0)
    for bad in (math.nan, math.inf, 1e6):
        command.publish(Float64(data=bad))
    got = bench.listen(DiagnosticArray, "/diagnostics")
    wait_until(lambda: got and values(got[-1].status[0])["rejected_commands"] == "3")
    assert "K" in values(got[-1].status[0])["last_rejected_command"]
    assert node.get_parameter("K").value == 0.0


def test_changes_act_at_a_recorded_time_without_a_jump(bench: Bench, tmp_path: Path) -> None:
    node = bench.simulator(record=True, record_dir=str(tmp_path), delta_T=85.0)
    changes = {
        "K": 0.2,
        "delta_T": 70.0,
        "xi": 0.1,
        "T_1": 300.0,
        "Omega": 0.9,
        "control_phase": 0.5,
        "samples_per_cycle": 24,
        "real_time_factor": 0.9,
        "publish_rate": 50.0,
    }
    for name, value in changes.items():
        reached = node.loop.t_s
        wait_until(lambda t=reached: node.loop.t_s > t + 0.05)
        assert bench.set(**{name: value})[0].successful
    reached = node.loop.t_s
    wait_until(lambda: node.loop.t_s > reached + 0.1)
    assert bench.call("record/stop").success
    run = read_recording(next(tmp_path.iterdir()))
    assert {k: v for c in run.changes for k, v in c.values.items()} == changes
    x = run.samples.columns(("x_sp_L", "x_rp_R"))
    v = run.samples.columns(("v_sp_L", "v_rp_R"))
    usual_x, usual_v = np.abs(np.diff(x, axis=0)).max(0), np.abs(np.diff(v, axis=0)).max(0)
    for made in run.changes:
        at = int(np.argmin(np.abs(run.samples.times - made.t_s)))
        assert abs(run.samples.times[at] - made.t_s) < 1e-9
        dt = run.samples.times[at] - run.samples.times[at - 1]
        predicted = x[at - 1] + 0.5 * dt * (v[at - 1] + v[at])
        assert np.all(np.abs(x[at] - predicted) < 0.2 * usual_x), made
        assert np.all(np.abs(v[at] - v[at - 1]) <= usual_v), made
