"""Every topic of the node, over real DDS."""

from __future__ import annotations

import json
import math
import threading
import time
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from support import LATCHED, Bench, table, values, wait_until

from herringbone_sim.core.integrate import warm_up
from herringbone_sim.core.layout import Layout
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.numba_private import event
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.errors import ParameterError
from herringbone_sim.ros import sim_clock

STATE = "/herringbone_sim/state"
SAMPLES = "/herringbone_sim/samples"


def test_samples_are_complete_and_in_the_contracts_form(bench: Bench) -> None:
    """At a twentieth of the speed, as a reader that falls behind by 10 blocks misses some."""
    got = bench.listen(Float64MultiArray, SAMPLES)
    bench.simulator(model="full", real_time_factor=0.05)
    wait_until(lambda: len(got) > 20)
    blocks = [table(message) for message in got[:20]]
    assert all(names == Layout(3, True).channels for names, _ in blocks)
    assert all(8 * rows.size < 64_000 for _, rows in blocks)
    rows = np.vstack([rows for _, rows in blocks])
    np.testing.assert_allclose(np.diff(rows[:, 1]), 2 * np.pi / 16, rtol=1e-9)
    assert np.all(np.diff(rows[:, 0]) > 0)


def test_state_names_meshes_with_arrays_of_one_length(bench: Bench) -> None:
    bench.simulator(model="full")
    state = bench.take(JointState, STATE, 3)[-1]
    assert tuple(state.name) == Layout(3, True).meshes
    assert len(state.position) == len(state.velocity) == len(state.effort) == 12
    stamp = state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec
    assert 0.0 <= stamp < 60.0  # simulation time, not that of the wall


def test_slow_state_is_stroboscopic(bench: Bench) -> None:
    """At 5.1 kHz and 50 Hz a live plot would be an alias; P1 must be one line."""
    node = bench.simulator(delta_T=90.0, publish_rate=50.0)
    period = 2 * math.pi / (node.loop.model.scales.omega_n)
    wait_until(lambda: node.loop.t_s > 0.5)
    states = bench.take(JointState, STATE, 10)
    stamps = np.array([s.header.stamp.sec + 1e-9 * s.header.stamp.nanosec for s in states])
    turns = stamps / period
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-4)
    positions = np.array([s.position for s in states])
    assert np.ptp(positions, axis=0).max() < 1e-9


def test_fast_state_resolves_the_cycle(bench: Bench) -> None:
    bench.simulator(delta_T=90.0, real_time_factor=1e-3, publish_rate=1000.0)
    states = bench.take(JointState, STATE, 32)
    assert np.ptp([s.position[0] for s in states[16:]]) > 1e-5


def test_channels_reach_a_late_subscriber(bench: Bench) -> None:
    bench.simulator(K=0.25)
    bench.take(JointState, STATE)
    content = json.loads(bench.take(String, "/herringbone_sim/channels", 1, LATCHED)[0].data)
    assert [c["name"] for c in content["channels"]] == list(Layout(1, False).channels)
    assert all(c["unit"] and c["meaning"] for c in content["channels"])
    assert content["parameters"]["K"] == 0.25
    assert content["integrator"]["method"] == "taylor"


