"""A node that survives invalid messages: exceptions of callbacks are counted, logged and
answered.
"""

from __future__ import annotations

import functools
import re
import threading
from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.exceptions import ParameterException
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService

TURN_S = 0.2  # longest wait in the executor before a signal is noticed
LONGEST_LINE = 300  # characters of a refusal, however long the message was
CUT = " ... "  # stands for the middle of a longer one


def one_line(text: str) -> str:
    """Text on one line of ``LONGEST_LINE`` characters at most; a longer one loses its middle."""
    plain = " ".join(text.split())
    if len(plain) <= LONGEST_LINE:
        return plain
    half = (LONGEST_LINE - len(CUT)) // 2
    return f"{plain[:half]}{CUT}{plain[-half:]}"


def with_names(reason: str, names: Sequence[str]) -> str:
    """Reason of a refusal, prefixed with its parameters' names unless it mentions one of them."""
    if any(re.search(rf"(?<!\w){re.escape(name)}(?!\w)", reason) for name in names):
        return reason
    return f"{', '.join(names)}: {reason}"


class GuardedNode(Node):  # type: ignore[misc]
    """Node that survives exceptions of its callbacks, in any executor.

    Attributes:
        refused: number of messages, requests and callbacks that were refused or failed.
        last_refused: reason of the last refusal or failure; empty before.
    """

    def __init__(self, name: str, **options: Any) -> None:
        self.refused, self.last_refused = 0, ""
        self._counting = threading.Lock()
        super().__init__(name, start_parameter_services=False, **options)
        self._parameter_service = _CheckedParameterService(self)

    def refuse(self, reason: str) -> str:
        """Count and log a refusal; returns the reason on one line."""
        said = one_line(reason)
        with self._counting:
            self.refused += 1
            self.last_refused = said
        self.get_logger().warning(f"refused: {said}")
        return said

    def failed(self, what: str, error: Exception) -> str:
        """Count and log an unexpected error in ``what``; returns the message on one line."""
        return self.refuse(f"{what}: this is an error of ours: {error!r}")

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[..., Any], *args: Any, **options: Any
    ) -> Any:
        """Like rclpy's, with a guarded callback."""
        guarded = self._guarded(callback, topic)
        return super().create_subscription(msg_type, topic, guarded, *args, **options)

    def create_timer(
        self, timer_period_sec: float, callback: Callable[..., Any], *args: Any, **options: Any
    ) -> Any:
        """Like rclpy's, with a guarded callback."""
        guarded = self._guarded(callback, "a timer")
        return super().create_timer(timer_period_sec, guarded, *args, **options)

    def create_service(
        self, srv_type: Any, srv_name: str, callback: Callable[..., Any], **options: Any
    ) -> Any:
        """Like rclpy's, with a guarded callback; if it raises, the response is an empty one."""
        guarded = self._guarded(callback, srv_name, srv_type.Response)
        return super().create_service(srv_type, srv_name, guarded, **options)

    def _guarded(
        self, callback: Callable[..., Any], what: str, instead: Callable[[], Any] | None = None
    ) -> Callable[..., Any]:
        """Wrap a callback: an exception is counted and logged, and gives ``instead()`` or None."""

        @functools.wraps(callback)
        def call(*args: Any) -> Any:
            try:
                return callback(*args)
            except Exception as error:
                self.failed(what, error)
                return instead() if instead else None

        return call

    def set_from_messages(self, messages: Sequence[ParameterMessage]) -> SetParametersResult:
        """Set all of the parameters or none; a refusal is counted, its reason is in the result."""
        try:
            parameters = [Parameter.from_parameter_msg(message) for message in messages]
        except (ValueError, TypeError) as error:
            names = ", ".join(message.name for message in messages)
            reason = f"{names}: {error}: see rcl_interfaces/msg/ParameterType"
            return SetParametersResult(successful=False, reason=self.refuse(reason))
        try:
            result: SetParametersResult = self.set_parameters_atomically(parameters)
        except ParameterException as error:
            reason = with_names(str(error), [parameter.name for parameter in parameters])
            return SetParametersResult(successful=False, reason=self.refuse(reason))
        except Exception as error:
            reason = self.failed("set_parameters", error)
            return SetParametersResult(successful=False, reason=reason)
        return result

    def serve(self, executor: Executor, going: Callable[[], bool]) -> None:
        """Spin an executor while ``going()``; exceptions of the executor itself are counted."""
        executor.add_node(self)
        while going() and self.context.ok():
            try:
                executor.spin_once(timeout_sec=TURN_S)
            except ExternalShutdownException:
                return
            except Exception as error:
                self.failed("the executor", error)


class _CheckedParameterService(ParameterService):  # type: ignore[misc]
    """The parameter services of rclpy, changed so that every request to set gets its results, even
    one with invalid values.
    """

    def _set_parameters_callback(
        self, request: SetParameters.Request, response: SetParameters.Response
    ) -> SetParameters.Response:
        node = self._get_node()
        response.results = [node.set_from_messages([message]) for message in request.parameters]
        return response

    def _set_parameters_atomically_callback(
        self, request: SetParametersAtomically.Request, response: SetParametersAtomically.Response
    ) -> SetParametersAtomically.Response:
        response.result = self._get_node().set_from_messages(request.parameters)
        return response
