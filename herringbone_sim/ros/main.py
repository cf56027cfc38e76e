"""Run the simulator node as a process, as ``ros2 run herringbone_sim simulator`` does."""

from __future__ import annotations

import signal
import sys
import threading
import warnings
from collections.abc import Sequence

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import MultiThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions

from herringbone_sim.core.parameters import ParameterWarning
from herringbone_sim.errors import HerringboneError
from herringbone_sim.ros.guarded import one_line
from herringbone_sim.ros.node import THREADS, SimulatorNode

OF_ROS = (rclpy_implementation.RCLError, rclpy_implementation.UnknownROSArgsError)
ANSWERS_S = 2.0  # longest wait for running services to answer at the end


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; return 0, or 2 for invalid arguments or parameters.

    Signals are handled here, because ROS must stay up until the node has ended its recording.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    node = None
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        # Warnings about an implausible gear are given where its parameter file is made.
        warnings.simplefilter("ignore", ParameterWarning)
        node = SimulatorNode()
        node.get_logger().info(f"running the {node.get_parameter('model').value} model")
        spin(node, stop)
    except (HerringboneError, ParameterException, *OF_ROS) as error:
        print(f"herringbone_sim: {one_line(str(error))}", file=sys.stderr)
        return 2
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def spin(node: SimulatorNode, stop: threading.Event) -> None:
    """Run the node's callbacks until ``stop`` is set, then close its loop and await services."""
    executor = MultiThreadedExecutor(num_threads=THREADS, context=node.context)
    node.serve(executor, lambda: not stop.is_set())
    node.loop.close()
    # ``shutdown`` of the executors of ROS Jazzy should wait for running callbacks but does not.
    executor._work_tracker.wait(ANSWERS_S)
    executor.shutdown(timeout_sec=ANSWERS_S)


if __name__ == "__main__":
    sys.exit(main())
