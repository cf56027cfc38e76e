"""Send a recording over the topics of the node, at a chosen speed."""

from __future__ import annotations

import json
import time

import numpy as np
import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

from herringbone_sim.recording.messages import JointState as StateSample
from herringbone_sim.recording.messages import encode_joint_state, encode_samples
from herringbone_sim.recording.reader import Recording
from herringbone_sim.recording.writer import split_rows, stamp_ns
from herringbone_sim.ros.streams import LATCHED, STREAM

TURN_S = 0.02
DISCOVERY_S = 2.0


def publish(recording: Recording, speed: float, node_name: str = "herringbone_sim") -> int:
    """Publish ``~/channels``, ``~/samples`` and ``~/state`` of a run; returns samples sent.

    Args:
        speed: recorded over wall time; 1 is the machine's own time.
        node_name: whose topics; two nodes of one name confuse subscribers.
    """
    rclpy.init()
    node = Node(node_name)
    try:
        return _send(node, recording, speed)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _send(node: Node, recording: Recording, speed: float) -> int:
    channels = node.create_publisher(String, "~/channels", LATCHED)
    samples = node.create_publisher(Float64MultiArray, "~/samples", STREAM)
    state = node.create_publisher(JointState, "~/state", STREAM)
    channels.publish(String(data=json.dumps(recording.channels)))
    series = recording.samples
    meshes = tuple(name[2:] for name in series.names if name.startswith("x_"))
    whole = all(f"{a}_{m}" in series for a in "vF" for m in meshes)
    _wait_for_listeners(node)
    began, first, at = time.monotonic(), series.times[0], 0
    while at < len(series) and rclpy.ok():
        due = first + (time.monotonic() - began) * speed
        end = max(int(np.searchsorted(series.times, due, side="right")), at)
        for rows in split_rows(end - at, len(series.names), len(",".join(series.names))):
            block = series.data[at + rows.start : at + rows.stop]
            samples.publish(encode_samples(series.names, block))
        if end > at and whole and meshes:
            row = {name: series[name][end - 1] for name in series.names}
            x, v, force = (np.array([row[f"{a}_{m}"] for m in meshes]) for a in "xvF")
            stamp = stamp_ns(float(series.times[end - 1]))
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
