"""``ros2 run herringbone_sim simulator``: the node in a process of its own."""

from __future__ import annotations

import signal
import sys
import threading
import warnings
from collections.abc import Sequence

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions

from herringbone_sim.core.parameters import ParameterWarning
from herringbone_sim.errors import HerringboneError
from herringbone_sim.ros.node import SimulatorNode

OF_ROS = (rclpy_implementation.RCLError, rclpy_implementation.UnknownROSArgsError)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; 2 when its parameters can't be.

    ROS stays up until the node has ended its recording, so the signals are handled here.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    node = None
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        node = make_node()
        node.get_logger().info(f"running the {node.get_parameter('model').value} model")
        executor = MultiThreadedExecutor(num_threads=2)
        executor.add_node(node)
        while not stop.is_set() and rclpy.ok():
            executor.spin_once(timeout_sec=0.2)
    except ExternalShutdownException:
        pass
    except (HerringboneError, ParameterException, *OF_ROS) as error:
        print(f"herringbone_sim: {error}", file=sys.stderr)
        return 2
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def make_node() -> SimulatorNode:
    """The node, with warnings about the gear in its log."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ParameterWarning)
        node = SimulatorNode()
    for text in sorted({str(w.message) for w in caught}):
        node.get_logger().warning(text)
    warnings.simplefilter("ignore", ParameterWarning)
    return node


if __name__ == "__main__":
    sys.exit(main())
