"""``recover``: make a run whole again that was cut off."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from herringbone_sim.recording.recover import RecoveryReport, recover

_DESCRIPTION = """\
Makes a run whole again whose recording was cut off by a kill, a power cut or a full disk: keeps
every whole message, rebuilds the index and metadata.yaml, so that ROS tools open it, and says
what is missing. The cut file stays beside it as NAME_0.mcap.cut if anything in it had to be left
out. A finished run is left as it is."""


def add_parser(subparsers: Any) -> None:
    """Register ``recover`` with the sub-parsers of the command line."""
    parser = subparsers.add_parser(
        "recover",
        help="make a run whole again that was cut off",
        description=_DESCRIPTION,
        epilog="example: python -m herringbone_sim recover runs/my_run",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
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
    """Recover ``args.run`` and print what became of it; RecordingError if it can't be done."""
    print(as_text(recover(args.run, args.out)))
    return 0


def as_text(report: RecoveryReport) -> str:
    """The report in sentences, one a line."""
    return "\n".join([_verdict(report), _kept(report), *_missing(report)])


def _verdict(report: RecoveryReport) -> str:
    if not report.changed:
        return f"{report.path} is complete: left as it is"
    if report.was_complete:
        return f"{report.path} was finished, and is complete now"
    return f"{report.path} was cut off, and is complete now"


def _kept(report: RecoveryReport) -> str:
    held = f"it holds {report.messages} messages with {report.samples} samples"
    if report.span_s is None:
        return held
    return f"{held}, from {report.span_s[0]:.9g} s to {report.span_s[1]:.9g} s"


def _missing(report: RecoveryReport) -> list[str]:
    lines = []
    if not report.was_complete:
        lines.append(
            "missing: what had not reached the disk (of this simulator at most the last half "
            f"second), and {report.bytes_dropped} bytes at the end of the file"
        )
    if report.chunks_dropped:
        lines.append(f"missing: {report.chunks_dropped} damaged records inside the file")
    if report.original:
        lines.append(f"the file as it was is kept as {report.original}")
    return lines + [f"note: {note}" for note in report.notes]
