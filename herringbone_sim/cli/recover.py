"""Repair a run whose recording was cut off by a kill, a power cut or a full disk: keep every whole
message, rebuild the index and metadata.yaml, so that ROS tools open it, and print what is
missing. The cut file stays beside it as NAME_0.mcap.cut if anything in it had to be left
out. A finished run is left as it is.
"""

from __future__ import annotations

from typing import Annotated

from herringbone_sim.cli.options import Folder, Run
from herringbone_sim.errors import listed
from herringbone_sim.recording.recover import RecoveryReport, recover

EXAMPLES = """\
python -m herringbone_sim run --ros-args -p record:=true -p record_name:=first
python -m herringbone_sim recover runs/first
"""


def run(
    run: Run,
    /,
    *,
    out: Annotated[Folder | None, "new folder; without it the run itself is repaired"] = None,
) -> int:
    """Recover a run and print the result; exit code 1 if it holds no samples.

    Raises:
        RecordingError: the run can't be recovered.
    """
    report = recover(run, out)
    print(as_text(report))
    return 0 if report.samples else 1


def as_text(report: RecoveryReport) -> str:
    """Text of a recovery report, one sentence per line."""
    return "\n".join([_verdict(report), _content(report), *_missing(report)])


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


def _content(report: RecoveryReport) -> str:
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
