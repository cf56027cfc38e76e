"""``gap live`` over real DDS: two machines of other rates, late, lossy and cut streams."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from support import Bench, wait_until

from herringbone_sim.core.integrate import simulate
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.gap.stream.comparison import ComparisonResult
from herringbone_sim.recording.messages import encode_samples
from herringbone_sim.ros.gap_live import GapNode, Plan

SLOW = {"real_time_factor": 0.02, "delta_T": 60.0}
NOMINAL = Parameters()


@pytest.fixture
def listener(bench: Bench) -> Iterator[GapNode]:
    plan = Plan("/rig/herringbone_sim", "/herringbone_sim", NOMINAL)
    node = GapNode(plan, context=bench.context)
    bench.executor.add_node(node)
    yield node
    bench.executor.remove_node(node)
    node.destroy_node()


def look_until(node: GapNode, true: Any) -> ComparisonResult:
    seen: list[ComparisonResult] = []

    def looked() -> bool:
        seen.append(node.look())
        return bool(true(seen[-1]))

    wait_until(looked, 60.0)
    return seen[-1]


def test_a_stiffer_rig_is_placed_beside_a_simulator_of_another_rate(
    bench: Bench, listener: GapNode
) -> None:
    residuals = bench.listen(JointState, "/gap/residual")
    differences = bench.listen(JointState, "/gap/difference")
    places = bench.listen(String, "/gap/place")
    early = listener.look()
    assert early.residual is None
    assert "nothing on /rig/herringbone_sim/samples yet" in early.remarks
    omega_n = build(NOMINAL).scales.omega_n
    bench.simulator("rig", k_m_sp=1.1 * NOMINAL.k_m_sp, omega_n=omega_n, model="full", **SLOW)
    bench.simulator(samples_per_cycle=32, model="full", **SLOW)
    picture = look_until(listener, lambda p: p.residual is not None and p.comparable)
    assert picture.residual is not None
    assert picture.residual.shares_by("kind")["sp"] > 0.95
    wait_until(lambda: residuals and differences and places)
    wait_until(lambda: {"shares", "statistics"} <= json.loads(places[-1].data).keys())
    assert tuple(residuals[-1].name) == build(NOMINAL.changed({"model": "full"})).layout.meshes
    lengths = {len(getattr(residuals[-1], q)) for q in ("position", "velocity", "effort")}
    assert lengths == {12}
    np.testing.assert_allclose(sum(residuals[-1].position), 1.0)
    assert len(differences[-1].name) == 12
    content = json.loads(places[-1].data)
    assert content["shares"]["kind"]["sp"] > 0.95
    assert content["statistics"]["rp1_R"]["force_rms_rig"] > 0.0
    before, told = len(differences), len(places)
    listener._publish(replace(picture, simulator=replace(picture.simulator, age_s=60.0)))
    wait_until(lambda: len(places) > told)
    assert len(differences) == before  # what a silent simulator did is no difference now


def test_what_a_silent_simulator_says_of_itself_is_told(bench: Bench, listener: GapNode) -> None:
    """It may compile for half a minute, or stand paused: that is why nothing comes."""
    bench.simulator("rig", start_paused=True)
    picture = look_until(listener, lambda p: p.rig.diagnostics == "paused")
    assert "nothing on /rig/herringbone_sim/samples yet (it says: paused)" in picture.remarks
    assert "nothing on /herringbone_sim/samples yet" in picture.remarks


def test_a_best_effort_rig_without_forces_that_loses_blocks_is_heard(
    bench: Bench, listener: GapNode
) -> None:
    qos = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
    out = bench.client.create_publisher(Float64MultiArray, "/rig/herringbone_sim/samples", qos)
    series, _ = simulate(build(NOMINAL.changed({"model": "full", "delta_T": 60.0})), 100)
    names = tuple(name for name in series.names if not name.startswith("F_"))
    rows, sent = series.columns(names), 0

    def send_and_look() -> bool:
        nonlocal sent
        if sent % 16 != 15:
            first = 100 * (sent % 16)
            block = rows[first : first + 100].copy()
            block[:, 0] += series.times[-1] * (sent // 16) * 2.0
            out.publish(encode_samples(names, block))
        sent += 1
        seen.append(listener.look() if sent % 8 == 0 else None)
        found = seen[-1]
        return found is not None and found.residual is not None and found.rig.lost > 0

    seen: list[ComparisonResult | None] = []
    wait_until(send_and_look, 60.0)
    picture = seen[-1]
    assert picture is not None
    assert picture.residual is not None
    assert picture.residual.metric == "torque_balance"
    assert any("no forces" in text for text in picture.remarks)


def test_the_command_tells_what_is_missing_and_ends_well_on_an_interrupt(domain: int) -> None:
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "PYTHONWARNINGS": "ignore"}
    command = [sys.executable, "-m", "herringbone_sim", "gap", "live", "--every", "0.2"]
    running = subprocess.Popen(
        command, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert running.stdout is not None
    first = running.stdout.readline()
    running.send_signal(signal.SIGINT)
    _, errors = running.communicate(timeout=60)
    assert "nothing on /rig/samples yet" in first
    assert running.returncode == 0, errors
    assert "Traceback" not in errors


@pytest.mark.parametrize("prefix", ["rig", "/rig", "/rig/"])
def test_a_prefix_needs_no_slash(bench: Bench, prefix: str) -> None:
    node = GapNode(Plan(prefix, "/sim", NOMINAL), context=bench.context)
    assert node.comparison.rig.topic == "/rig/samples"
    assert "/rig: simulator" in node._streams
    node.destroy_node()


@pytest.mark.parametrize("reliability", ["RELIABLE", "BEST_EFFORT"])
def test_the_channels_of_a_rig_are_heard_by_whatever_service(
    bench: Bench, listener: GapNode, reliability: str
) -> None:
    """A rig that is no simulator seldom keeps its last message for those who come late."""
    qos = QoSProfile(depth=5, reliability=ReliabilityPolicy[reliability])
    out = bench.client.create_publisher(String, "/rig/herringbone_sim/channels", qos)
    said = String(data=json.dumps({"parameters": {"delta_T": 33.0}}))

    def heard() -> bool:
        out.publish(said)
        return listener.comparison.rig.parameters == {"delta_T": 33.0}

    wait_until(heard)
