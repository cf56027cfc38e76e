"""Node of the verb ``gap live``: compares the samples of a rig with those of a simulator."""

from __future__ import annotations

import json
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.errors import ParameterError
from herringbone_sim.gap.stream.comparison import Comparison, ComparisonResult, SampleStream
from herringbone_sim.recording.messages import encode_joint_state
from herringbone_sim.recording.writer import stamp_ns
from herringbone_sim.ros.guarded import GuardedNode, one_line
from herringbone_sim.ros.qos import LATCHED, NEWEST, STREAM
from herringbone_sim.views.mirror.live_text import data

NAME = "gap"
DEPTH = 200  # samples messages queued by a subscription
SAMPLES = "std_msgs/msg/Float64MultiArray"
REST = 2.0  # least pause after a comparison, as a multiple of its duration


@dataclass(frozen=True)
class Plan:
    """Settings of a live comparison.

    Attributes:
        rig, simulator: prefixes of the topics ``samples`` and ``channels``.
        nominal: parameters of the rig by its data sheet.
        noise_share: RMS of the rig's noise over the RMS of each channel; None: from the spectra.
        every_s: least wall time between comparisons [s].
        for_s: wall time after which the comparison ends [s]; infinite by default.
    """

    rig: str
    simulator: str
    nominal: Parameters
    noise_share: float | None = None
    every_s: float = 1.0
    for_s: float = float("inf")


class GapNode(GuardedNode):
    """Node that compares two streams and publishes ``~/residual``, ``~/difference``, ``~/place``.

    Raises:
        ParameterError: a prefix that is no valid ROS name.
    """

    def __init__(self, plan: Plan, **options: Any) -> None:
        super().__init__(NAME, **options)
        prefixes = ["/" + namespace.strip("/") for namespace in (plan.rig, plan.simulator)]
        rig, simulator = (SampleStream(f"{prefix}/samples") for prefix in prefixes)
        self.comparison = Comparison(rig, simulator, plan.nominal, plan.noise_share)
        self._listeners = [_Listener(self, stream) for stream in (rig, simulator)]
        self._streams = {
            f"{stream.topic.removesuffix('/samples')}: simulator": stream
            for stream in (rig, simulator)
        }
        self.create_subscription(DiagnosticArray, "/diagnostics", self._hear, STREAM)
        self._residual = self.create_publisher(JointState, "~/residual", STREAM)
        self._difference = self.create_publisher(JointState, "~/difference", STREAM)
        self._place = self.create_publisher(String, "~/place", STREAM)

    def _hear(self, message: DiagnosticArray) -> None:
        """Callback of ``/diagnostics``: pass messages of rig and simulator to their streams."""
        for status in message.status:
            stream = self._streams.get(status.name)
            if stream:
                stream.set_diagnostics(one_line(status.message))

    def look(self) -> ComparisonResult:
        """Compare the last stretches of both streams, publish the result and return it.

        It takes the new samples out of the streams, and subscribes again where publishers changed
        their reliability. ``~/residual`` is published only while the rig sends blocks,
        ``~/difference`` only while both do.
        """
        for listener in self._listeners:
            listener.follow()
        picture = self.comparison.update()
        self._publish(picture)
        return picture

    def sample_topics(self) -> tuple[str, ...]:
        """Names of all topics that carry samples, whichever node publishes them."""
        topics = self.get_topic_names_and_types()
        return tuple(n for n, kinds in topics if n.endswith("/samples") and SAMPLES in kinds)

    def _publish(self, picture: ComparisonResult) -> None:
        """Publish residual by place, rig minus simulator by mesh, and the whole as JSON."""
        residual = picture.residual
        if residual is not None and picture.rig.fresh:
            message = encode_joint_state(
                stamp_ns(residual.t_s),
                residual.places,
                residual.shares,
                residual.chi,
                residual.rms_by_place,
            )
            self._residual.publish(message)
        a, b = picture.rig_motion, picture.simulator_motion
        both_fresh = picture.rig.fresh and picture.simulator.fresh
        if both_fresh and picture.comparable and a is not None and b is not None:
            apart = a.contact_shares - b.contact_shares
            rows = np.stack([apart[:, 2], apart[:, 0], a.force_rms_n - b.force_rms_n])
            there = np.flatnonzero(np.all(np.isfinite(rows), axis=0))
            names = tuple(a.meshes[j] for j in there)
            stamp = stamp_ns(picture.rig.t_s)
            self._difference.publish(encode_joint_state(stamp, names, *rows[:, there]))
        self._place.publish(String(data=json.dumps(data(picture))))


class _Listener:
    """Subscriptions to samples and channels of one stream; ParameterError for an invalid topic."""

    def __init__(self, node: GapNode, stream: SampleStream) -> None:
        self._node, self._stream = node, stream
        self._reliable = True
        try:
            self._samples = self._subscribe()
            topic = f"{stream.topic.removesuffix('samples')}channels"
            for qos in (LATCHED, NEWEST):  # latched ones, and those of any quality of service
                node.create_subscription(String, topic, lambda m: stream.set_channels(m.data), qos)
        except InvalidTopicNameException as error:
            raise ParameterError(f"{stream.topic} is no name of a topic: {error}") from error

    def follow(self) -> None:
        """Subscribe again if the reliability of the publishers changed.

        A reliable subscription receives nothing from a best-effort publisher.
        """
        known = self._node.get_publishers_info_by_topic(self._stream.topic)
        reliable = all(
            publisher.qos_profile.reliability != ReliabilityPolicy.BEST_EFFORT
            for publisher in known
        )
        if known and reliable != self._reliable:
            self._reliable = reliable
            self._node.destroy_subscription(self._samples)
            self._samples = self._subscribe()

    def _subscribe(self) -> Any:
        """Subscribe to the samples with the reliability of their publishers."""
        kind = ReliabilityPolicy.RELIABLE if self._reliable else ReliabilityPolicy.BEST_EFFORT
        qos = QoSProfile(reliability=kind, history=HistoryPolicy.KEEP_LAST, depth=DEPTH)
        return self._node.create_subscription(
            Float64MultiArray, self._stream.topic, self._stream.add_samples, qos, raw=True
        )


def listen(plan: Plan, show: Callable[[ComparisonResult, tuple[str, ...]], None]) -> int:
    """Compare rig and simulator repeatedly until SIGINT, SIGTERM or ``plan.for_s``; return 0.

    Args:
        plan: what is compared, how often and how long.
        show: called with every comparison and the names of all topics that carry samples.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = GapNode(plan, context=context)
        try:
            _look_on(node, plan, stop, show)
        finally:
            node.destroy_node()
    finally:
        rclpy.try_shutdown(context=context)
    return 0


def _look_on(
    node: GapNode,
    plan: Plan,
    stop: threading.Event,
    show: Callable[[ComparisonResult, tuple[str, ...]], None],
) -> None:
    """Compare repeatedly until ``stop`` or the end of the time, while a thread serves the node."""
    executor = SingleThreadedExecutor(context=node.context)
    over = threading.Event()
    thread = threading.Thread(
        target=node.serve, args=(executor, lambda: not over.is_set()), name="listener", daemon=True
    )
    thread.start()
    end = time.monotonic() + plan.for_s
    pause = plan.every_s
    try:
        while not stop.wait(min(pause, max(end - time.monotonic(), 0.0))):
            began = time.monotonic()
            show(node.look(), node.sample_topics())
            pause = max(plan.every_s, REST * (time.monotonic() - began))
            if time.monotonic() >= end:
                return
    finally:
        over.set()
        thread.join(5.0)
        executor.shutdown(timeout_sec=5.0)
