"""Send a recording over the topics of the node, at a chosen speed."""

from __future__ import annotations

import json
import time

import numpy as np
import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import InvalidNamespaceException, InvalidNodeNameException
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.messages import JointState as StateSample
from herringbone_sim.recording.messages import encode_joint_state, encode_samples
from herringbone_sim.recording.reader import Recording
from herringbone_sim.recording.writer import split_rows, stamp_ns
from herringbone_sim.ros.streams import LATCHED, STREAM

TURN_S = 0.02
DISCOVERY_S = 2.0
ON_SECTION = 1e-6


def publish(recording: Recording, speed: float, node_name: str = "herringbone_sim") -> int:
    """Publish ``~/channels``, ``~/samples``, ``~/section`` and ``~/state`` of a run.

    ``~/state`` is taken at phase 0, so it is a section and never an alias. Returns samples sent.

    Args:
        speed: recorded over wall time; 1 is the machine's own time.
        node_name: whose topics; two nodes of one name confuse subscribers.
    """
    if not (np.isfinite(speed) and speed > 0.0):
        raise ParameterError(f"speed must be finite and positive, got {speed!r}: 1 is real time")
    rclpy.init()
    try:
        node = Node(node_name)
    except (InvalidNodeNameException, InvalidNamespaceException) as error:
        rclpy.try_shutdown()
        raise ParameterError(f"node name {node_name!r} is not one ROS takes: {error}") from error
    try:
        return _send(node, recording, speed)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _send(node: Node, recording: Recording, speed: float) -> int:
    channels = node.create_publisher(String, "~/channels", LATCHED)
    samples = node.create_publisher(Float64MultiArray, "~/samples", STREAM)
    section = node.create_publisher(Float64MultiArray, "~/section", STREAM)
    state = node.create_publisher(JointState, "~/state", STREAM)
    channels.publish(String(data=json.dumps(recording.channels)))
    series = recording.samples
    meshes = tuple(name[2:] for name in series.names if name.startswith("x_"))
    whole = bool(meshes) and all(f"{a}_{m}" in series for a in "vF" for m in meshes)
    of_section = tuple(n for n in series.names if n in ("t", "phase") or n[:2] in ("x_", "v_"))
    turns = series["phase"] / TWO_PI if "phase" in series else np.full(len(series), 0.5)
    on_section = np.abs(turns - np.round(turns)) < ON_SECTION
    _wait_for_listeners(node)
    began, first, at = time.monotonic(), series.times[0], 0
    while at < len(series) and rclpy.ok():
        due = first + (time.monotonic() - began) * speed
        end = max(int(np.searchsorted(series.times, due, side="right")), at)
        for rows in split_rows(end - at, len(series.names), len(",".join(series.names))):
            block = series.data[at + rows.start : at + rows.stop]
            samples.publish(encode_samples(series.names, block))
        points = at + np.flatnonzero(on_section[at:end])
        if len(points):
            section.publish(encode_samples(of_section, series.columns(of_section)[points]))
        if len(points) and whole:
            row = {name: series[name][points[-1]] for name in series.names}
            x, v, force = (np.array([row[f"{a}_{m}"] for m in meshes]) for a in "xvF")
            stamp = stamp_ns(float(series.times[points[-1]]))
            state.publish(encode_joint_state(StateSample(stamp, meshes, x, v, force)))
        at = end
        rclpy.spin_once(node, timeout_sec=TURN_S)
    samples.wait_for_all_acked(Duration(seconds=DISCOVERY_S))
    return at


def _wait_for_listeners(node: Node) -> None:
    """Give subscribers time to find the topics; go on without them after that."""
    limit = time.monotonic() + DISCOVERY_S
    while time.monotonic() < limit and not node.count_subscribers(f"{node.get_name()}/samples"):
        rclpy.spin_once(node, timeout_sec=TURN_S)
    rclpy.spin_once(node, timeout_sec=0.2)
