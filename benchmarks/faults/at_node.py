"""Malformed and random messages and service calls at a node that runs in a process of its own.

One node lives through all seeds; after each it must answer a plain request with values that a gear
can have.
"""

from __future__ import annotations

import atexit
import contextlib
import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64
from std_srvs.srv import Trigger
from type_description_interfaces.srv import GetTypeDescription

from benchmarks.faults.trial import HANG_S, Trial
from herringbone_sim.core.parameters import live_names, names

RCLError = rclpy_implementation.RCLError
NODE = "/herringbone_sim"
DOMAIN = 101
START_S = 120.0  # of a node that compiles its kernel
PAUSE_S = 0.5  # between pauses: one may be served before the step that it is to end
SHOTS = 12  # a seed
LISTS = (GetParameters, GetParameterTypes, DescribeParameters)
VERBS = ("pause", "resume", "step", "reset", "record/start", "record/stop")
NUMBERS = (0.0, -0.0, 1.0, math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, 1e-30, 2.0**63)
WHOLE = (0, 1, -1, 2**31, -(2**31), 2**63 - 1, -(2**63))
TEXTS = (
    *(
        "",
        ".",
        "..",
        "/proc",
        "\n",
        "'",
        "nan",
        "[",
        "[]",
        "[" * 5000,
        "{{",
        "%s%n",
        "tooth_crack",
    ),
    *("a" * 5000, "x" * 10**6, "\u202e\U0001f600", "~nosuchuser/x", "/dev/null/x", "../../x"),
    *(
        "tooth_crack@sp:depth=nan",
        "clock_drift:ppm=1e308",
        ";" * 5000,
        "sensor_gain@rp:gain=1e300",
    ),
)
OTHERS = ("use_sim_time", "start_type_description_service", "record_dir", "record_name", "effects")


