"""Find the MCAP files of a run in order, and check that they lie in its folder."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from herringbone_sim.errors import RecordingError, listed, shown
from herringbone_sim.recording.bag import METADATA_NAME, MISSING_KEY
from herringbone_sim.recording.safe_yaml import YamlError, read_yaml

NUMBERED = re.compile(r"(.*)_([0-9]{1,9})\.mcap")


@dataclass(frozen=True)
class BagInformation:
    """Content of ``metadata.yaml`` of a run folder, compared with the files in the folder.

    Attributes:
        n_messages: stated number of messages in all files; None if missing.
        names: names of the listed files that exist, in order.
        missing: names of files of the run that do not exist.
        unlisted: files in the folder that are named like those of the run but not listed.
        compression_mode: rosbag2's compression mode in lower case, such as ``none`` or ``file``.
        up_to_date: whether its lists of existing and of missing files agree with the folder.
        notes: a sentence on each fault of ``metadata.yaml`` itself.
    """

    n_messages: int | None = None
    names: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    unlisted: tuple[str, ...] = ()
    compression_mode: str = "none"
    up_to_date: bool = False
    notes: tuple[str, ...] = ()

    @property
    def file_notes(self) -> list[str]:
        """Sentences on missing files, and on unlisted files, which are not read."""
        notes = []
        if self.missing:
            notes.append(
                f"{METADATA_NAME} names {_names(self.missing)}, which is not there: the run is "
                "read without"
            )
        if self.unlisted:
            notes.append(
                f"{METADATA_NAME} does not name {_names(self.unlisted)}, which is not read: if it "
                f"is of this run, move {METADATA_NAME} away and call 'python -m herringbone_sim "
                "recover'"
            )
        return notes


def _names(names: Sequence[str]) -> str:
    """Join file names for a message, each shortened if it is long."""
    return listed([_shortly(name) for name in names])


def bag_information(folder: Path) -> BagInformation:
    """Read ``metadata.yaml`` of a folder; an invalid part is left empty and noted, not raised."""
    try:
        content = read_yaml(folder / METADATA_NAME).get("rosbag2_bagfile_information")
    except FileNotFoundError:
        return _unread("is missing: 'python -m herringbone_sim recover' writes it")
    except (OSError, YamlError):
        content = None
    if not isinstance(content, dict):
        return _unread("can't be read: 'python -m herringbone_sim recover' writes it anew")
    return _checked(folder, content)


def _unread(what: str) -> BagInformation:
    """Return empty information with a note on a ``metadata.yaml`` that can't be used."""
    return BagInformation(notes=(f"{METADATA_NAME} {what}",))


def _checked(folder: Path, content: Mapping[Any, Any]) -> BagInformation:
    """Check a parsed ``metadata.yaml`` against the files in its folder."""
    notes = []
    count = content.get("message_count")
    if not isinstance(count, int) or isinstance(count, bool):
        count = None
    listing, lost = _texts(content.get("relative_file_paths")), _lost(content)
    names = [*listing, *lost]
    outside = [name for name in names if not _is_inside(folder, folder / name)]
    if outside:
        notes.append(
            f"{METADATA_NAME} names files outside of the folder, which are not read: "
            f"{listed([shown(name) for name in outside])}"
        )
        names = []
    once, twice = _distinct(folder, names)
    if twice:
        notes.append(f"{METADATA_NAME} names {_names(twice)} twice: it is read once")
    ordered = sorted(once, key=natural) if lost else once
    there = [name for name in ordered if os.path.isfile(folder / name)]
    missing = [name for name in ordered if not os.path.isfile(folder / name)] if there else []
    if names and not there:
        notes.append(f"{METADATA_NAME} is not of this run: it names {_names(once)}")
    mode = content.get("compression_mode") or "none"
    return BagInformation(
        count,
        tuple(there),
        tuple(missing),
        _unlisted(folder, there),
        str(mode).lower(),
        (listing, lost) == (there, missing),
        tuple(notes),
    )


def _texts(value: Any) -> list[str]:
    """Return a value that is a list of strings; an empty list for anything else."""
    good = isinstance(value, list) and all(isinstance(entry, str) for entry in value)
    return list(value) if good else []


