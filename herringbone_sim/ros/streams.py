"""Publish samples, decimated state, section and regime of a running simulation in a thread."""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from queue import Empty, Full, Queue
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

from herringbone_sim.analysis.monitor import Regime, RegimeMonitor
from herringbone_sim.core.integrate import State
from herringbone_sim.core.model import Model
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.sensors import Clock
from herringbone_sim.effects.written import effects_text
from herringbone_sim.recording.messages import encode_joint_state, encode_samples
from herringbone_sim.recording.writer import split_rows, stamp_ns
from herringbone_sim.ros.qos import LATCHED, STREAM, open_publisher
from herringbone_sim.ros.session import channels_content, content_of
from herringbone_sim.ros.status import status_of
from herringbone_sim.runtime import Change, Delivery, sample_period_s

QUEUE_BLOCKS = 32
REGIME_S = 0.1  # wall time between messages on the regime
ENOUGH_PER_CYCLE = 8  # evenly spaced samples of a mesh cycle that show its motion


class Decimator:
    """Selects the samples of ``~/state``, on average at most ``publish_rate`` of them a second.

    If the rate allows all samples, or at least ``ENOUGH_PER_CYCLE`` a mesh cycle, they are evenly
    spaced. Else it is the sample at phase 0 of every m-th mesh cycle, with the smallest m that
    keeps the rate and is coprime to 2, 3, 5 and 7. A motion whose period in mesh cycles has no
    other prime factors then shows all its section points: a live plot is a section, not an alias.

    Args:
        publish_rate: largest rate of ``~/state`` [Hz of wall time].

    Attributes:
        speed: simulation time over wall time.
    """

    def __init__(self, publish_rate: float) -> None:
        self.publish_rate = publish_rate
        self.speed = 1.0

    def __call__(self, delivery: Delivery) -> list[int]:
        """Indices of the rows of a block that go to ``~/state`` and its recording, ascending."""
        block, p = delivery.block, delivery.model.parameters
        rate = self.speed / sample_period_s(delivery.model)
        per_cycle = p.samples_per_cycle
        apart = max(rate / self.publish_rate, 1.0)
        every = next(
            (d for d in range(math.ceil(apart - 1e-9), per_cycle + 1) if per_cycle % d == 0),
            per_cycle,
        )
        if per_cycle // every < min(ENOUGH_PER_CYCLE, per_cycle) or apart > per_cycle:
            every = coprime(apart / per_cycle) * per_cycle
        first = block.start.cycle * per_cycle + block.start.index // (p.steps // per_cycle)
        return [i for i in range(len(block.rows)) if (first + i) % every == 0]


def coprime(least: float) -> int:
    """Smallest positive integer not below ``least`` that is coprime to 2, 3, 5 and 7."""
    m = max(math.ceil(least), 1)
    while math.gcd(m, 210) != 1:
        m += 1
    return m


