"""Parse and check the spec of an import; errors name the entry, the rule, value and remedy."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.errors import HerringboneError, RecordingError, listed, shown
from herringbone_sim.recording.campaign import (
    MOST_OF_A_NAME,
    POINT,
    ROLES,
    noise_share,
    sensor_values,
)
from herringbone_sim.recording.importing.entry import Entry
from herringbone_sim.recording.importing.spec import (
    ChannelSpec,
    FileSpec,
    ImportSpec,
    RunSpec,
    TimeSpec,
    recorded_name,
)
from herringbone_sim.recording.importing.units import channel_names, si_unit
from herringbone_sim.recording.parameter_file import load_parameters
from herringbone_sim.recording.run_folder import check_name
from herringbone_sim.recording.safe_yaml import YamlError, read_yaml

KINDS = {
    "csv": (".csv", ".txt", ".tsv"),
    "parquet": (".parquet",),
    "mat": (".mat",),
    "tdms": (".tdms",),
    "hdf5": (".h5", ".hdf5"),
    "rosbag2": ("", ".mcap", ".db3"),
}
OPTIONS = {"delimiter": ",", "decimal": ".", "encoding": "utf8", "skip": 0, "skip_after_names": 0}
SHAFTS = ("angle_c", "angle_s_L", "angle_s_R")
UNITS_OF_POINT = {"delta_T": "K", "K": "-", "T_1": "N m", "Omega": "-"}
OWN_FILES = ("campaign.yaml", "nominal.yaml", "import.html")  # that an import writes beside runs
FILE = ("path", "kind", "time", "channels", "resample", "options")


def read_spec(file: Path) -> ImportSpec:
    """Read and check a spec; the data files must exist but are not opened.

    Raises:
        RecordingError: no such spec, or an invalid entry; the message begins with the file.
    """
    try:
        return _spec(file.parent, read_yaml(file))
    except YamlError as error:
        raise RecordingError(f"{file}: {error}: mend it") from None
    except HerringboneError as error:
        raise RecordingError(f"{file}: {error}") from None
    except OSError as error:
        raise RecordingError(f"can't read {file}: {error.strerror}: name a spec") from error


def _spec(folder: Path, content: Any) -> ImportSpec:
    """Check the parsed YAML of a spec in ``folder``."""
    known = ("rig", "nominal", "phase", "files", "runs", "noise", "sensors")
    top = Entry(content, "", known)
    rig = top.text("rig")
    if len(rig) > MOST_OF_A_NAME:
        raise top.wrong("rig", f"a text of at most {MOST_OF_A_NAME} characters", rig)
    nominal = load_parameters(folder / top.text("nominal")) if "nominal" in top else Parameters()
    nominal = nominal.changed({"model": "full"})
    shaft, offset = _phase(top.take("phase"))
    names = channel_names(nominal.layout)
    runs = tuple(
        _run(folder, top, content_of_run, f"runs[{i}]", names)
        for i, content_of_run in enumerate(top.entries("runs"))
    )
    twice = {run.name for run in runs if sum(run.name == other.name for other in runs) > 1}
    if twice:
        raise top.wrong("runs", "runs with names of their own", sorted(twice)[0])
    for run in runs:
        _check_filled(run, shaft)
    noise, sensors = top.take("noise"), top.take("sensors")
    # Checked before a run is read; both go to campaign.yaml as they stand.
    noise_share("the spec", noise)
    foreign = [name for name in sensor_values("the spec", sensors) if name not in names]
    if foreign:
        near = difflib.get_close_matches(foreign[0], names, 1) or names[:1]
        raise top.wrong(
            "sensors", "of channels of the rig", foreign[0], f"did you mean {near[0]}?"
        )
    return ImportSpec(rig, nominal, shaft, offset, runs, noise, sensors)


def _phase(value: Any) -> tuple[str, float]:
    """Return the shaft that gives the mesh phase, empty for none; its phase [rad] at angle 0."""
    if value is None:
        return "", 0.0
    entry = Entry(value, "phase", ("angle", "offset"))
    return entry.choice("angle", SHAFTS), entry.quantity("offset", "rad", 0.0)


def _check_filled(run: RunSpec, shaft: str) -> None:
    """Raise RecordingError unless the mesh phase is given, and each channel only once."""
    named = [channel.name for file in run.files for channel in file.channels]
    if (shaft or "phase") not in named:
        raise RecordingError(
            f"{run.name} must have a channel {shaft or 'phase'}, got {listed(sorted(named))}: "
            "name the column of the mesh phase, or in `phase: {angle: ...}` a shaft of which it "
            f"is made ({listed(SHAFTS)})"
        )
    filled = [recorded_name(name) for name in named] + (["phase"] if shaft else [])
    twice = [name for name in filled if filled.count(name) > 1]
    if twice:
        raise RecordingError(
            f"the files of {run.name} must fill each channel once, got {twice[0]} twice (an angle "
            "becomes a rotation u, that of `phase` the phase too): leave one out"
        )


def _run(folder: Path, top: Entry, value: Any, where: str, names: Sequence[str]) -> RunSpec:
    """Parse the run at the path ``where``; ``names`` are the channels that it may have."""
    entry = Entry(value, where, ("name", "role", *POINT, "files"))
    name = entry.text("name")
    if name in OWN_FILES:
        raise entry.wrong("name", f"none of the files of a campaign, {', '.join(OWN_FILES)}", name)
    try:
        check_name(name)
    except RecordingError:
        raise entry.wrong("name", "the name of one folder", name) from None
    files = entry if "files" in entry else top
    place = f"{where}.files" if "files" in entry else "files"
    point = {key: entry.quantity(key, UNITS_OF_POINT[key]) for key in POINT}
    file_specs = tuple(
        _file(folder, Entry(content, f"{place}[{i}]", FILE), name, names)
        for i, content in enumerate(files.entries("files"))
    )
    return RunSpec(name, entry.choice("role", ROLES), point, file_specs)


def _file(folder: Path, entry: Entry, run: str, names: Sequence[str]) -> FileSpec:
    """Parse the spec entry of one file of a run; ``names``: channels that a run may have."""
    path = folder / entry.text("path").replace("{run}", run)
    if not path.exists():
        raise entry.wrong("path", "a file beside the spec", str(path), "no such file")
    suffix = "" if path.is_dir() else path.suffix.lower()
    by_suffix = next((k for k, ends in KINDS.items() if suffix in ends), None)
    kind = entry.choice("kind", tuple(KINDS), by_suffix)
    channels = entry.need("channels", "a mapping of channels to columns")
    if not isinstance(channels, dict) or not channels:
        raise entry.wrong("channels", "a mapping of channels to columns", channels)
    place = f"{entry.where}.channels"
    channel_specs = tuple(
        _channel(name, column, place, names)
        for many, value in channels.items()
        for name, column in _expanded(str(many), value, place, names)
    )
    resample = entry.choice("resample", (False, True), False)
    time = _time(entry.take("time"), f"{entry.where}.time", kind)
    return FileSpec(path, kind, time, channel_specs, resample, _options(entry, kind))


def _options(entry: Entry, kind: str) -> Mapping[str, Any]:
    """Return the options of a csv file; another kind may have none."""
    given = Entry(entry.take("options", {}), f"{entry.where}.options", tuple(OPTIONS))
    if kind != "csv" and "options" in entry:
        raise entry.wrong("options", "left out, as only csv has options", kind)
    options = {name: given.take(name, default) for name, default in OPTIONS.items()}
    for name, default in OPTIONS.items():
        value = options[name]
        if isinstance(default, int) and not (type(value) is int and value >= 0):
            raise given.wrong(name, "a count of lines", value)
        if name in ("delimiter", "decimal") and not (isinstance(value, str) and len(value) == 1):
            raise given.wrong(name, "one character", value)
    given.text("encoding", "utf8")
    return options


def _expanded(name: str, value: Any, place: str, names: Sequence[str]) -> list[tuple[str, Any]]:
    """Expand a channel name with a star to (name, value) of each channel that it matches.

    The star in the column stands for the same text; a name without a star is returned unchanged.
    ``F_*: {column: force *, unit: kN}`` is the force of every mesh; pins are ``F_pin*``.
    """
    head, star, tail = name.partition("*")
    column = value.get("column") if isinstance(value, dict) else None
    if not star or not isinstance(column, str):
        return [(name, value)]
    if "*" not in column:
        raise RecordingError(
            f"{place}: the column of {shown(name)} must have a star, too, got {shown(column)}: "
            "each channel has a column of its own"
        )
    long = len(head) + len(tail)
    candidates = [n for n in names if n.startswith("F_pin") == head.startswith("F_pin")]
    fit = [n for n in candidates if n.startswith(head) and n.endswith(tail) and len(n) > long]
    stood = [n[len(head) : len(n) - len(tail)] for n in fit]
    expanded = [
        (n, value | {"column": column.replace("*", s)}) for n, s in zip(fit, stood, strict=True)
    ]
    return expanded or [(name, value)]


def _channel(name: str, value: Any, where: str, names: Sequence[str]) -> ChannelSpec:
    """Parse one channel: its column, unit and linear conversion to SI."""
    if name not in names:
        near = difflib.get_close_matches(name, names, 3) or names[:3]
        raise RecordingError(
            f"{where} must name channels of the rig, got {shown(name)}: did you mean "
            f"{listed(near)}?"
        )
    entry = Entry(value, f"{where}.{name}", ("column", "unit", "scale", "sign", "offset"))
    si = si_unit(name)
    unit, size = entry.text("unit"), entry.factor("unit", si)
    scale = entry.quantity("scale", "-", 1.0)
    if scale == 0.0:
        raise entry.wrong("scale", "a number that is not 0", scale)
    gain = entry.choice("sign", (1, -1), 1) * scale * size
    turn = 2.0 * math.pi / size if name.startswith("angle_") and abs(scale) != 1.0 else None
    offset = entry.quantity("offset", si, 0.0)
    return ChannelSpec(name, entry.text("column"), unit, gain, offset, turn)


def _time(value: Any, where: str, kind: str) -> TimeSpec:
    """Parse the clock of a file of the given kind."""
    own = kind in ("tdms", "rosbag2")
    entry = Entry(value or {}, where, ("column", "unit", "rate", "start", "trigger_offset"))
    named = ("column" in entry) + ("rate" in entry)
    if named > 1 or (named == 0 and not own):
        raise entry.wrong("", "a column or a rate, one of them", value)
    for key, of in (("unit", "column"), ("start", "rate")):
        if key in entry and of not in entry:
            do = "write trigger_offset" if key == "start" else "leave it out"
            raise entry.wrong(key, f"beside a {of}", entry.take(key), do)
    trigger = entry.quantity("trigger_offset", "s", 0.0)
    if "rate" in entry:
        rate = entry.quantity("rate", "Hz")
        if not rate > 0.0:
            raise entry.wrong("rate", "above 0 Hz", rate)
        start = entry.quantity("start", "s", 0.0)
        return TimeSpec(None, 1.0, rate, start, trigger)
    if "column" not in entry:
        return TimeSpec(trigger_offset_s=trigger)
    size = entry.factor("unit", "s") if "unit" in entry else 1.0
    return TimeSpec(entry.text("column"), size, trigger_offset_s=trigger)
