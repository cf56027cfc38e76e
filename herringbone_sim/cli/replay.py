"""``replay``: integrate a run again and compare, or send it over the topics."""

from __future__ import annotations

import argparse
from pathlib import Path

from herringbone_sim.recording.reader import read_recording
from herringbone_sim.replay import verify

DESCRIPTION = """\
Repeat a recorded run.

--verify   integrates it again from its recorded parameters, initial state and every recorded
           change, and compares every bit of every sample (needs no ROS);
--publish  sends the recording over the topics of the node, at a chosen speed (needs ROS 2).
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command ``replay``."""
    parser = subparsers.add_parser(
        "replay",
        help="integrate a run again and compare bit for bit, or publish it",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder or .mcap file")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--verify", action="store_true", help="integrate again and compare")
    what.add_argument("--publish", action="store_true", help="send over the topics")
    parser.add_argument(
        "--speed", type=float, default=1.0, help="recorded over wall time [%(default)s]"
    )
    parser.add_argument(
        "--node-name", default="herringbone_sim", help="whose topics [%(default)s]"
    )
    parser.set_defaults(func=replay)


def replay(args: argparse.Namespace) -> int:
    """Exit code 0, or 1 when the repetition differs."""
    recording = read_recording(args.run)
    for note in recording.notes:
        print(f"note: {note}")
    if args.publish:
        from herringbone_sim.ros.replay import publish

        sent = publish(recording, args.speed, args.node_name)
        print(f"{recording.name}: {sent} samples sent")
        return 0
    verdict = verify(recording)
    about = f"{verdict.samples} samples, {verdict.changes} parameter changes"
    if verdict.identical:
        print(f"{recording.name}: identical to the bit ({about})")
        return 0
    print(
        f"{recording.name}: differs from sample {verdict.first_difference} on, by "
        f"{verdict.largest_difference:.3g} at most ({about}); recorded by version "
        f"{recording.channels.get('version', 'unknown')}"
    )
    return 1
