"""Publish a recording on the topics of the node at a chosen speed, like ``ros2 bag play``."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import InvalidNamespaceException, InvalidNodeNameException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from tqdm import tqdm

from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.errors import ParameterError, shown
from herringbone_sim.recording.messages import encode_joint_state, encode_samples
from herringbone_sim.recording.reader import Recording
from herringbone_sim.recording.writer import split_rows, stamp_ns
from herringbone_sim.ros.qos import LATCHED, STREAM
from herringbone_sim.ros.sim_clock import clock_message

TURN_S = 0.02  # wall time of a sending step
DISCOVERY_S = 2.0  # longest wait for other nodes: subscribers, publishers, acknowledgements
MOST_CLOCK_HZ = 1000.0
ON_SECTION = 1e-6  # largest distance from phase 0, as a fraction of the mesh cycle


@dataclass(frozen=True)
class Playing:
    """How a recording is published.

    Attributes:
        speed: recorded time over wall time.
        start_s: time skipped at the beginning of the recording [s].
        loop: whether the rest is repeated until a signal.
        clock_hz: rate of ``/clock`` with the time of the recording [1/s]; 0 for none.

    Raises:
        ParameterError: a number out of range.
    """

    speed: float = 1.0
    start_s: float = 0.0
    loop: bool = False
    clock_hz: float = 0.0

    def __post_init__(self) -> None:
        for name, value, fits, rule, hint in (
            ("speed", self.speed, self.speed > 0.0, "positive", "1 is real time"),
            ("start", self.start_s, self.start_s >= 0.0, "0 or more", "0 leaves out nothing"),
            (
                "clock",
                self.clock_hz,
                0.0 <= self.clock_hz <= MOST_CLOCK_HZ,
                f"at most {MOST_CLOCK_HZ:g} Hz",
                "40 is usual",
            ),
        ):
            if not (isfinite(value) and fits):
                raise ParameterError(f"{name} must be finite and {rule}, got {value}: {hint}")


@dataclass
class Stop:
    """Number of the signal that asked to stop publishing; 0 until there is one."""

    number: int = 0


@dataclass(frozen=True)
class Sent:
    """Result of publishing: samples sent, those of all rounds begun, signal that ended it or 0."""

    samples: int
    of: int
    signal: int


def publish(recording: Recording, playing: Playing, node_name: str = "herringbone_sim") -> Sent:
    """Publish the samples of a recording, paced by ``playing``, until its end or a signal.

    ``~/channels`` is sent once, ``~/samples`` has all rows, ``~/section`` the rows at phase 0 and
    ``~/state`` the last of these in each sending step (20 ms of wall time or less): a live plot
    then shows section points and no aliasing. ``~/section`` needs the channel ``phase``,
    ``~/state`` also x, v and F of every mesh. SIGINT and SIGTERM end it; call it in the main
    thread.

    Args:
        recording: the recorded run.
        playing: speed, start, repetition and rate of ``/clock``.
        node_name: name of the node whose topics are used; two nodes of one name confuse
            subscribers.

    Returns:
        Number of samples sent, number in all rounds begun, and the signal that ended it.

    Raises:
        ParameterError: an invalid name, a start after the end, or another publisher of ``/clock``,
            also one that is discovered while the run is sent.
    """
    series = recording.samples
    length_s = float(series.times[-1] - series.times[0])
    if playing.start_s > length_s:
        raise ParameterError(
            f"start must lie in the recording of {length_s:g} s, got {playing.start_s:g}"
        )
    with stop_on_signals() as stop:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        try:
            node = _node(node_name)
            try:
                return _Player(node, recording, playing, stop).play()
            finally:
                node.destroy_node()
        finally:
            rclpy.try_shutdown()


@contextmanager
def stop_on_signals() -> Iterator[Stop]:
    """Context in which SIGINT and SIGTERM only set the number of the ``Stop`` that it yields."""
    stop = Stop()

    def take(number: int, _: object) -> None:
        stop.number = number

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, take) for number in numbers]
    try:
        yield stop
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def _node(name: str) -> Node:
    """Create a node; ParameterError for an invalid name."""
    try:
        return Node(name)
    except (InvalidNodeNameException, InvalidNamespaceException) as error:
        raise ParameterError(
            f"node name {shown(name)} is not one ROS takes: {str(error).splitlines()[0]}"
        ) from error


@dataclass
class _Player:
    """Publishers of a recording and the progress of sending it."""

    node: Node
    recording: Recording
    playing: Playing
    stop: Stop
    sent: int = 0
    clock_due_s: float = 0.0
    clock: Any = None

    def __post_init__(self) -> None:
        """Create the publishers, find the section points and the first row to send."""
        node, series = self.node, self.recording.samples
        self.channels = node.create_publisher(String, "~/channels", LATCHED)
        self.samples = node.create_publisher(Float64MultiArray, "~/samples", STREAM)
        self.section = node.create_publisher(Float64MultiArray, "~/section", STREAM)
        self.state = node.create_publisher(JointState, "~/state", STREAM)
        self.meshes = tuple(name[2:] for name in series.names if name.startswith("x_"))
        self.whole = bool(self.meshes) and all(
            f"{a}_{m}" in series for a in "vF" for m in self.meshes
        )
        self.of_section = tuple(
            n for n in series.names if n in ("t", "phase") or n[:2] in ("x_", "v_")
        )
        turns = series["phase"] / TWO_PI if "phase" in series else np.full(len(series), 0.5)
        self.on_section = np.abs(turns - np.round(turns)) < ON_SECTION
        first_s = float(series.times[0]) + self.playing.start_s
        self.first = int(np.searchsorted(series.times, first_s - 1e-9))

    def play(self) -> Sent:
        """Send the recording, with ``playing.loop`` until a signal, and return what was sent."""
        if self.playing.clock_hz:
            self._open_clock()
        self.channels.publish(String(data=json.dumps(self.recording.channels.content)))
        topic, count = self.samples.topic_name, len(self.recording.samples) - self.first
        duration_s = float(np.ptp(self.recording.samples.times[self.first :]))
        rounds = ", again and again" if self.playing.loop else ""
        print(
            f"{self.recording.name}: sending {duration_s:.4g} s on {topic}, in "
            f"{duration_s / self.playing.speed:.4g} s{rounds}",
            flush=True,
        )
        self._wait_for_listeners()
        all_of_it = 0
        with tqdm(total=count, unit="sample", unit_scale=True, disable=None) as bar:
            while not all_of_it or (self.playing.loop and not self.stop.number):
                all_of_it += count
                bar.reset()
                self._round(bar)
        if not self.stop.number:
            self.samples.wait_for_all_acked(Duration(seconds=DISCOVERY_S))
        return Sent(self.sent, all_of_it, self.stop.number)

    def _open_clock(self) -> None:
        """Create a publisher of ``/clock`` after 2 s; ParameterError if another one is found."""
        limit = time.monotonic() + DISCOVERY_S
        while time.monotonic() < limit and not self.stop.number:
            time.sleep(TURN_S)
            self._refuse_clocks(0)
        self.clock = self.node.create_publisher(Clock, "/clock", 10)

    def _refuse_clocks(self, own: int) -> None:
        """Raise ParameterError if ``/clock`` has more publishers than ``own``."""
        if self.node.count_publishers("/clock") > own:
            raise ParameterError(
                "another node publishes /clock: two of them make time jump; stop that one, or "
                "leave --clock out"
            )

    def _round(self, bar: tqdm) -> None:
        """Send the recording once, paced by wall time."""
        times = self.recording.samples.times
        turn_s = min(TURN_S, 1.0 / self.playing.clock_hz) if self.playing.clock_hz else TURN_S
        began, at = time.monotonic(), self.first
        while at < len(times) and not self.stop.number:
            due = times[self.first] + (time.monotonic() - began) * self.playing.speed
            end = max(int(np.searchsorted(times, due, side="right")), at)
            self._tick(float(min(due, times[-1])))
            self._send(at, end)
            bar.update(end - at)
            at = end
            rclpy.spin_once(self.node, timeout_sec=turn_s)

    def _tick(self, t_s: float) -> None:
        """Publish t_s on ``/clock`` if due; ParameterError if another node publishes it too."""
        now = time.monotonic()
        if self.clock is not None and now >= self.clock_due_s:
            self._refuse_clocks(1)
            self.clock_due_s = now + 1.0 / self.playing.clock_hz
            self.clock.publish(clock_message(t_s))

    def _send(self, at: int, end: int) -> None:
        """Publish the rows from ``at`` to before ``end``, and the section points among them."""
        series = self.recording.samples
        for rows in split_rows(end - at, series.names):
            if self.stop.number:
                return
            block = series.data[at + rows.start : at + rows.stop]
            self.samples.publish(encode_samples(series.names, block))
            self.sent += len(block)
        points = at + np.flatnonzero(self.on_section[at:end])
        if len(points):
            self._send_section(points)

    def _send_section(self, points: np.ndarray[tuple[int], np.dtype[np.int64]]) -> None:
        """Publish section points, and the state at the last of them."""
        series = self.recording.samples
        self.section.publish(
            encode_samples(self.of_section, series.columns(self.of_section)[points])
        )
        if self.whole:
            row = {name: series[name][points[-1]] for name in series.names}
            x, v, force = (np.array([row[f"{a}_{m}"] for m in self.meshes]) for a in "xvF")
            stamp = stamp_ns(float(series.times[points[-1]]))
            self.state.publish(encode_joint_state(stamp, self.meshes, x, v, force))

    def _wait_for_listeners(self) -> None:
        """Wait up to 2 s for a subscriber of the samples."""
        limit = time.monotonic() + DISCOVERY_S
        topic = self.samples.topic_name
        while time.monotonic() < limit and not (
            self.node.count_subscribers(topic) or self.stop.number
        ):
            rclpy.spin_once(self.node, timeout_sec=TURN_S)
        rclpy.spin_once(self.node, timeout_sec=0.2)
