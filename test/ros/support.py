"""A bench for node tests: its own ROS domain, a client node, an executor thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.context import Context
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from herringbone_sim.ros.node import THREADS, SimulatorNode

LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


class Bench:
    """One ROS domain with a client; simulators are added to it."""

    def __init__(self, domain: int) -> None:
        self.domain = domain
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.client = Node("bench", context=self.context)
        self.executor = MultiThreadedExecutor(THREADS + 1, context=self.context)
        self.executor.add_node(self.client)
        self.simulators: list[SimulatorNode] = []
        self._thread = threading.Thread(target=self.executor.spin, daemon=True)
        self._thread.start()

    def simulator(
        self, namespace: str = "", cli_args: list[str] | None = None, **values: Any
    ) -> SimulatorNode:
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        node = SimulatorNode(
            context=self.context,
            namespace=namespace,
            cli_args=cli_args,
            parameter_overrides=overrides,
        )
        self.executor.add_node(node)
        self.simulators.append(node)
        return node

    def close(self) -> None:
        for node in self.simulators:
            node.destroy_node()
        self.executor.shutdown(timeout_sec=5.0)
        self.client.destroy_node()
        rclpy.shutdown(context=self.context)

    def request(self, kind: Any, name: str, request: Any, timeout: float = 20.0) -> Any:
        caller = self.client.create_client(kind, name)
        assert caller.wait_for_service(timeout), f"no service {name}"
        future = caller.call_async(request)
        wait_until(future.done, timeout)
        self.client.destroy_client(caller)
        return future.result()

    def begin(self, name: str, node: str = "/herringbone_sim") -> Any:
        """Future of the answer of a service that takes its time."""
        caller = self.client.create_client(Trigger, f"{node}/{name}")
        assert caller.wait_for_service(20.0), f"no service {name}"
        return caller.call_async(Trigger.Request())

    def call(self, name: str, node: str = "/herringbone_sim") -> Trigger.Response:
        return self.request(Trigger, f"{node}/{name}", Trigger.Request())

    def set(self, node: str = "/herringbone_sim", **values: Any) -> list[Any]:
        """As ``ros2 param set``: each parameter on its own; the results in order."""
        messages = [Parameter(k, value=v).to_parameter_msg() for k, v in values.items()]
        request = SetParameters.Request(parameters=messages)
        return list(self.request(SetParameters, f"{node}/set_parameters", request).results)

    def set_messages(self, *messages: Any, node: str = "/herringbone_sim") -> list[Any]:
        """Parameter messages as they are; the results in order."""
        request = SetParameters.Request(parameters=messages)
        return list(self.request(SetParameters, f"{node}/set_parameters", request).results)

    def set_whole(self, node: str = "/herringbone_sim", **values: Any) -> Any:
        messages = [Parameter(k, value=v).to_parameter_msg() for k, v in values.items()]
        request = SetParametersAtomically.Request(parameters=messages)
        name = f"{node}/set_parameters_atomically"
        return self.request(SetParametersAtomically, name, request).result

    def dump(self, node: str = "/herringbone_sim") -> dict[str, Any]:
        """What ``ros2 param dump`` writes as YAML: names with dots are nested."""
        asked = ListParameters.Request(depth=ListParameters.Request.DEPTH_RECURSIVE)
        names = self.request(ListParameters, f"{node}/list_parameters", asked).result.names
        request = GetParameters.Request(names=sorted(names))
        found = self.request(GetParameters, f"{node}/get_parameters", request).values
        content: dict[str, Any] = {}
        for name, value in zip(sorted(names), found, strict=True):
            *folders, last = name.split(".")
            inner = content
            for folder in folders:
                inner = inner.setdefault(folder, {})
            inner[last] = parameter_value_to_python(value)
        return {node: {"ros__parameters": content}}

    def describe(self, *names: str) -> list[Any]:
        request = DescribeParameters.Request(names=list(names))
        name = "/herringbone_sim/describe_parameters"
        return list(self.request(DescribeParameters, name, request).descriptors)

    def listen(self, kind: Any, topic: str, qos: Any = 100) -> list[Any]:
        """A list that fills with the messages of a topic from now on."""
        got: list[Any] = []
        self.client.create_subscription(kind, topic, got.append, qos)
        return got

    def take(self, kind: Any, topic: str, n: int = 1, qos: Any = 100) -> list[Any]:
        got = self.listen(kind, topic, qos)
        wait_until(lambda: len(got) >= n)
        return got[:n]


def wait_until(true: Callable[[], Any], timeout: float = 60.0) -> None:
    limit = time.monotonic() + timeout
    while not true():
        assert time.monotonic() < limit, "waited in vain"
        time.sleep(0.005)


def table(message: Any) -> tuple[tuple[str, ...], np.ndarray]:
    """Channel names and rows of a Float64MultiArray of the contract."""
    n, c = (dim.size for dim in message.layout.dim)
    return tuple(message.layout.dim[1].label.split(",")), np.array(message.data).reshape(n, c)


def values(status: Any) -> dict[str, str]:
    return {item.key: item.value for item in status.values}
