"""The node: parameters, commands and services around the loop; streams, recorder and mirror."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from herringbone_sim.analysis.monitor import Regime
from herringbone_sim.core import parameters as core
from herringbone_sim.core.integrate import State
from herringbone_sim.core.model import Model, build
from herringbone_sim.effects.sensors import check_effects
from herringbone_sim.effects.written import effects_text, read_effects
from herringbone_sim.errors import HerringboneError, ParameterError, RecordingError
from herringbone_sim.recording.parameter_file import EFFECTS
from herringbone_sim.ros import parameters as ros_parameters
from herringbone_sim.ros.mirror import Mirror
from herringbone_sim.ros.recorder import Recorder
from herringbone_sim.ros.streams import STREAM, Decimator, Streams
from herringbone_sim.runtime import Delivery, Loop, check_pace

NAME = "herringbone_sim"
COMMANDS = ("K", "delta_T")
PACE = ("real_time_factor", "publish_rate")


class SimulatorNode(Node):  # type: ignore[misc]
    """Integrates a herringbone planetary gear in real time and lets others steer it.

    Raises:
        ParameterError: parameters that can't be.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, **options)
        ros_parameters.declare(self)
        self.add_pre_set_parameters_callback(self._convert)
        self._target = ros_parameters.read_model(self)
        actives = ros_parameters.read_actives(self)
        self._service_group = MutuallyExclusiveCallbackGroup()
        self._rejected, self._last_rejected, self._fault = 0, "", ""
        model = build(self._target)
        factor = self._get("real_time_factor")
        check_pace(model, factor)
        self._decimate = Decimator(self._get("publish_rate"))
        full_name = self.get_fully_qualified_name()
        self.recorder = Recorder(full_name, self._decimate, self.get_logger().error)
        self.mirror = Mirror.of(model, self._mirror_options())
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
        return self.get_parameter(name).value

    def _mirror_options(self) -> dict[str, Any]:
        names = ("mirror", "mirror_address", "mirror_path", "mirror_memory")
        return {name: self._get(name) for name in names}

    def _open(self) -> None:
        """Callbacks, services, timers, threads: last, when all they use is there."""
        self.add_on_set_parameters_callback(self._validate)
        self.add_post_set_parameters_callback(self._act)
        for name in COMMANDS:
            self.create_subscription(Float64, f"~/cmd/{name}", self._command(name), STREAM)
        services = {
            "pause": self._pause,
            "resume": self._resume,
            "step": self._step,
            "reset": self._reset,
            "record/start": self._record_start,
            "record/stop": self._record_stop,
        }
        for name, serve in services.items():
            answer = _answering(serve)
            self.create_service(Trigger, f"~/{name}", answer, callback_group=self._service_group)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", STREAM)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0, self._diagnose, clock=steady)
        self._clock_publisher = None
        if self._get("publish_clock"):
            self._open_clock(steady)
        self.streams.start()
        if self._get("record"):
            self._record_first()
        self.loop.start()

    def _open_clock(self, steady: Clock) -> None:
        time.sleep(0.5)
        if self.count_publishers("/clock"):
            self.get_logger().error(
                "another node publishes /clock: this one does not; stop the other or leave "
                "publish_clock false"
            )
            return
        self._clock_publisher = self.create_publisher(ClockMessage, "/clock", 10)
        self.create_timer(0.01, self._tick, clock=steady)

    def _tick(self) -> None:
        if self._clock_publisher is not None:
            seconds, part = divmod(round(self.loop.t_s * 1e9), 10**9)
            stamp = Time(sec=seconds, nanosec=part)
            self._clock_publisher.publish(ClockMessage(clock=stamp))

    def _record_first(self) -> None:
        try:
            path = self._start_recording(self.loop.model, self.loop.state)
            self.get_logger().info(f"recording to {path}")
        except RecordingError as error:
            self.get_logger().error(f"not recording: {error}; the simulation goes on")

    def _deliver(self, delivery: Delivery) -> None:
        self.recorder.put(delivery)
        self.streams.put(delivery)

    def _mirror_on(self, deliveries: list[Delivery], regime: Regime) -> None:
        self._decimate.speed = self.loop.pace.reached or 1.0
        self.mirror.show(deliveries, regime)

    def _failed(self, text: str) -> None:
        self._fault = text
        self.get_logger().error(text)

    def _convert(self, parameters: Sequence[Parameter]) -> list[Parameter]:
        return [ros_parameters.as_double(p) for p in parameters]

    def _validate(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        try:
            self._check(ros_parameters.plain(parameters))
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """As in rclpy; every refusal, also by range or type, is counted and reported."""
        try:
            result = super().set_parameters_atomically(parameter_list)
        except ParameterException as error:
            self._reject(str(error))
            raise
        if not result.successful:
            self._reject(result.reason)
        return result

    def _check(self, values: dict[str, Any]) -> None:
        for name, value in values.items():
            if ros_parameters.known(name):
                ros_parameters.check(name, value)
        of_model = {k: v for k, v in values.items() if k in core.live_names()}
        factor = values.get("real_time_factor", self._get("real_time_factor"))
        model = build(self._target.changed(of_model))
        check_pace(model, factor)
        check_effects(model, read_effects(values.get(EFFECTS, self._get(EFFECTS))))

    def _act(self, parameters: Sequence[Parameter]) -> None:
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

    def _reject(self, reason: str) -> None:
        self._rejected += 1
        self._last_rejected = reason
        self.get_logger().warning(f"refused: {reason}")

    def _command(self, name: str) -> Any:
        def take(message: Float64) -> None:
            parameter = Parameter(name, Parameter.Type.DOUBLE, message.data)
            self.set_parameters_atomically([parameter])

        return take

    def _pause(self) -> str:
        self.loop.pause()
        return f"paused at t = {self.loop.call(lambda _, state: state.t):.9g} s"

    def _resume(self) -> str:
        if self._fault:
            raise HerringboneError(f"{self._fault}: call reset first")
        self.loop.resume()
        return f"running from t = {self.loop.t_s:.9g} s"

    def _step(self) -> str:
        if self._fault:
            raise HerringboneError(f"{self._fault}: call reset first")
        cycles = self._get("step_cycles")
        refused = self.loop.step(cycles)
        if refused:
            raise HerringboneError(refused)
        self._tick()
        return f"advanced {cycles} mesh cycles to t = {self.loop.t_s:.9g} s"

    def _reset(self) -> str:
        name = self._next_name()
        said = self.loop.call(lambda *_: self._reset_now(name))
        self._tick()
        return f"reset to t = 0 s{said}"

    def _reset_now(self, name: str) -> str:
        """Reset in any case; what came of a recording that was running."""
        recording, said = self.recorder.path, ""
        if recording:
            try:
                self.recorder.stop()
            except RecordingError as error:
                said = f"; the recording had ended: {error}"
        self.loop.reset()
        self._fault = ""
        if recording and not said:
            try:
                path = self._start_recording(self.loop.model, self.loop.state, name)
                said = f"; recording goes on in {path}"
            except RecordingError as error:
                said = f"; not recording: {error}"
        return said

    def _record_start(self) -> str:
        name = self._next_name()
        path = self.loop.call(lambda model, state: self._start_recording(model, state, name))
        return f"recording to {path}"

    def _start_recording(self, model: Model, state: State, name: str = "") -> Path:
        try:
            folder = Path(self._get("record_dir")).expanduser()
        except RuntimeError as error:
            raise RecordingError(f"record_dir {self._get('record_dir')!r}: {error}") from error
        now = self.loop.actives, self.loop.clock
        return self.recorder.start(folder, name or self._next_name(), model, state, *now)

    def _next_name(self) -> str:
        given = str(self._get("record_name"))
        stamp = time.strftime("%Y-%m-%d_%H-%M-%S") + f"-{time.time_ns() // 10**6 % 1000:03d}"
        return given if given and not self.recorder.path else f"{given or 'run'}_{stamp}"

    def _record_stop(self) -> str:
        path, written, offered = self.recorder.stop()
        return f"{written} samples written, {offered - written} lost, to {path}"

    def _diagnose(self) -> None:
        if not self.loop.ready:
            self.get_logger().info("compiling the kernel, once: about 15 s", once=True)
        message = DiagnosticArray(status=[self._status()])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def _status(self) -> DiagnosticStatus:
        wanted, reached = self._get("real_time_factor"), self.loop.pace.reached
        values = {
            "t": f"{self.loop.t_s:.9g}",
            "paused": str(self.loop.paused).lower(),
            "effects": effects_text(self.loop.actives),
            "real_time_factor": repr(wanted),
            "real_time_factor_reached": f"{0.0 if self.loop.paused else reached:.4f}",
            "overruns": str(self.loop.pace.overruns),
            "samples": str(self.loop.pace.samples),
            "dropped_blocks": str(self.streams.dropped),
            "recorder": self.recorder.error or str(self.recorder.path or "off"),
            "recorded_samples": str(self.recorder.samples),
            "mirror": self.mirror.state,
            "mirror_dropped_blocks": str(self.mirror.dropped),
            "rejected_commands": str(self._rejected),
            "last_rejected_command": self._last_rejected,
            "fault": self._fault,
        }
        level, text = DiagnosticStatus.OK, "running" if self.loop.ready else "compiling the kernel"
        late = self.loop.ready and wanted > 0 and not self.loop.paused and reached < 0.9 * wanted
        if late or self.mirror.state.startswith("failed"):
            level, text = DiagnosticStatus.WARN, "behind" if late else self.mirror.state
        if self._fault or self.recorder.error:
            level, text = DiagnosticStatus.ERROR, self._fault or self.recorder.error
        return DiagnosticStatus(
            level=level,
            name=f"{self.get_name()}: simulator",
            message=text,
            hardware_id=self._target.model,
            values=[KeyValue(key=k, value=v) for k, v in values.items()],
        )

    def destroy_node(self) -> None:
        """End the loop, finish the recording and the mirror, then the node."""
        self.loop.close()
        if self.recorder.path:
            try:
                path, written, offered = self.recorder.stop()
                text = f"{written} samples written, {offered - written} lost, to {path}"
                if rclpy.ok(context=self.context):
                    self.get_logger().info(text)
            except RecordingError as error:
                print(error)
        self.streams.close()
        self.mirror.close()
        super().destroy_node()


def _answering(serve: Any) -> Any:
    """Service callback around a verb that returns its answer or raises."""

    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.message = serve()
            response.success = True
        except HerringboneError as error:
            response.message, response.success = str(error), False
        except Exception as error:
            response.message, response.success = f"this is an error of ours: {error!r}", False
        return response

    return answer