def test_channels_are_told_and_diagnostics_say_compiling_before_the_kernel_is_ready(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A full model that compiles beside another sends nothing else for half a minute."""
    compiled = threading.Event()

    def slow(model: Model) -> None:
        with event.trigger_event("numba:compile"):
            assert compiled.wait(60.0)

    monkeypatch.setattr("herringbone_sim.runtime.loop.warm_up", slow)
    got = bench.listen(DiagnosticArray, "/diagnostics")
    bench.simulator(K=0.25)
    content = json.loads(bench.take(String, "/herringbone_sim/channels", 1, LATCHED)[0].data)
    assert content["parameters"]["K"] == 0.25
    assert content["state"]["t"] == 0.0
    wait_until(lambda: got)
    assert got[0].status[0].message == "compiling the kernel"
    assert not bench.simulators[0].loop.ready
    compiled.set()
    wait_until(lambda: got[-1].status[0].message in ("running", "behind"))
    assert "compiling the kernel, once on this machine" in capfd.readouterr().err


def test_what_is_loaded_from_the_cache_is_not_called_compiling(
    bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    warm_up(build(Parameters()))
    got = bench.listen(DiagnosticArray, "/diagnostics")
    node = bench.simulator()
    wait_until(lambda: node.loop.ready and len(got) > 1)
    assert not any("compiling" in one.status[0].message for one in got)
    assert "compiling" not in capfd.readouterr().err


def test_two_gears_are_told_apart_in_diagnostics_and_regime(bench: Bench) -> None:
    for side in ("left", "right"):
        bench.simulator(side)
    wanted = {f"/{side}/herringbone_sim" for side in ("left", "right")}
    statuses = [m.status[0] for m in bench.take(DiagnosticArray, "/diagnostics", 6)]
    assert {one.hardware_id for one in statuses} == wanted
    assert {one.name for one in statuses} == {f"{name}: simulator" for name in wanted}
    for name in wanted:
        regime = bench.take(DiagnosticArray, f"{name}/regime")[0].status[0]
        assert (regime.name, regime.hardware_id) == (f"{name}: regime", name)


def test_quality_of_service_is_overridden_by_parameter(bench: Bench) -> None:
    own = "qos_overrides./herringbone_sim"
    node = bench.simulator(
        **{
            f"{own}/state.publisher.reliability": "best_effort",
            f"{own}/state.publisher.depth": 3,
            f"{own}/cmd/K.subscription.reliability": "best_effort",
        }
    )
    (state,) = bench.client.get_publishers_info_by_topic(STATE)
    (samples,) = bench.client.get_publishers_info_by_topic(SAMPLES)
    (command,) = bench.client.get_subscriptions_info_by_topic("/herringbone_sim/cmd/K")
    assert state.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert samples.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert command.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert node.get_parameter(f"{own}/samples.publisher.depth").value == 10
    assert node.get_parameter("qos_overrides./diagnostics.publisher.history").value == "keep_last"


@pytest.mark.parametrize(
    ("policy", "value"), [("reliability", "perhaps"), ("depth", -1), ("history", 5)]
)
def test_a_quality_that_there_is_not_is_refused(bench: Bench, policy: str, value: object) -> None:
    name = f"qos_overrides./herringbone_sim/state.publisher.{policy}"
    with pytest.raises(ParameterError, match=r"state: .*keep_last"):
        bench.simulator(**{name: value})


def test_section_has_one_point_a_mesh_cycle_at_phase_0(bench: Bench) -> None:
    got = bench.listen(Float64MultiArray, "/herringbone_sim/section")
    bench.simulator()
    wait_until(lambda: len(got) > 3)
    names, _ = table(got[0])
    assert names[:2] == ("t", "phase")
    turns = np.concatenate([table(m)[1][:, 1] for m in got[:4]]) / (2 * np.pi)
    np.testing.assert_allclose(np.diff(turns), 1.0, rtol=1e-9)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)


def regime_of(bench: Bench, cycles: int) -> dict[str, str]:
    got = bench.listen(DiagnosticArray, "/herringbone_sim/regime")
    wait_until(
        lambda: got and int(values(got[-1].status[0])["cycles_since_change"]) > cycles, 30.0
    )
    return values(got[-1].status[0])


def test_regime_tells_period_1_with_a_negative_exponent(bench: Bench) -> None:
    bench.simulator(delta_T=90.0)
    seen = regime_of(bench, 4000)
    assert seen["regime"] == "P1"
    assert float(seen["largest_exponent"]) < 0
    shares = [float(seen[f"{state}_sp_L"]) for state in ("contact", "separated", "back_contact")]
    assert abs(sum(shares) - 1.0) < 1e-3
    assert min(shares) > 0


def test_regime_tells_chaos_with_a_positive_exponent(bench: Bench) -> None:
    bench.simulator(delta_T=20.0)
    seen = regime_of(bench, 4000)
    assert seen["regime"] == "chaotic"
    assert float(seen["largest_exponent"]) > 0.01


def test_samples_go_on_when_a_regime_can_not_be_published(bench: Bench) -> None:
    node = bench.simulator(start_paused=True)
    failures: list[object] = []

    def fail(*deliveries: object) -> None:
        failures.append(deliveries)
        raise RuntimeError("no regime")

    node.streams._onward = fail
    node.streams._last_regime_s = math.inf  # not yet due with a sample, but with an empty queue
    got = bench.listen(Float64MultiArray, SAMPLES)
    assert bench.call("step").success
    wait_until(lambda: failures)
    seen = len(got)
    assert bench.call("step").success
    wait_until(lambda: len(got) > seen)
    assert node.streams.dropped == 0


def test_diagnostics_tell_how_it_runs(bench: Bench) -> None:
    bench.simulator(real_time_factor=0.05)
    got = bench.listen(DiagnosticArray, "/diagnostics")
    reached = "real_time_factor_reached"
    wait_until(lambda: got and 0.03 < float(values(got[-1].status[0])[reached]) < 0.07)
    seen = values(got[-1].status[0])
    assert {"overruns", "dropped_blocks", "recorder", "mirror", "last_rejected_command"} <= set(
        seen
    )


def test_clock_is_published_on_demand_only(bench: Bench) -> None:
    bench.simulator()
    bench.take(JointState, STATE)
    assert bench.client.count_publishers("/clock") == 0


def test_clock_follows_the_simulation_and_has_one_publisher(bench: Bench) -> None:
    bench.simulator("one", publish_clock=True, real_time_factor=0.1)
    bench.simulator("two", publish_clock=True)
    ticks = [c.clock.sec + 1e-9 * c.clock.nanosec for c in bench.take(Clock, "/clock", 30)]
    assert np.all(np.diff(ticks) >= 0)
    assert ticks[-1] > ticks[0]
    assert bench.client.count_publishers("/clock") == 1


def test_a_clock_that_is_discovered_late_has_it_alone(bench: Bench) -> None:
    """The node gives way to it, and says nothing more on the topic."""
    node = bench.simulator(publish_clock=True)
    bench.client.create_publisher(Clock, "/clock", 10)

    def publishers() -> set[str]:
        return {p.node_name for p in bench.client.get_publishers_info_by_topic("/clock")}

    assert node.get_name() in publishers()
    wait_until(lambda: publishers() == {bench.client.get_name()})


class FakeNode:
    """A node that discovers other publishers of /clock only once it has one; all are ``live``."""

    live: ClassVar[list[FakeNode]] = []

    def count_publishers(self, topic: str) -> int:
        return len(self.live) if self in self.live else 0

    def create_timer(self, *given: object, **named: object) -> FakeNode:
        return self

    def cancel(self) -> None:
        pass

    def destroy_publisher(self, publisher: FakeNode) -> None:
        self.live.remove(publisher)

    def publish(self, message: Clock) -> None:
        pass

    def get_logger(self) -> FakeNode:
        return self

    def error(self, text: str) -> None:
        pass


def test_of_two_clocks_that_start_together_one_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither has discovered the other when it starts; if both gave way, time would stand."""
    monkeypatch.setattr(sim_clock, "DISCOVERY_S", 0.0)
    monkeypatch.setattr(sim_clock, "PATIENCE_S", 0.2)
    monkeypatch.setattr(FakeNode, "live", [])
    monkeypatch.setattr(
        sim_clock, "open_publisher", lambda node, *rest: FakeNode.live.append(node) or node
    )
    clocks = [sim_clock.SimClock(FakeNode(), None, None, lambda: 0.0) for _ in range(2)]
    assert len(FakeNode.live) == 2
    for _ in range(30):
        for clock in clocks:
            clock.tick()
        time.sleep(0.01)
    assert len(FakeNode.live) == 1


def test_blocks_leave_often_however_slow(bench: Bench) -> None:
    """The slowest factor that is taken still sends samples about every 0.1 s."""
    got = bench.listen(Float64MultiArray, SAMPLES)
    bench.simulator(real_time_factor=1.3e-4)
    wait_until(lambda: len(got) >= 10)


def test_two_nodes_in_two_namespaces_do_not_meet(bench: Bench) -> None:
    bench.simulator("left", K=0.1)
    bench.simulator("right", K=0.2)
    for name, K in (("left", 0.1), ("right", 0.2)):
        names, rows = table(bench.take(Float64MultiArray, f"/{name}/herringbone_sim/samples")[0])
        assert set(rows[:, names.index("K")]) == {K}
    assert bench.set("/left/herringbone_sim", K=0.3)[0].successful
    assert bench.simulators[1].get_parameter("K").value == 0.2


def test_a_subscriber_that_is_slow_late_or_gone_loses_nothing_for_the_recorder(
    bench: Bench, tmp_path: Path
) -> None:
    node = bench.simulator(record=True, record_dir=str(tmp_path))
    slow = bench.client.create_subscription(
        Float64MultiArray, SAMPLES, lambda _: time.sleep(0.2), 1
    )
    wait_until(lambda: node.loop.t_s > 1.0)
    bench.client.destroy_subscription(slow)
    bench.take(Float64MultiArray, SAMPLES, 5)
    answer = bench.call("record/stop")
    assert answer.success
    assert ", 0 lost," in answer.message


def documented() -> list[list[str]]:
    """Rows of the table of topics: name, type, quality of service."""
    page = Path(__file__).resolve().parents[2] / "docs" / "ros2.md"
    _, table_and_rest = page.read_text(encoding="utf-8").split("| topic | type | quality", 1)
    lines = table_and_rest.split("\n\n", 1)[0].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split("|")][:3] for line in lines]


