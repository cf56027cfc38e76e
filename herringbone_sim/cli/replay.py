"""``replay``: integrate a run again and compare, or send it over the topics."""

from __future__ import annotations

import argparse
import signal
from pathlib import Path

from herringbone_sim.cli.verbs import add_verb
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
# Options of --publish, and what they are where they are not given.
PLAYING = {
    "speed": 1.0,
    "start": 0.0,
    "loop": False,
    "clock": None,
    "node_name": "herringbone_sim",
}


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command ``replay``."""
    parser = add_verb(subparsers, "replay", DESCRIPTION, EXAMPLES)
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder or .mcap file")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--verify", action="store_true", help="integrate again and compare")
    what.add_argument("--publish", action="store_true", help="send over the topics")
    _add_playing(parser.add_argument_group("with --publish"))
    parser.set_defaults(func=replay)


def _add_playing(group: argparse._ArgumentGroup) -> None:
    """Options as ``ros2 bag play`` has them."""
    add = group.add_argument
    add(
        "--speed",
        type=float,
        default=PLAYING["speed"],
        help="recorded over wall time [%(default)s]",
    )
    add(
        "--start",
        "--start-offset",
        type=float,
        default=PLAYING["start"],
        metavar="SECONDS",
        help="leave out so much of the beginning [%(default)s]",
    )
    add("-l", "--loop", action="store_true", help="begin again at the end, until Ctrl-C")
    add(
        "--clock",
        type=float,
        nargs="?",
        const=40.0,
        metavar="HZ",
        help="send the time of the recording on /clock as well, %(const)s times a second",
    )
    add("--node-name", default=PLAYING["node_name"], help="whose topics [%(default)s]")


def replay(args: argparse.Namespace) -> int:
    """Exit code 0, 1 when the repetition differs, 128 and the signal that ended a sending."""
    _check_playing(args)
    recording = read_recording(args.run)
    for note in recording.notes:
        print(f"note: {note}")
    return _publish(recording, args) if args.publish else _verify(recording)


def _check_playing(args: argparse.Namespace) -> None:
    """ParameterError where --verify comes with what only a sending has."""
    given = [name for name, usual in PLAYING.items() if getattr(args, name) != usual]
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
