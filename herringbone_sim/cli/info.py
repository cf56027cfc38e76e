"""Show what a recorded run holds: its length, samples per second and per mesh cycle, operating
point, every parameter that was changed while it ran, missing samples, and whether the file is
whole. Takes runs of this simulator and of any rig with the same topics, finished or cut off,
without ROS.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from typing import Annotated

from herringbone_sim.cli.options import Run
from herringbone_sim.errors import listed, shown
from herringbone_sim.recording.info import OPERATING, Channel, RunInfo, recording_info
from herringbone_sim.recording.safe_json import plain_numbers
from herringbone_sim.views.tables.text import aligned

MAX_LINES = 10  # of each list
EXAMPLES = """\
python -m herringbone_sim run --ros-args -p record:=true -p record_name:=first
python -m herringbone_sim info runs/first
"""


def run(run: Run, /, *, json: Annotated[bool, "print JSON, for other programs"] = False) -> int:
    """Print the summary of a run, exit code 0; RecordingError if it can't be read."""
    info = recording_info(run)
    print(as_json(info) if json else as_page(info))
    return 0


def as_json(info: RunInfo) -> str:
    """Summary of a run as one JSON object; numbers that are not finite become null."""
    content = asdict(info) | {"path": str(info.path), "missing_samples": info.missing}
    return json.dumps(plain_numbers(content), indent=2, allow_nan=False)


def as_page(info: RunInfo) -> str:
    """Summary of a run as aligned text for the terminal, in titled blocks."""
    parts = [
        _pairs(_overview(info)),
        _titled("operating point", _operating(info)),
        _titled("parameter changes", _changes(info)),
        _titled("missing samples", _gaps(info)),
        _titled("channels", aligned(_channel_rows(info.channels))),
        _titled("notes", [f"- {note}" for note in info.notes]),
    ]
    return "\n\n".join(part for part in parts if part)


def _overview(info: RunInfo) -> list[tuple[str, str]]:
    origin = " ".join(word for word in (info.source, info.model, info.version) if word)
    span = f"{info.duration_s:.6g} s, from {info.t_first_s:.6g} s to {info.t_last_s:.6g} s"
    return [
        ("run", f"{info.name} ({info.path})"),
        ("recorded by", origin or "unknown"),
        *(
            [("effects", _printable(info.parameters["effects"]))]
            if info.parameters.get("effects")
            else []
        ),
        ("file", _state(info)),
        ("duration", span),
        ("samples", f"{info.n_samples} ({_counted(info)})"),
        ("sample rate", _number(info.sample_rate_hz, "Hz")),
        ("mesh frequency", _number(info.mesh_hz, "Hz")),
        ("samples a cycle", _number(info.samples_per_cycle, "")),
        ("size", f"{_size(info.bytes_on_disk)}, samples unpacked {_size(info.bytes_of_samples)}"),
    ]


def _state(info: RunInfo) -> str:
    if info.missing_files:
        return f"not whole: {listed([_printable(name) for name in info.missing_files])} is missing"
    return "finished" if info.complete else "cut off: 'recover' rebuilds its index"


def _counted(info: RunInfo) -> str:
    if info.missing_files:
        return "of the files that are there"
    if info.samples_counted is None:
        return "the writer left no count"
    same = info.samples_counted == info.n_samples
    return "as many as were written" if same else f"{info.samples_counted} were written"


def _number(value: float | None, unit: str) -> str:
    return "unknown" if value is None else f"{value:.6g} {unit}".rstrip()


def _size(count: int) -> str:
    return f"{count / 1e6:.3g} MB" if count >= 1e5 else f"{count} bytes"


def _operating(info: RunInfo) -> list[str]:
    rows = []
    for channel in info.channels:
        if channel.name in OPERATING and channel.minimum is not None:
            span = f"{channel.minimum:.6g}"
            span += "" if channel.constant else f" to {channel.maximum:.6g}"
            rows.append((channel.name, f"{span} {channel.unit}".rstrip(" -")))
    rows += [("Omega", shown(info.parameters["Omega"]))] if "Omega" in info.parameters else []
    return aligned(rows)


def _changes(info: RunInfo) -> list[str]:
    return _shortened(
        f"t = {change.t_s:.9g} s  {_printable(change.node)}  "
        + listed([f"{_printable(name)} = {shown(value)}" for name, value in change.values.items()])
        for change in info.changes
    )


def _printable(value: object) -> str:
    """The value if it is a printable text, else its representation."""
    return value if isinstance(value, str) and value.isprintable() else shown(value)


def _gaps(info: RunInfo) -> list[str]:
    return _shortened(
        f"{gap.missing} after t = {gap.t_s:.9g} s (sample {gap.index})" for gap in info.gaps
    )


def _shortened(lines: Iterable[str]) -> list[str]:
    every = list(lines)
    more = [f"... and {len(every) - MAX_LINES} more"] if len(every) > MAX_LINES else []
    return every[:MAX_LINES] + more


def _channel_rows(channels: tuple[Channel, ...]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("name", "unit", "minimum", "mean", "maximum")]
    for channel in channels:
        values = (channel.minimum, channel.mean, channel.maximum)
        rows.append((channel.name, channel.unit, *(_number(value, "") for value in values)))
    return rows


def _pairs(rows: list[tuple[str, str]]) -> str:
    return "\n".join(aligned(rows))


def _titled(title: str, lines: list[str]) -> str:
    return "\n".join([title, *(f"  {line}" for line in lines)]) if lines else ""
