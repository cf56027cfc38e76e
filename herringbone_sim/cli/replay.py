"""``replay``: integrate a run again and compare, or send it over the topics."""

from __future__ import annotations

import argparse
import signal

from herringbone_sim.cli.options import add_number, add_run
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.reader import Recording, read_recording
from herringbone_sim.replay import verify

DESCRIPTION = """\
Repeat a recorded run.

--verify   integrates it again from its recorded parameters, initial state and every recorded
           change, and compares every bit of every sample (needs no ROS);
--publish  sends the recording over the topics of the node, at a chosen speed (needs ROS 2).
"""
EXAMPLES = """\
python -m herringbone_sim run --ros-args -p record:=true -p record_name:=first
python -m herringbone_sim replay runs/first --verify
python -m herringbone_sim replay runs/first --publish
"""
# Defaults of the options of --publish.
PUBLISH_DEFAULTS = {
    "speed": 1.0,
    "start": 0.0,
    "loop": False,
    "clock": None,
    "node_name": "herringbone_sim",
}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    add_run(parser)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--verify", action="store_true", help="integrate again and compare")
    what.add_argument("--publish", action="store_true", help="send over the topics")
    _add_publishing(parser.add_argument_group("with --publish"))


def _add_publishing(group: argparse._ArgumentGroup) -> None:
    """Options as ``ros2 bag play`` has them."""
    add = group.add_argument
    add_number(group, "--speed", 1.0, "recorded over wall time", None)
    add(
        "--start",
        "--start-offset",
        type=float,
        default=0.0,
        metavar="SECONDS",
        help="offset from the beginning of the run [%(default)s]",
    )
    add("-l", "--loop", action="store_true", help="repeat until Ctrl-C")
    add(
        "--clock",
        type=float,
        nargs="?",
        const=40.0,
        metavar="HZ",
        help="send the time of the recording on /clock as well, %(const)s times a second",
    )
    add("--node-name", default="herringbone_sim", help="prefix of the topics [%(default)s]")


def run(args: argparse.Namespace) -> int:
    """Repeat or publish the run.

    Exit code 0; 1 if the repetition differs; 128 plus the signal that ended the publishing.
    """
    _check_publishing(args)
    recording = read_recording(args.run)
    for note in recording.notes:
        print(f"note: {note}")
    return _publish(recording, args) if args.publish else _verify(recording)


def _check_publishing(args: argparse.Namespace) -> None:
    """ParameterError if an option of --publish is given with --verify."""
    given = [name for name, default in PUBLISH_DEFAULTS.items() if getattr(args, name) != default]
    if args.verify and given:
        words = ", ".join(f"--{name.replace('_', '-')}" for name in given)
        raise ParameterError(f"{words} must come with --publish, got --verify: leave it out")


def _publish(recording: Recording, args: argparse.Namespace) -> int:
    from herringbone_sim.ros.replay import Playing, publish

    if args.clock is not None and not args.clock > 0.0:
        raise ParameterError(f"--clock must be positive, got {args.clock}: 40 is usual")
    playing = Playing(args.speed, args.start, args.loop, args.clock or 0.0)
    sent = publish(recording, playing, args.node_name)
    ended = f"; ended by {signal.Signals(sent.signal).name}" if sent.signal else ""
    print(f"{recording.name}: {sent.samples} of {sent.of} samples sent{ended}")
    return 128 + sent.signal if sent.signal else 0


def _verify(recording: Recording) -> int:
    verdict = verify(recording)
    about = f"{verdict.samples} samples, {verdict.changes} parameter changes"
    if verdict.identical:
        print(f"{recording.name}: identical to the bit ({about})")
        return 0
    print(
        f"{recording.name}: differs from sample {verdict.first_difference} on, by "
        f"{verdict.largest_difference:.3g} at most ({about}); recorded by version "
        f"{recording.channels.version or 'unknown'}"
    )
    return 1
