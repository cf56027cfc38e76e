"""Arrays that took long to make, kept in a folder: what was done before is read, not done again.

Each is a file named by the digest of all that it hangs on, so work that was stopped goes on where
it was, and what other parameters or another kernel gave is never mistaken for it. It ends in the
checksum of its content, which is not looked at where that fails.
"""

from __future__ import annotations

import errno
import functools
import hashlib
import io
import json
import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from tqdm import tqdm

from herringbone_sim.core import cache
from herringbone_sim.errors import AnalysisError
from herringbone_sim.version import VERSION

Arrays = dict[str, Any]

CHECKSUM_BYTES = hashlib.sha256().digest_size


@dataclass(frozen=True)
class Kept:
    """Arrays by the digest of their parts; may be used by threads and processes side by side.

    Attributes:
        folder: made when it is new; None keeps nothing.

    Raises:
        AnalysisError: the folder can't be written.
    """

    folder: Path | None = None

    def __post_init__(self) -> None:
        if self.folder:
            make_folder(self.folder)

    def once(self, parts: Sequence[Any], work: Callable[[], Mapping[str, Any]]) -> Arrays:
        """Arrays by name: read where they are kept and whole, else made and kept.

        A file whose checksum fails is named on stderr.

        Args:
            parts: all that the arrays hang on, see ``digest``.
            work: makes them.
        """
        path = self.folder / f"{digest(parts)}.npz" if self.folder else None
        known = _read(path) if path else None
        if known is not None:
            return known
        made: Arrays = {name: np.asarray(values) for name, values in work().items()}
        if path:
            packed = io.BytesIO()
            np.savez(packed, **made)
            with whole(path) as file:
                file.write(packed.getvalue() + hashlib.sha256(packed.getvalue()).digest())
        return made


def digest(parts: Sequence[Any]) -> str:
    """Name for what is made of parts: of them, of this version and of the sources of the kernel.

    Args:
        parts: plain values, arrays, and dataclasses or sequences of them.
    """
    text = json.dumps([VERSION, _sources(), *parts], default=_plain, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def make_folder(folder: Path) -> Path:
    """The folder, made when it is new; AnalysisError where that can't be."""
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
def whole(path: Path) -> Iterator[BinaryIO]:
    """A file beside ``path`` to write to; it takes that name when all is written, or never."""
    partial = path.with_suffix(f".{os.getpid()}-{threading.get_ident()}.partial")
    try:
        with partial.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def _read(path: Path) -> Arrays | None:
    """Arrays of a file; None when there is none, or a damaged one, which is told."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    packed, checksum = content[:-CHECKSUM_BYTES], content[-CHECKSUM_BYTES:]
    if hashlib.sha256(packed).digest() != checksum:
        told(f"{path} is damaged (its checksum fails): what it held is computed again")
        return None
    with np.load(io.BytesIO(packed)) as file:
        return {name: file[name] for name in file.files}


def told(text: str) -> None:
    """Say something on stderr, above a progress bar where there is one."""
    tqdm.write(text, file=sys.stderr)


@functools.cache
def _sources() -> tuple[str, ...]:
    """Of the kernel, and of what is told of its runs here and by the analysis."""
    package = Path(__file__).parents[1]
    return tuple(
        cache.digest(package / room) for room in ("core", "analysis", "effects", "sweeps")
    )


def _plain(part: Any) -> Any:
    if isinstance(part, np.ndarray):
        return [str(part.dtype), part.shape, hashlib.sha256(part.tobytes()).hexdigest()]
    return vars(part)
