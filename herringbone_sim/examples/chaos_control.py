"""Example node for a live control experiment, through topics alone.

Subscribes to the simulator's ``regime``, raises K on ``cmd/K`` until the motion is periodic, then
lowers it until it is not, and prints K at both transitions. Parameters: ``simulator``
(name of its node), ``wanted`` (P: any period, P1: period 1, ...), ``step``, ``largest`` (of K),
``dwell`` (seconds at each K).

    ros2 run herringbone_sim chaos_control --ros-args -p step:=0.02
    python -m herringbone_sim.examples.chaos_control --ros-args -p step:=0.02
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Sequence

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64


class ChaosControl(Node):  # type: ignore[misc]
    """Node that raises K until the motion is as ``wanted``, then lowers it until it is not.

    Attributes:
        transitions: K at which ``WANTED from`` and ``lost again at`` happened; WANTED as ``P``.
        done: whether it ended: after the second transition, or where K would leave 0 .. largest.
    """

    def __init__(self) -> None:
        super().__init__("chaos_control")
        simulator = self.declare_parameter("simulator", "/herringbone_sim").value.rstrip("/")
        free = ParameterDescriptor(dynamic_typing=True)  # an integer is as good as a double
        self._target = str(self.declare_parameter("wanted", "P").value)
        self._step = float(self.declare_parameter("step", 0.05, free).value)
        self._largest = float(self.declare_parameter("largest", 1.0, free).value)
        self._dwell = float(self.declare_parameter("dwell", 0.5, free).value)
        self.get_logger().info(f"listening to {simulator}/regime")
        self._K, self._rising, self._since = 0.0, True, time.monotonic()
        self.transitions: dict[str, float] = {}
        self.done = False
        self._command = self.create_publisher(Float64, f"{simulator}/cmd/K", 10)
        self.create_subscription(DiagnosticArray, f"{simulator}/regime", self._listen, 10)

    def _listen(self, message: DiagnosticArray) -> None:
        """Callback of ``regime``: resend K until it arrives, and decide after the dwell time."""
        values = {item.key: item.value for item in message.status[0].values}
        if float(values["K"]) != self._K:
            self._send(self._K)
            return
        seen_long_enough = time.monotonic() - self._since > self._dwell
        if self.done or not seen_long_enough or values["regime"] == "settling":
            return
        self.get_logger().info(
            f"K = {self._K:.3f}: {values['regime']}, exponent {values['largest_exponent']}"
        )
        self._decide(self._is_target(values["regime"]))

    def _is_target(self, regime: str) -> bool:
        """Whether the label of a regime is what the parameter ``wanted`` asks for."""
        return regime.startswith("P") if self._target == "P" else regime == self._target

    def _decide(self, periodic: bool) -> None:
        """Record a transition and step K up or down; done at the second transition or a bound."""
        if self._rising and periodic:
            self.transitions[f"{self._target} from"] = self._K
            self._rising = False
        elif not self._rising and not periodic:
            self.transitions["lost again at"] = self._K
            self.done = True
        next_K = round(self._K + (self._step if self._rising else -self._step), 9)
        if self.done or not 0.0 <= next_K <= self._largest:
            self.done = True
            return
        self._K, self._since = next_K, time.monotonic()
        self._send(next_K)

    def _send(self, K: float) -> None:
        """Publish K."""
        self._command.publish(Float64(data=K))


def main(args: Sequence[str] | None = None) -> int:
    """Run until both transitions are found, K reaches its bounds or a signal; return 0."""
    if "--help" in (sys.argv if args is None else args):
        print(__doc__)
        return 0
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    node = ChaosControl()
    while rclpy.ok() and not node.done and not stop.is_set():
        rclpy.spin_once(node, timeout_sec=0.2)
    print(
        "; ".join(f"{what} K = {K:g}" for what, K in node.transitions.items()) or "no edge found"
    )
    node.destroy_node()
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