def _distinct(folder: Path, names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the names of distinct files, and the names that lead to a file named before."""
    name_by_path: dict[str, str] = {}
    twice = []
    for name in names:
        if name_by_path.setdefault(os.path.realpath(folder / name), name) is not name:
            twice.append(name)
    return list(name_by_path.values()), twice


def _lost(content: Mapping[Any, Any]) -> list[str]:
    """Return the names of the files that were missing when the run was recovered."""
    custom = content.get("custom_data")
    listed_names = custom.get(MISSING_KEY) if isinstance(custom, dict) else None
    return listed_names.split("\n") if isinstance(listed_names, str) and listed_names else []


def _unlisted(folder: Path, names: Sequence[str]) -> tuple[str, ...]:
    """Return files named like those of the run, NAME_0.mcap, that are not in ``names``."""
    runs = {numbered[1] for name in names if (numbered := NUMBERED.fullmatch(name))}
    known = set(names)
    mcap_files = sorted(folder.glob("*.mcap"), key=lambda file: natural(file.name)) if runs else []
    return tuple(
        file.name
        for file in mcap_files
        if file.name not in known
        and (numbered := NUMBERED.fullmatch(file.name))
        and numbered[1] in runs
    )


def readable_bag(path: Path) -> BagInformation:
    """Like ``bag_information``, for a run folder, or a file by the ``metadata.yaml`` beside it.

    The information is empty if that ``metadata.yaml`` does not name the file.

    Raises:
        RecordingError: the bag is compressed outside of its MCAP chunks.
    """
    folder = path if path.is_dir() else path.parent
    information = bag_information(folder)
    known = path == folder or path.name in information.names
    if not known and os.path.lexists(folder / METADATA_NAME):
        return BagInformation()
    mode = information.compression_mode
    if mode not in ("none", "storage"):
        raise RecordingError(
            f"a run must be compressed inside its MCAP chunks, {folder} has the compression mode "
            f"{shown(mode)}: rewrite it with 'ros2 bag convert'"
        )
    return information


def check_file(path: Path) -> bool:
    """Return whether a path is a regular file (True) or a folder (False).

    A pipe or a device is never opened: reading could block or change it.

    Raises:
        RecordingError: the path is neither, does not exist, or can't be examined.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        raise RecordingError(
            f"there is no {_shortly(path)}: name a run folder or a .mcap file"
        ) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise RecordingError(
            f"can't open {_shortly(path)} ({reason}): name a run folder or a .mcap file"
        ) from error
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise RecordingError(
            f"a recording must be a file, {_shortly(path)} is a pipe, a socket or a device: name "
            "a run folder or a .mcap file"
        )
    return stat.S_ISREG(mode)


def _shortly(path: Path | str) -> str:
    """Return a path for a message, shortened if its name is long or not printable."""
    text = str(path)
    return text if text.isprintable() and len(Path(path).name) < 100 else shown(text)


def bag_files(path: Path | str) -> list[Path]:
    """Return the .mcap files of a run folder in order; for a path to a file, that file alone.

    They are those that ``metadata.yaml`` lists, else all in the folder, ordered by number.

    Raises:
        RecordingError: no such path, no .mcap file in it, or a link that leads out of the folder.
    """
    path = Path(path)
    if check_file(path):
        return [path]
    files = [path / name for name in bag_information(path).names]
    files = files or sorted(path.glob("*.mcap"), key=lambda file: natural(file.name))
    if not files:
        runs = sorted(file.parent.name for file in path.glob("*/*.mcap"))
        hint = f"name one of its runs, as {path / runs[0]}" if runs else "name another folder"
        raise RecordingError(f"a run folder must hold a .mcap file, {path} has none: {hint}")
    for file in files:
        if not _is_inside(path, file):
            raise RecordingError(
                f"the files of a run must lie in its folder, {file} leads out of it, to "
                f"{os.path.realpath(file)}: move that file there, or name it"
            )
    return files


def _is_inside(folder: Path, file: Path) -> bool:
    """Whether a file lies in a folder after all links are resolved."""
    try:
        return file.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):
        return False


def natural(name: str) -> list[int]:
    """Return the numbers in a name, as a sort key that puts 10 after 9."""
    return [int(digits) for digits in re.findall(r"\d+", name)]
