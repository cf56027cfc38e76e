"""Folders for results, and files that appear under their name only when written completely."""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from herringbone_sim.errors import AnalysisError


def make_folder(folder: Path) -> Path:
    """Create a folder if it is missing and return it; AnalysisError if it can't be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise AnalysisError(
            f"the output folder must be one that can be written, got {folder} "
            f"({error.strerror}): choose another --out"
        ) from None
    return folder


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Context with a temporary binary file that replaces ``path`` when it is written completely.

    If the block raises, it is removed and ``path`` stays as it was.
    """
    partial = path.with_suffix(f".{os.getpid()}-{threading.get_ident()}.partial")
    try:
        with partial.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
