"""ROS node of the simulator: connects topics, parameters and services with loop and recorder.

Over 300 lines: it has every callback of the node; other modules do the work.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import (
    CallbackGroup,
    MutuallyExclusiveCallbackGroup,
    ReentrantCallbackGroup,
)
from rclpy.clock import Clock, ClockType
from rclpy.parameter import Parameter
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from herringbone_sim.analysis.monitor import Regime
from herringbone_sim.core import parameters as core
from herringbone_sim.core.integrate import State
from herringbone_sim.core.model import Model, build
from herringbone_sim.effects.sensors import check_effects
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import HerringboneError, ParameterError, RecordingError
from herringbone_sim.recording.node_parameters import check, is_known, unknown_message
from herringbone_sim.recording.parameter_file import EFFECTS
from herringbone_sim.ros import parameters as ros_parameters
from herringbone_sim.ros.guarded import GuardedNode, with_names
from herringbone_sim.ros.mirror import Mirror
from herringbone_sim.ros.qos import STREAM, open_publisher, open_subscription
from herringbone_sim.ros.recorder import Recorder, run_name
from herringbone_sim.ros.session import Limits
from herringbone_sim.ros.sim_clock import SimClock
from herringbone_sim.ros.status import simulator_status
from herringbone_sim.ros.streams import Decimator, Streams
from herringbone_sim.runtime import Delivery, Loop, check_pace

NAME = "herringbone_sim"
COMMANDS = ("K", "delta_T")
PACE = ("real_time_factor", "publish_rate")
THREADS = 4  # of the executor: a step, another service, parameters and commands, timers
COMPILING = "compiling the kernel, once on this machine: 30 s or more, samples come after that"
COMPILING_EFFECTS = (
    "compiling the effects, once on this machine: a minute or more, the motion goes on"
)


class SimulatorNode(GuardedNode):
    """Simulates a herringbone planetary gear in real time, controlled by topics and services.

    Raises:
        ParameterError: invalid parameters.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, **options)
        ros_parameters.declare(self)
        self._target = ros_parameters.read_model(self)
        actives = ros_parameters.read_actives(self)
        self.fault = self._last_said = ""
        model = build(self._target)
        factor = self._get("real_time_factor")
        check_pace(model, factor)
        self._decimate = Decimator(self._get("publish_rate"))
        full_name = self.get_fully_qualified_name()
        self.recorder = Recorder(full_name, self._decimate, self.get_logger().error)
        self.mirror = Mirror(model, self._mirror_options(), self._mirror_failed)
        self.streams = Streams(self, self._decimate, self._mirror_on)
        self.loop = Loop(
            model,
            self._deliver,
            actives=actives,
            real_time_factor=factor,
            paused=self._get("start_paused"),
            fail=self._failed,
        )
        self._open()

    def _get(self, name: str) -> Any:
        """Value of a parameter."""
        return self.get_parameter(name).value

    def _mirror_options(self) -> dict[str, Any]:
        names = ("mirror", "mirror_address", "mirror_path", "mirror_memory")
        return {name: self._get(name) for name in names}

    def _open(self) -> None:
        """Register callbacks, services and timers, then start streams, recording and loop.

        Called last in ``__init__``, as the callbacks use its attributes. A recording is started if
        the parameter ``record`` is true.
        """
        self.add_on_set_parameters_callback(self._validate)
        self.add_post_set_parameters_callback(self._apply)
        for name in COMMANDS:
            open_subscription(self, Float64, f"~/cmd/{name}", self._command(name), STREAM)
        group, group_of_step = MutuallyExclusiveCallbackGroup(), ReentrantCallbackGroup()
        self._offer("step", self._step, group_of_step)
        self._offer("pause", self._pause, group)
        self._offer("resume", self._resume, group)
        self._offer("reset", self._reset, group)
        self._offer("record/start", self._record_start, group)
        self._offer("record/stop", self._record_stop, group)
        self._diagnostics = open_publisher(self, DiagnosticArray, "/diagnostics", STREAM)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        timers = MutuallyExclusiveCallbackGroup()
        self.create_timer(1.0, self._diagnose, timers, clock=steady)
        clock = self._get("publish_clock")
        self._sim_clock = SimClock(self, steady, timers, lambda: self.loop.t_s) if clock else None
        loop = self.loop
        self.streams.start(loop.model, loop.state, loop.actives, loop.clock)
        if self._get("record"):
            self._record_first()
        self.loop.start()

    def _tell_time(self) -> None:
        if self._sim_clock:
            self._sim_clock.tick()

    def _offer(self, name: str, serve: Callable[[], str], group: CallbackGroup) -> None:
        """Create the Trigger service ``~/name``; ``serve`` returns its message, or raises."""

        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.message = serve()
                response.success = True
            except HerringboneError as error:
                response.message = str(error)
            except Exception as error:
                response.message = self.failed(name, error)
            return response

        self.create_service(Trigger, f"~/{name}", answer, callback_group=group)

    def _record_first(self) -> None:
        """Start the recording of the parameter ``record``; log its folder or the failure."""
        try:
            path = self._start_recording(self.loop.model, self.loop.state)
            self.get_logger().info(f"recording to {path}")
        except RecordingError as error:
            self.get_logger().error(f"not recording: {error}; the simulation goes on")

    def _deliver(self, delivery: Delivery) -> None:
        """Pass a delivery of the loop to recorder and streams."""
        self.recorder.put(delivery)
        self.streams.put(delivery)

    def _mirror_on(self, deliveries: list[Delivery], regime: Regime) -> None:
        """Tell the decimator the speed reached, and pass deliveries to the mirror."""
        self._decimate.speed = self.loop.pace.reached or 1.0
        self.mirror.show(deliveries, regime)

    def _mirror_failed(self, text: str) -> None:
        if self.context.ok():
            self.get_logger().error(text)

    def _failed(self, text: str) -> None:
        self.fault = text
        self.get_logger().error(text)

    def _validate(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Callback of rclpy before parameters are set; refuses invalid values."""
        try:
            self._check(ros_parameters.plain(parameters))
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set all of the parameters or none, as rclpy does; also count and log a refusal.

        Values that ROS tools send in another type than the declared one are converted if possible.
        A read-only parameter may be set to its present value, which changes nothing.

        Returns:
            Whether they were set; if not, the reason on one line (unknown name, type, range, or a
            gear that is not possible).
        """
        strangers = [p.name for p in parameter_list if not self.has_parameter(p.name)]
        if strangers:
            result = SetParametersResult(reason=unknown_message(strangers[0]))
        else:
            adapted = [ros_parameters.adapted(p) for p in parameter_list]
            news = [p for p in adapted if not ros_parameters.is_unchanged(self, p)]
            if adapted and not news:
                return SetParametersResult(successful=True)
            result = super().set_parameters_atomically(news)
        if not result.successful:
            reason = with_names(result.reason, [parameter.name for parameter in parameter_list])
            result.reason = self.refuse(reason)
        return result

    def _check(self, values: dict[str, Any]) -> None:
        """Check new values together with those in force; ParameterError if they are invalid."""
        for name, value in values.items():
            if is_known(name):
                check(name, value)
        of_model = {k: v for k, v in values.items() if k in core.live_names()}
        factor = values.get("real_time_factor", self._get("real_time_factor"))
        model = build(self._target.changed(of_model))
        check_pace(model, factor)
        check_effects(model, read_effects(values.get(EFFECTS, self._get(EFFECTS))))

    def _apply(self, parameters: Sequence[Parameter]) -> None:
        """Callback of rclpy after parameters were set: pass them to the loop."""
        values = ros_parameters.plain(parameters)
        of_model = {k: v for k, v in values.items() if k in core.live_names()}
        recorded = of_model | {k: v for k, v in values.items() if k in (*PACE, EFFECTS)}
        if recorded:
            self._target = self._target.changed(of_model)
            actives = read_effects(values[EFFECTS]) if EFFECTS in values else None
            self.loop.submit(build(self._target), recorded, actives)
        if "real_time_factor" in values:
            self.loop.set_factor(values["real_time_factor"])
        if "publish_rate" in values:
            self._decimate.publish_rate = values["publish_rate"]

    def _command(self, name: str) -> Any:
        """Return the callback of a command topic, which sets the parameter ``name``."""

        def take(message: Float64) -> None:
            parameter = Parameter(name, Parameter.Type.DOUBLE, message.data)
            self.set_parameters_atomically([parameter])

        return take

    def _pause(self) -> str:
        """Service ``pause``; returns its message, as all services do."""
        self.loop.pause()
        return f"paused at t = {self.loop.call(lambda _, state: state.t):.9g} s"

    def _resume(self) -> str:
        """Service ``resume``."""
        if self.fault:
            raise HerringboneError(f"{self.fault}: call reset first")
        self.loop.resume()
        return f"running from t = {self.loop.t_s:.9g} s"

    def _step(self) -> str:
        """Service ``step``: advance by ``step_cycles`` mesh cycles."""
        if self.fault:
            raise HerringboneError(f"{self.fault}: call reset first")
        wanted = self._get("step_cycles")
        came = self.loop.step(wanted)
        self._tell_time()
        if came.cut:
            raise HerringboneError(
                f"advanced {came.cycles:.9g} of {wanted} mesh cycles to t = {came.t_s:.9g} s: "
                f"{came.cut}"
            )
        return f"advanced {wanted} mesh cycles to t = {came.t_s:.9g} s"

    def _reset(self) -> str:
        """Service ``reset``."""
        name = self._next_name()
        said = self.loop.call(lambda *_: self._reset_now(name))
        self._tell_time()
        return f"reset to t = 0 s{said}"

    def _reset_now(self, name: str) -> str:
        """Reset the loop, start a new recording if one was running; return a text on both."""
        ended = self.recorder.end() if self.recorder.path else None
        self.loop.reset()
        self.fault = ""
        if isinstance(ended, RecordingError):
            return f"; the recording had ended: {ended}"
        if ended is None:
            return ""
        said = f"; recorded before: {ended}" if ended.losses else ""
        try:
            path = self._start_recording(self.loop.model, self.loop.state, name)
        except RecordingError as error:
            return f"{said}; not recording: {error}"
        return f"{said}; recording goes on in {path}"

    def _record_start(self) -> str:
        """Start a recording for service ``record/start``; return the text of its response."""
        name = self._next_name()
        path = self.loop.call(lambda model, state: self._start_recording(model, state, name))
        return f"recording to {path}"

    def _start_recording(self, model: Model, state: State, name: str = "") -> Path:
        """Start a recording that begins with the sample at ``state``; return its folder.

        Args:
            model, state: at that sample.
            name: of the run; empty: ROS parameter ``record_name``, or ``run_`` and the time.

        Raises:
            RecordingError: a recording is running, or the folder can't be created.
        """
        folder = ros_parameters.path_of("record_dir", self._get("record_dir"))
        limits = Limits(self._get("record_max_mb"), self._get("record_max_s"))
        now = self.loop.actives, self.loop.clock, limits
        return self.recorder.start(folder, name or self._next_name(), model, state, *now)

    def _next_name(self) -> str:
        return run_name(str(self._get("record_name")), bool(self.recorder.path))

    def _record_stop(self) -> str:
        """End the recording for service ``record/stop``; return the text of its response."""
        outcome = self.recorder.stop()
        if outcome.lost:
            raise RecordingError(str(outcome))
        return str(outcome)

    def _diagnose(self) -> None:
        """Publish the status in ``/diagnostics``; log once that a kernel is being compiled."""
        if self.loop.compiling:
            self._say_once(COMPILING_EFFECTS if self.loop.ready else COMPILING)
        message = DiagnosticArray(status=[simulator_status(self)])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def _say_once(self, text: str) -> None:
        if text != self._last_said:
            self._last_said = text
            self.get_logger().info(text)

    def destroy_node(self) -> None:
        """Stop the loop, finish the recording and the mirror, then destroy the node."""
        self.loop.close()
        if self.recorder.path:
            ended = self.recorder.end()
            if isinstance(ended, RecordingError) or ended.losses:
                print(ended)
            elif rclpy.ok(context=self.context):
                self.get_logger().info(str(ended))
        self.streams.close()
        self.mirror.close()
        super().destroy_node()
