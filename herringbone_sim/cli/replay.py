"""Repeat a recorded run.

--verify   integrates it again from its recorded parameters, initial state
           and every recorded change, and compares every bit of every sample
           (needs no ROS);
--publish  sends the recording over the topics of the node, at a chosen speed
           (needs ROS 2).
"""

from __future__ import annotations

import math
import signal
from dataclasses import dataclass, fields
from typing import Annotated

from cyclopts import Parameter

from herringbone_sim.cli.arguments import Alone
from herringbone_sim.cli.options import NO_ROS, Run, limits, one_of
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.reader import Recording, read_recording
from herringbone_sim.replay import verify as verify_recording

EXAMPLES = """\
python -m herringbone_sim run --ros-args -p record:=true -p record_name:=first
python -m herringbone_sim replay runs/first --verify
python -m herringbone_sim replay runs/first --publish
"""
CLOCK_HZ = "40"
WHAT = one_of("what to do, one of")


@Parameter(name="*", group="with --publish")
@dataclass(frozen=True, slots=True, kw_only=True)
class Sending:
    """Options of publishing, named as those of ``ros2 bag play``."""

    speed: Annotated[float, "FACTOR", "recorded over wall time"] = 1.0
    start: Annotated[
        float, "SECONDS", Parameter(alias="--start-offset"), "offset from the beginning of the run"
    ] = 0.0
    loop: Annotated[bool, Parameter(alias="-l"), "repeat until Ctrl-C"] = False
    clock: Annotated[
        float | None,
        "[HZ]",
        Alone(CLOCK_HZ),
        limits(gt=0.0),
        f"send the time of the recording on /clock as well, {CLOCK_HZ} times a second if no "
        "rate is given",
    ] = None
    node_name: Annotated[str, "NAME", "prefix of the topics"] = "herringbone_sim"


def run(
    run: Run,
    /,
    *,
    verify: Annotated[bool, WHAT, "integrate again and compare"] = False,
    publish: Annotated[bool, WHAT, "send over the topics"] = False,
    sending: Sending = Sending(),
) -> int:
    """Integrate a recorded run again and compare it, or publish it over ROS topics.

    Returns:
        Exit code: 0; 1 if the repetition differs from the recording; 2 to publish without ROS;
        128 plus the number of the signal that ended the publishing.
    """
    given = [
        field.name for field in fields(sending) if getattr(sending, field.name) != field.default
    ]
    if verify and given:
        words = ", ".join(f"--{name.replace('_', '-')}" for name in given)
        raise ParameterError(f"{words} must come with --publish, got --verify: leave it out")
    recording = read_recording(run)
    for note in recording.notes:
        print(f"note: {note}")
    return _publish(recording, sending) if publish else _verify(recording)


def _publish(recording: Recording, sending: Sending) -> int:
    try:
        from herringbone_sim.ros.replay import Playing, publish
    except ImportError as error:
        print(NO_ROS.format(error=error))
        return 2
    playing = Playing(sending.speed, sending.start, sending.loop, sending.clock or 0.0)
    sent = publish(recording, playing, sending.node_name)
    ended = f"; ended by {signal.Signals(sent.signal).name}" if sent.signal else ""
    print(f"{recording.name}: {sent.samples} of {sent.of} samples sent{ended}")
    return 128 + sent.signal if sent.signal else 0


def _verify(recording: Recording) -> int:
    verdict = verify_recording(recording)
    about = f"{verdict.samples} samples, {verdict.changes} parameter changes"
    if verdict.identical:
        print(f"{recording.name}: identical to the bit ({about})")
        return 0
    by = f"by {verdict.largest_difference:.3g} at most"
    if math.isinf(verdict.largest_difference):
        by = "as the repetition diverges before the end of the recording"
    print(
        f"{recording.name}: differs from sample {verdict.first_difference} on, {by} ({about}); "
        f"recorded by version {recording.channels.version or 'unknown'}"
    )
    return 1