class Target:
    """A node in a process of its own, and a client that shoots at it."""

    def __init__(self) -> None:
        self.folder = tempfile.TemporaryDirectory()
        self.log = Path(self.folder.name) / "log"
        below = Path(self.folder.name, "so", "that", "..", "stays", "inside").resolve()
        below.mkdir(parents=True)
        with self.log.open("wb") as log:
            arguments = ["-p", "step_cycles:=1000000", "-p", "real_time_factor:=0.01"]
            self.process = subprocess.Popen(
                [sys.executable, "-m", "herringbone_sim", "run", "--ros-args", *arguments],
                cwd=below,
                env={**os.environ, **environment()},
                stdout=log,
                stderr=subprocess.STDOUT,
            )
        os.environ.update(environment())
        self.context = Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.client = Node("saboteur", context=self.context, start_parameter_services=False)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.client)
        self.services: dict[str, Any] = {}
        self.topics: dict[str, Any] = {}
        atexit.register(self.close)
        if self.ask(GetParameters, "get_parameters", ["K"], START_S) is None:
            raise RuntimeError(f"the node did not start: {self.log.read_text()[-2000:]}")

    def send(self, kind: Any, name: str, request: Any) -> Any:
        """Future of a request; None where the service is not there."""
        if name not in self.services:
            self.services[name] = self.client.create_client(kind, f"{NODE}/{name}")
        return self.services[name].call_async(request)

    def wait(self, futures: Sequence[Any], seconds: float) -> None:
        """Take answers until all futures are done, or the time is over."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not all(future.done() for future in futures):
            self.executor.spin_once(timeout_sec=0.05)

    def ask(self, kind: Any, name: str, about: list[str], seconds: float | None = None) -> Any:
        """Answer of a parameter service; None when there is none in time (``HANG_S``)."""
        end = time.monotonic() + (HANG_S if seconds is None else seconds)
        self.services.setdefault(name, self.client.create_client(kind, f"{NODE}/{name}"))
        while not self.services[name].service_is_ready() and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.05)
        request = kind.Request(names=about)
        future = self.send(kind, name, request)
        self.wait([future], end - time.monotonic())
        return future.result() if future.done() else None

    def publish(self, kind: Any, topic: str, message: Any) -> None:
        if topic not in self.topics:
            self.topics[topic] = self.client.create_publisher(kind, topic, 10)
        self.topics[topic].publish(message)

    @property
    def peak_bytes(self) -> int:
        """Largest resident memory of the node so far; 0 when it has ended."""
        try:
            status = Path(f"/proc/{self.process.pid}/status").read_text()
        except OSError:
            return 0
        found = [line.split()[1] for line in status.splitlines() if line.startswith("VmHWM")]
        return int(found[0]) * 1024 if found else 0

    def close(self) -> None:
        atexit.unregister(self.close)
        self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(30.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.executor.shutdown()
        self.client.destroy_node()
        rclpy.shutdown(context=self.context)
        self.folder.cleanup()


def environment() -> dict[str, str]:
    """Of node and client: this machine alone, a domain of their own."""
    return {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": str(DOMAIN),
        "PYTHONPATH": os.pathsep.join(
            [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
        ),
    }


Shot = tuple[str, Callable[[Target], Any]]  # what is sent, and what sends it: a future or None


@cache
def target() -> Target:
    """The one that lives through all seeds."""
    return Target()


def messages(seed: int, folder: Path) -> Trial:
    """One trial: ``SHOTS`` hostile messages and requests, then a plain question."""
    del folder  # nothing is written
    node = target()
    shots = [plan(random.Random(f"{seed} {i}")) for i in range(SHOTS)]
    before = node.log.stat().st_size
    lost = unanswered(node, shots)
    began = time.monotonic()
    broken = [f"{text}: not answered" for text, _ in unanswered(node, lost)]
    broken += health(node)
    seconds = time.monotonic() - began
    said = node.log.read_bytes()[before:].decode(errors="replace")
    traced = "Traceback (most recent call last)" in said
    trial = Trial(
        fault=", ".join(text for text, _ in shots),
        seconds=seconds,
        peak_bytes=node.peak_bytes,
        traceback=said.strip().splitlines()[-1][:300] if traced else "",
        broken=tuple(broken),
    )
    if broken or traced:
        node.close()
        target.cache_clear()
    return trial


def unanswered(node: Target, shots: Sequence[Shot]) -> list[Shot]:
    """Send these; those without an answer, though pauses end the steps among them.

    DDS sends a request of megabytes in pieces and, now and then, never delivers it: what is not
    answered is sent again before the node is blamed.
    """
    fired = [(shot, shot[1](node)) for shot in shots]
    waiting = [(shot, future) for shot, future in fired if future is not None]
    futures = [future for _, future in waiting]
    end = time.monotonic() + HANG_S
    while time.monotonic() < end and not all(future.done() for future in futures):
        pause = node.send(Trigger, "pause", Trigger.Request())
        node.wait([*futures, pause], PAUSE_S)
    return [shot for shot, future in waiting if not future.done()]


def health(node: Target) -> list[str]:
    """Promises that do not hold: it lives, answers, and its live parameters are finite."""
    answer = node.ask(GetParameters, "get_parameters", list(live_names()))
    if node.process.poll() is not None:
        return [f"the node ended with {node.process.returncode}"]
    if answer is None:
        return ["get_parameters is not answered"]
    values = [value.double_value for value in answer.values]
    if len(values) != len(live_names()) or not all(map(math.isfinite, values)):
        return [f"live parameters are {values}"]
    return []


def plan(r: random.Random) -> Shot:
    """What is sent, and a function that sends it and returns a future or None."""
    return r.choice((_set, _set, _set_whole, _ask, _list, _describe_type, _call, _steer, _other))(
        r
    )


def _set(r: random.Random) -> Shot:
    many = [_parameter(r) for _ in range(r.randint(0, 4))]
    request = SetParameters.Request(parameters=many)
    return f"set {_shown(many)}", lambda node: node.send(SetParameters, "set_parameters", request)


def _set_whole(r: random.Random) -> Shot:
    many = [_parameter(r) for _ in range(r.randint(0, 4))]
    request = SetParametersAtomically.Request(parameters=many)
    name = "set_parameters_atomically"
    return f"{name} {_shown(many)}", lambda node: node.send(SetParametersAtomically, name, request)


def _ask(r: random.Random) -> Shot:
    kind = r.choice(LISTS)
    name = {GetParameters: "get_parameters", GetParameterTypes: "get_parameter_types"}.get(
        kind, "describe_parameters"
    )
    request = kind.Request(names=[_name(r) for _ in range(r.randint(0, 5))])
    return name, lambda node: node.send(kind, name, request)


def _list(r: random.Random) -> Shot:
    prefixes = [_name(r) for _ in range(r.randint(0, 3))]
    depth = r.choice((0, 1, 2**31, 2**64 - 1))
    request = ListParameters.Request(prefixes=prefixes, depth=depth)
    return "list_parameters", lambda node: node.send(ListParameters, "list_parameters", request)


def _describe_type(r: random.Random) -> Shot:
    request = GetTypeDescription.Request(type_name=r.choice(TEXTS), type_hash=r.choice(TEXTS))
    name = "get_type_description"
    return name, lambda node: node.send(GetTypeDescription, name, request)


def _call(r: random.Random) -> Shot:
    name = r.choice(VERBS)
    return name, lambda node: node.send(Trigger, name, Trigger.Request())


def _steer(r: random.Random) -> Shot:
    topic = f"{NODE}/cmd/{r.choice(('K', 'delta_T'))}"
    if r.random() < 0.5:
        value = r.choice((*NUMBERS, r.uniform(-1e3, 1e3)))
        return f"{topic} {value!r}", lambda node: node.publish(Float64, topic, Float64(data=value))
    raw = b"\0\1\0\0" + r.randbytes(r.choice((0, 1, 7, 8, 8, 9, 4096)))
    return f"{topic} {len(raw)} bytes", lambda node: _publish_raw(node, topic, raw)


def _publish_raw(node: Target, topic: str, raw: bytes) -> None:
    with contextlib.suppress(RCLError):  # the client itself refuses some
        node.publish(Float64, topic, raw)


def _other(r: random.Random) -> Shot:
    if r.random() < 0.5:
        stamp = Time(sec=r.choice((0, -1, -(2**31), 2**31 - 1)), nanosec=r.choice((0, 2**32 - 1)))
        return "clock", lambda node: node.publish(Clock, "/clock", Clock(clock=stamp))
    event = ParameterEvent(node=NODE, changed_parameters=[_parameter(r)])
    topic = "/parameter_events"
    return topic, lambda node: node.publish(ParameterEvent, topic, event)


def _parameter(r: random.Random) -> Parameter:
    value = ParameterValue(
        type=r.choice((*range(10), r.randrange(256))),
        bool_value=r.random() < 0.5,
        integer_value=r.choice(WHOLE),
        double_value=r.choice((*NUMBERS, r.uniform(-2.0, 2.0))),
        string_value=r.choice(TEXTS),
        byte_array_value=[bytes([r.randrange(256)]) for _ in range(r.randint(0, 3))],
        bool_array_value=[True] * r.randint(0, 3),
        integer_array_value=[r.choice(WHOLE) for _ in range(r.randint(0, 3))],
        double_array_value=[r.choice(NUMBERS) for _ in range(r.choice((0, 1, 3, 10**5)))],
        string_array_value=[r.choice(TEXTS) for _ in range(r.randint(0, 3))],
    )
    return Parameter(name=_name(r), value=value)


def _name(r: random.Random) -> str:
    return r.choice((*names(), *live_names(), *live_names(), *OTHERS, *TEXTS))


def _shown(many: list[Parameter]) -> str:
    return ", ".join(f"{one.name[:20]!r} as {one.value.type}" for one in many)