def test_the_documented_topics_types_and_qualities_are_those_of_the_node(bench: Bench) -> None:
    node = bench.simulator(publish_clock=True, start_paused=True)
    for names, kind, quality in documented():
        for name in names.replace("`", "").split(", "):
            topic = name.replace("~", "/herringbone_sim")
            taken = kind.endswith(", subscribed")
            ask = (
                bench.client.get_subscriptions_info_by_topic
                if taken
                else bench.client.get_publishers_info_by_topic
            )
            wait_until(lambda a=ask, t=topic: a(t))
            found = [one for one in ask(topic) if one.node_name == node.get_name()]
            assert {one.topic_type.replace("/msg/", "/") for one in found} == {kind.split(",")[0]}
            (profile,) = [one.qos_profile for one in found]
            assert (profile.reliability == ReliabilityPolicy.RELIABLE) == ("reliable" in quality)
            latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
            assert latched == ("transient local" in quality), topic
            role = "subscription" if taken else "publisher"
            depth = f"qos_overrides.{topic}.{role}.depth"
            if node.has_parameter(depth):
                assert f"last {node.get_parameter(depth).value}" in quality


def test_a_quality_of_service_is_overridden_on_the_command_line(bench: Bench) -> None:
    name = "qos_overrides./herringbone_sim/state.publisher.reliability"
    bench.simulator(cli_args=["--ros-args", "-p", f"{name}:=best_effort"], start_paused=True)
    (state,) = bench.client.get_publishers_info_by_topic(STATE)
    assert state.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
