"""Publishers and subscriptions whose quality of service can be overridden by parameters.

The parameters are those of every ROS 2 node, such as
``qos_overrides./herringbone_sim/state.publisher.reliability``.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rclpy.exceptions import ParameterException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    InvalidQoSProfileException,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.qos_overriding_options import QoSOverridingOptions

from herringbone_sim.errors import ParameterError

STREAM = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST, depth=10
)
LATCHED = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE,
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
NEWEST = QoSProfile(  # hears publishers of any quality of service
    reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST, depth=1
)
REFUSALS = (  # raised by rclpy for a policy with an unknown name or value
    *(ParameterException, InvalidQoSProfileException, RuntimeError, ValueError, AssertionError),
    rclpy_implementation.RCLError,
)


def open_publisher(node: Node, kind: Any, topic: str, qos: QoSProfile) -> Any:
    """Create a publisher with overridable history, depth and reliability.

    Raises:
        ParameterError: an invalid override.
    """
    with _refusing(node, topic):
        return node.create_publisher(kind, topic, copy.copy(qos), qos_overriding_options=_open())


def open_subscription(
    node: Node, kind: Any, topic: str, take: Callable[[Any], None], qos: QoSProfile
) -> Any:
    """Create a subscription, callback ``take``, with overridable history, depth and reliability.

    Raises:
        ParameterError: an invalid override.
    """
    with _refusing(node, topic):
        return node.create_subscription(
            kind, topic, take, copy.copy(qos), qos_overriding_options=_open()
        )


def _open() -> QoSOverridingOptions:
    return QoSOverridingOptions.with_default_policies()


@contextmanager
def _refusing(node: Node, topic: str) -> Iterator[None]:
    """Context that turns rclpy's errors on an invalid policy into ParameterError."""
    try:
        yield
    except REFUSALS as error:
        raise ParameterError(
            f"qos_overrides.{node.resolve_topic_name(topic)}: {error}: history is keep_last or "
            "keep_all, depth a whole number, reliability reliable or best_effort"
        ) from error
