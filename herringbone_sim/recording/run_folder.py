"""Check the name, channels and content of a run, and create its folder."""

from __future__ import annotations

import errno
import itertools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from herringbone_sim.errors import RecordingError


def check_name(name: str) -> None:
    """Raise RecordingError unless ``name`` is valid as the name of a single folder."""
    led_out = name in ("", ".", "..") or any(mark in name for mark in "/\\") or Path(name).drive
    if led_out or name != name.strip() or not name.isprintable():
        raise RecordingError(
            f"the name of a run must be that of one folder inside record_dir, got {name!r}: "
            "leave out separators, '..' and spaces at its ends"
        )


def check_channels(names: Sequence[str]) -> None:
    """Raise RecordingError unless the names are unique, have no commas and include ``t``."""
    odd = [name for name in names if not name.strip() or "," in name or name != name.strip()]
    if odd or "t" not in names or len(set(names)) != len(names):
        raise RecordingError(
            "channel names must be unique, without commas, and one must be 't', got "
            f"{', '.join(map(repr, names)) or 'none'}: mend the names"
        )


def channels_text(channels: Mapping[str, Any]) -> str:
    """Return the ``channels`` content as JSON; RecordingError if JSON can't represent it."""
    try:
        return json.dumps(channels, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise RecordingError(
            f"the content of channels must be plain JSON with finite numbers, got {error}: "
            "convert it before it is recorded"
        ) from error


def make_run_folder(record_dir: Path, name: str) -> Path:
    """Create the folder of a run and return its path.

    Raises:
        RecordingError: it exists, or can't be created.
    """
    folder = record_dir / name
    try:
        record_dir.mkdir(parents=True, exist_ok=True)
        folder.mkdir()
    except FileExistsError as error:
        what = f"the run {folder} exists" if folder.exists() else f"{record_dir} is not a folder"
        raise RecordingError(
            f"{what}: a recording never overwrites; choose another name or record_dir"
        ) from error
    except (OSError, ValueError) as error:
        raise RecordingError(
            f"can't create the run folder {folder} ({reason(error)}): choose a record_dir that "
            "can be written"
        ) from error
    return folder


def next_run(folder: Path) -> str:
    """Return the first free name for a run that continues ``folder``: NAME-2, NAME-3, ..."""
    names = (f"{folder.name}-{number}" for number in itertools.count(2))
    return next(name for name in names if not (folder.parent / name).exists())


def remedy(error: OSError) -> str:
    """Return advice to the user on an OSError that occurred in writing."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return "free the disk"
    where = error.filename2 or error.filename
    return f"see that {where} can be written" if where else "see that the disk can be written"


def reason(error: Exception) -> str:
    """Return the text of an error, or its class name if it has no text."""
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