class Streams:
    """Publishes deliveries of the loop in a thread; drops and counts them if it is too slow.

    Args:
        node: owner of the publishers.
        decimate: selects the rows of ``~/state``.
        onward: called in the publishing thread with the deliveries since the last call and the
            regime, about every ``REGIME_S`` seconds of wall time (for the mirror).

    Attributes:
        dropped: number of deliveries that were not published.
        regime: latest regime of the motion; None before the first delivery.
    """

    def __init__(
        self,
        node: Node,
        decimate: Decimator,
        onward: Callable[[list[Delivery], Regime], None],
    ) -> None:
        self.dropped = 0
        self._counting = threading.Lock()
        self.regime: Regime | None = None
        self._decimate = decimate
        self._onward = onward
        self._node = node
        self._samples = open_publisher(node, Float64MultiArray, "~/samples", STREAM)
        self._state = open_publisher(node, JointState, "~/state", STREAM)
        self._section = open_publisher(node, Float64MultiArray, "~/section", STREAM)
        self._channels = open_publisher(node, String, "~/channels", LATCHED)
        self._regime = open_publisher(node, DiagnosticArray, "~/regime", STREAM)
        self._monitor = RegimeMonitor()
        self._last_regime_s = 0.0
        self._batch: list[Delivery] = []
        self._missed: Delivery | None = None
        self._queue: Queue[Delivery | None] = Queue(QUEUE_BLOCKS)
        self._thread = threading.Thread(target=self._run, name="streams", daemon=True)

    def start(self, model: Model, state: State, actives: Sequence[Active], clock: Clock) -> None:
        """Publish ``~/channels``, as compiling may delay the first samples, and start the thread.

        The arguments describe the first sample.
        """
        self._publish_channels(channels_content(model, state, actives, clock), ())
        self._thread.start()

    def close(self) -> None:
        """Publish the queued deliveries and end the thread; waits up to 10 s for it."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join(10.0)

    def put(self, delivery: Delivery) -> None:
        """Queue a delivery, or drop and count it if the queue is full.

        The next delivery then also carries the changes of the dropped one, and restarts the regime
        monitor.
        """
        missed, self._missed = self._missed, None
        if missed:
            changes = (*missed.changes, *delivery.changes)
            delivery = replace(delivery, changes=changes, restarted=True)
        try:
            self._queue.put_nowait(delivery)
        except Full:
            self._drop()
            self._missed = delivery

    def _drop(self) -> None:
        with self._counting:
            self.dropped += 1

    def _publish_channels(self, content: dict[str, Any], changes: Sequence[Change]) -> None:
        """Publish the content of ``~/channels`` with the latest parameter changes."""
        content["changes"] = [{"t": c.t_s, "values": dict(c.values)} for c in changes]
        self._channels.publish(String(data=json.dumps(content)))

    def _run(self) -> None:
        """Thread: publish deliveries until ``close``; what fails is logged, the rest goes on."""
        while True:
            try:
                delivery = self._queue.get(timeout=REGIME_S)
            except Empty:
                self._try_regime()
                continue
            if delivery is None or not self._node.context.ok():
                return
            try:
                self._publish(delivery)
                self._batch.append(delivery)
            except Exception as error:
                self._drop()
                self._node.get_logger().error(f"a block was not published: {error!r}")
            if time.monotonic() - self._last_regime_s >= REGIME_S:
                self._try_regime()

    def _publish(self, delivery: Delivery) -> None:
        """Publish one delivery: samples, section, state, and ``~/channels`` after a change."""
        block, names = delivery.block, delivery.model.layout.channels
        if delivery.changes or delivery.restarted or self.regime is None:
            self._publish_channels(content_of(delivery), delivery.changes)
            self._monitor.restart()
        self._monitor.update(block, delivery.model)
        self.regime = self._monitor.regime(delivery.model) if self.regime is None else self.regime
        for rows in split_rows(len(block.rows), names):
            self._samples.publish(encode_samples(names, block.rows[rows]))
        self._publish_section(delivery)
        for i in self._decimate(delivery):
            self._publish_state(delivery.model, block.rows[i])

    def _publish_section(self, delivery: Delivery) -> None:
        """Publish t, phase, x and v of the samples at phase 0."""
        n = delivery.model.layout.n_mesh
        names = delivery.model.layout.channels
        keep = [0, 1, *range(5, 5 + 2 * n)]
        points = delivery.block.rows[np.ix_(delivery.block.section, keep)]
        wanted = tuple(names[i] for i in keep)
        for rows in split_rows(len(points), wanted):
            self._section.publish(encode_samples(wanted, points[rows]))

    def _publish_state(
        self, model: Model, row: np.ndarray[tuple[int], np.dtype[np.float64]]
    ) -> None:
        """Publish displacement, velocity and force of all meshes of one sample."""
        n = model.layout.n_mesh
        x, v, force = row[5 : 5 + n], row[5 + n : 5 + 2 * n], row[5 + 2 * n : 5 + 3 * n]
        stamp = stamp_ns(float(row[0]))
        self._state.publish(encode_joint_state(stamp, model.layout.meshes, x, v, force))

    def _try_regime(self) -> None:
        """Publish the regime of the deliveries since the last call, if any.

        A failure is logged, and ``onward`` does not get these deliveries.
        """
        batch, self._batch = self._batch, []
        if not batch:
            return
        self._last_regime_s = time.monotonic()
        try:
            self._publish_regime(batch)
        except Exception as error:
            self._node.get_logger().error(f"a regime was not published: {error!r}")

    def _publish_regime(self, batch: list[Delivery]) -> None:
        """Publish the regime at the end of deliveries, and pass them with it to ``onward``."""
        model = batch[-1].model
        self.regime = self._monitor.regime(model)
        name = self._node.get_fully_qualified_name()
        message = DiagnosticArray(status=[regime_status(name, self.regime, model, batch[-1])])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._regime.publish(message)
        self._onward(batch, self.regime)


def regime_status(
    node_name: str, regime: Regime, model: Model, delivery: Delivery
) -> DiagnosticStatus:
    """The regime as a diagnostic status, its label as message and its numbers as values."""
    p = model.parameters
    values = {
        "regime": regime.label,
        "largest_exponent": f"{regime.exponent:.6g}",
        "cycles_since_change": str(regime.cycles),
        "t": f"{delivery.block.end.t:.9g}",
        "K": repr(p.K),
        "delta_T": repr(p.delta_T),
        "xi": repr(p.xi),
        "model": p.model,
        "effects": effects_text(delivery.actives),
    }
    for mesh, (back, apart, drive) in zip(model.layout.meshes, regime.contact, strict=False):
        values[f"contact_{mesh}"] = f"{drive:.4f}"
        values[f"separated_{mesh}"] = f"{apart:.4f}"
        values[f"back_contact_{mesh}"] = f"{back:.4f}"
    return status_of(node_name, "regime", DiagnosticStatus.OK, regime.label, values)
