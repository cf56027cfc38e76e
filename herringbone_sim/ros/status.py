"""Diagnostic status messages of the simulator and of parts of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from herringbone_sim.effects.written import effects_text

if TYPE_CHECKING:
    from herringbone_sim.ros.node import SimulatorNode

BEHIND = 0.9  # fraction of the requested real-time factor below which the node is behind


def simulator_status(node: SimulatorNode) -> DiagnosticStatus:
    """Status of the node for ``/diagnostics``.

    Level and message are those of the most severe condition; values are counts and states as text.
    """
    loop, recorder, mirror = node.loop, node.recorder, node.mirror
    reached = 0.0 if loop.paused else loop.pace.reached
    values = {
        "model": loop.model.parameters.model,
        "t": f"{loop.t_s:.9g}",
        "paused": str(loop.paused).lower(),
        "effects": effects_text(loop.actives),
        "real_time_factor": repr(node.get_parameter("real_time_factor").value),
        "real_time_factor_reached": f"{reached:.4f}",
        "overruns": str(loop.pace.overruns),
        "samples": str(loop.pace.samples),
        "dropped_blocks": str(node.streams.dropped),
        "recorder": recorder.error or str(recorder.path or "off"),
        "recorded_samples": str(recorder.samples),
        "mirror": mirror.state,
        "mirror_dropped_blocks": str(mirror.dropped),
        "rejected_commands": str(node.refused),
        "last_rejected_command": node.last_refused,
        "fault": node.fault,
    }
    level, text = _level(node)
    return status_of(node.get_fully_qualified_name(), "simulator", level, text, values)


def status_of(
    node_name: str, part: str, level: bytes, text: str, values: Mapping[str, str]
) -> DiagnosticStatus:
    """Diagnostic status ``NODE: PART`` with a level, a message and named values."""
    return DiagnosticStatus(
        level=level,
        name=f"{node_name}: {part}",
        message=text,
        hardware_id=node_name,
        values=[KeyValue(key=k, value=v) for k, v in values.items()],
    )


def _level(node: SimulatorNode) -> tuple[bytes, str]:
    """Level and message of the most severe condition of the node."""
    loop, factor = node.loop, node.get_parameter("real_time_factor").value
    if node.fault or node.recorder.error:
        return DiagnosticStatus.ERROR, node.fault or node.recorder.error
    if not loop.ready:
        return DiagnosticStatus.OK, f"{'compiling' if loop.compiling else 'loading'} the kernel"
    if not loop.paused and loop.pace.reached < BEHIND * factor:
        return DiagnosticStatus.WARN, "behind"
    if node.mirror.state.startswith("failed"):
        return DiagnosticStatus.WARN, node.mirror.state
    if loop.compiling:
        return DiagnosticStatus.OK, "running, compiling the effects"
    return DiagnosticStatus.OK, "paused" if loop.paused else "running"
