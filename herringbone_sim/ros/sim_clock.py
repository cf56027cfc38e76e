"""Simulation time on ``/clock`` for other nodes, with one publisher per domain."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable

from builtin_interfaces.msg import Time
from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock
from rclpy.node import Node
from rosgraph_msgs.msg import Clock as ClockMessage

from herringbone_sim.recording.writer import stamp_ns
from herringbone_sim.ros.qos import STREAM, open_publisher

PERIOD_S = 0.01
DISCOVERY_S = 0.5  # wait for the discovery of other publishers
LATE_S = 10.0  # time after the start in which this node gives way to a publisher discovered late
PATIENCE_S = 2.0  # longest wait for the other node to give way; random, so that not both do


class SimClock:
    """Publishes ``/clock`` 100 times a second, unless another node does.

    Args:
        node: owner of publisher and timer.
        steady, group: clock and callback group of the timer.
        t_s: returns the simulation time [s].
    """

    def __init__(
        self, node: Node, steady: Clock, group: CallbackGroup, t_s: Callable[[], float]
    ) -> None:
        self._node, self._t_s = node, t_s
        self._publisher = None
        time.sleep(DISCOVERY_S)
        if node.count_publishers("/clock"):
            self._give_way()
            return
        self._publisher = open_publisher(node, ClockMessage, "/clock", STREAM)
        self._settled = time.monotonic() + LATE_S
        self._give_way_at: float | None = None
        self._lock = threading.Lock()
        self._timer = node.create_timer(PERIOD_S, self.tick, group, clock=steady)

    def tick(self) -> None:
        """Publish the current simulation time, unless another node does."""
        if self._publisher is None:
            return
        with self._lock:
            if self._publisher is not None and self._second_publisher_stays():
                self._timer.cancel()
                self._node.destroy_publisher(self._publisher)
                self._publisher = None
                self._give_way()
            if self._publisher is not None:
                self._publisher.publish(clock_message(self._t_s()))

    def _second_publisher_stays(self) -> bool:
        """Whether this node must give way to another publisher that was discovered late.

        The call that first finds one within ``LATE_S`` after the start draws a wait of up to
        ``PATIENCE_S``. True at a call after that wait that still finds it; a call that does not
        find it ends the wait. False from ``LATE_S`` + ``PATIENCE_S`` after the start on.
        """
        now = time.monotonic()
        if now > self._settled + PATIENCE_S:
            return False
        if self._node.count_publishers("/clock") < 2:
            self._give_way_at = None
        elif self._give_way_at is not None:
            return now > self._give_way_at
        elif now < self._settled:
            self._give_way_at = now + random.uniform(0.0, PATIENCE_S)
        return False

    def _give_way(self) -> None:
        """Log an error that this node publishes no clock, as another one does."""
        self._node.get_logger().error(
            "another node publishes /clock: this one does not; stop the other or leave "
            "publish_clock false"
        )


def clock_message(t_s: float) -> ClockMessage:
    """A time [s] as a message on ``/clock``."""
    sec, nanosec = divmod(stamp_ns(t_s), 10**9)
    return ClockMessage(clock=Time(sec=sec, nanosec=nanosec))
