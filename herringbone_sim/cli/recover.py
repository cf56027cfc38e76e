"""``recover``: make a run whole again that was cut off."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from herringbone_sim.cli.verbs import add_verb
from herringbone_sim.errors import listed
from herringbone_sim.recording.recover import RecoveryReport, recover

DESCRIPTION = """\
Makes a run whole again whose recording was cut off by a kill, a power cut or a full disk: keeps
every whole message, rebuilds the index and metadata.yaml, so that ROS tools open it, and says
what is missing. The cut file stays beside it as NAME_0.mcap.cut if anything in it had to be left
out. A finished run is left as it is.
"""
EXAMPLES = """\
python -m herringbone_sim run --ros-args -p record:=true -p record_name:=first
python -m herringbone_sim recover runs/first
"""


def add_parser(subparsers: Any) -> None:
    """Register ``recover`` with the sub-parsers of the command line."""
    parser = add_verb(subparsers, "recover", DESCRIPTION, EXAMPLES)
    parser.add_argument(
        "run", type=Path, metavar="RUN", help="run folder, as runs/my_run, or a .mcap file"
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="new folder for the recovered run; without it the run itself is mended",
    )
    parser.set_defaults(func=run)


def run(args: argparse.Namespace) -> int:
    """Recover ``args.run`` and print what became of it; 1 if there are no samples in it.

    Raises:
        RecordingError: it can't be done.
    """
    report = recover(args.run, args.out)
    print(as_text(report))
    return 0 if report.samples else 1


def as_text(report: RecoveryReport) -> str:
    """The report in sentences, one a line."""
    return "\n".join([_verdict(report), _kept(report), *_missing(report)])


def _verdict(report: RecoveryReport) -> str:
    names = listed(report.paths)
    if not report.samples:
        when = "" if report.was_complete else " it was cut off before the first was on the disk:"
        return f"{names} holds no samples:{when} record it again"
    if report.missing:
        return f"{names} is good now, but not the whole run"
    if not report.changed:
        return f"{names} is complete: left as it is"
    if report.was_complete:
        return f"{names} was finished, and is complete now"
    return f"{names} was cut off, and is complete now"


def _kept(report: RecoveryReport) -> str:
    held = f"it holds {report.messages} messages with {report.samples} samples"
    if report.span_s is None:
        return held
    return f"{held}, from {report.span_s[0]:.9g} s to {report.span_s[1]:.9g} s"


def _missing(report: RecoveryReport) -> list[str]:
    lines = []
    if not report.was_complete:
        tail = report.bytes_dropped
        lines.append(
            "missing: what had not reached the disk (of this simulator at most the last half "
            f"second){f', and {tail} bytes at the end of the file' if tail else ''}"
        )
    if report.chunks_dropped:
        lines.append(f"missing: {report.chunks_dropped} damaged records inside the file")
    if report.originals:
        lines.append(f"the file as it was is kept as {listed(report.originals)}")
    return lines + [f"note: {note}" for note in report.notes]
