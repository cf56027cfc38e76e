"""No message from outside ends the node: it is refused, counted, reported and answered."""

from __future__ import annotations

import math
import threading

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.executors import SingleThreadedExecutor
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64
from support import Bench, values, wait_until

from herringbone_sim.ros.guarded import LONGEST_LINE, one_line

NUMBER = ParameterValue(type=3, double_value=0.2)
NO_TYPE = ParameterValue(type=37)


def alive(bench: Bench) -> bool:
    request = GetParameters.Request(names=["K"])
    answer = bench.request(GetParameters, "/herringbone_sim/get_parameters", request)
    return len(answer.values) == 1


def test_a_type_that_there_is_not_is_refused_and_the_rest_is_taken(bench: Bench) -> None:
    node = bench.simulator(start_paused=True)
    results = bench.set_messages(
        Parameter(name="K", value=NO_TYPE), Parameter(name="xi", value=NUMBER)
    )
    assert [one.successful for one in results] == [False, True]
    assert "37" in results[0].reason
    assert "K" in results[0].reason
    request = SetParametersAtomically.Request(parameters=[Parameter(name="K", value=NO_TYPE)])
    name = "/herringbone_sim/set_parameters_atomically"
    assert not bench.request(SetParametersAtomically, name, request).result.successful
    assert alive(bench)
    assert node.refused == 2
    got = bench.listen(DiagnosticArray, "/diagnostics")
    wait_until(lambda: got and values(got[-1].status[0])["rejected_commands"] == "2")
    assert "37" in values(got[-1].status[0])["last_rejected_command"]


def test_a_refusal_in_the_words_of_rclpy_names_the_parameter(bench: Bench) -> None:
    node = bench.simulator(start_paused=True)
    text = ParameterValue(type=4, string_value="lots")
    for value in (ParameterValue(type=0), text, ParameterValue(type=1, bool_value=True)):
        for name in ("xi", "step_cycles", "record_dir", "z_s"):
            if value is text and name == "record_dir":
                continue
            (refused,) = bench.set_messages(Parameter(name=name, value=value))
            assert not refused.successful
            assert name in refused.reason
            assert node.last_refused == refused.reason


def test_a_clock_that_no_clock_shows_is_refused(bench: Bench) -> None:
    node = bench.simulator(start_paused=True, use_sim_time=True)
    clock = bench.client.create_publisher(Clock, "/clock", 10)
    wait_until(lambda: clock.get_subscription_count() > 0)
    wrong = Clock()
    wrong.clock.sec = -5
    clock.publish(wrong)
    wait_until(lambda: node.refused == 1)
    assert "/clock" in node.last_refused
    assert alive(bench)


def test_a_long_value_is_refused_in_one_line(bench: Bench) -> None:
    node = bench.simulator(start_paused=True)
    for name in ("effects", "record_dir", "record_name", "xi", "x" * 10**6):
        (refused,) = bench.set(**{name: "tooth\n" * 10**5})
        assert not refused.successful, name
        assert len(refused.reason) < 400
        assert "\n" not in refused.reason
    assert node.refused == 5
    assert alive(bench)


def test_a_long_text_keeps_its_ends() -> None:
    said = one_line("begin " + "x" * 1000 + " end")
    assert len(said) <= LONGEST_LINE
    assert said.startswith("begin x")
    assert said.endswith("x end")
    assert one_line(said) == said


def test_an_error_of_ours_in_a_callback_is_counted_and_answered(bench: Bench) -> None:
    node = bench.simulator(start_paused=True)
    node.loop.resume = lambda: 1 / 0  # type: ignore[method-assign]
    answer = bench.call("resume")
    assert not answer.success
    assert "ZeroDivisionError" in answer.message
    node.loop.submit = lambda *_: 1 / 0  # type: ignore[assignment]
    (refused,) = bench.set(K=0.1)
    assert not refused.successful
    assert "ZeroDivisionError" in refused.reason
    command = bench.client.create_publisher(Float64, "/herringbone_sim/cmd/delta_T", 10)
    wait_until(lambda: command.get_subscription_count() > 0)
    command.publish(Float64(data=70.0))
    command.publish(Float64(data=math.nan))
    wait_until(lambda: node.refused == 4)
    assert alive(bench)


def test_diagnostics_go_on_while_a_parameter_takes_its_time(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Effects that are set while a kernel compiles wait for the compiler."""
    bench.simulator(start_paused=True)
    got = bench.listen(DiagnosticArray, "/diagnostics")
    compiled = threading.Event()
    monkeypatch.setattr(
        "herringbone_sim.ros.node.check_effects", lambda *_: compiled.wait(60.0) and None
    )
    request = SetParameters.Request(parameters=[Parameter(name="K", value=NUMBER)])
    setting = bench.client.create_client(SetParameters, "/herringbone_sim/set_parameters")
    assert setting.wait_for_service(20.0)
    answer = setting.call_async(request)
    told = len(got)
    wait_until(lambda: len(got) >= told + 3)
    assert not answer.done()
    compiled.set()
    wait_until(answer.done)
    assert answer.result().results[0].successful


def test_an_error_of_the_executor_is_counted_and_ends_nothing(bench: Bench) -> None:
    node = bench.simulator(start_paused=True)
    turns = iter(range(4))

    class Broken(SingleThreadedExecutor):
        def spin_once(self, timeout_sec: float | None = None) -> None:
            raise RuntimeError(f"turn {next(turns)}")

    executor = Broken(context=bench.context)
    left = iter((True, True, True, False))
    node.serve(executor, lambda: next(left))
    executor.shutdown()
    assert node.refused == 3
    assert "turn 2" in node.last_refused


def test_short_texts_stay_as_they_are() -> None:
    assert [one_line(text) for text in ("", "OK", " a\n b ")] == ["", "OK", "a b"]
