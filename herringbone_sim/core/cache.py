"""Keeps the compiler's cache true: compiled code is forgotten when its sources have changed.

Numba looks only at the file of the function it loads, not at those that were compiled into it.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from numba import config

from herringbone_sim.core.numba_private import event

STAMP = "sources.sha256"
ROOMS = (  # of functions and their constants
    *("core", "analysis", "dynamics", "sweeps", "effects"),
    *("gap/verification", "practice"),
)


def forget_stale(package: Path, *sources: Path) -> None:
    """Remove compiled code of a package unless the sources are those it was compiled from.

    It lies in the folders ``__pycache__``, or below ``NUMBA_CACHE_DIR`` where that is set. Nothing
    happens where nothing can be written: an installed package does not change in place.
    """
    now = digest(*sources)
    _forget(package / "__pycache__", package.rglob("__pycache__/*.nbi"), now)
    if config.CACHE_DIR:
        folders = sorted({source.parent for source in package.rglob("*.py")} | {package})
        places = [Path(config.CACHE_DIR) / _name(folder) for folder in folders]
        indices = (index for place in places for index in place.glob("*.nbi"))
        _forget(Path(config.CACHE_DIR) / _name(package), indices, now)


class _OnStart(event.Listener):  # type: ignore[misc]
    def __init__(self, tell: Callable[[], None]) -> None:
        self._tell = tell

    def on_start(self, event: Any) -> None:
        self._tell()

    def on_end(self, event: Any) -> None:
        pass


@contextlib.contextmanager
def told_of_compiling(tell: Callable[[], None]) -> Iterator[None]:
    """Call ``tell`` as soon as a function is compiled within the block, and at each further one.

    A function that is loaded from the cache is not told of.
    """
    with event.install_listener("numba:compile", _OnStart(tell)):
        yield


def compiled_from(package: Path) -> list[Path]:
    """Folders whose sources are compiled, or give constants to what is."""
    return [package / room for room in ROOMS if (package / room).is_dir()]


def digest(*sources: Path) -> str:
    """Of the names and contents of all Python files below some folders."""
    found = hashlib.sha256()
    for folder in sources:
        for source in sorted(folder.rglob("*.py")):
            content = source.read_bytes()
            found.update(f"{source.relative_to(folder).as_posix()} {len(content)}\n".encode())
            found.update(content)
    return found.hexdigest()


def _forget(folder: Path, indices: Iterable[Path], now: str) -> None:
    """Remove indices unless the stamp in a folder is that of now; then stamp it."""
    stamp = folder / STAMP
    with contextlib.suppress(OSError):
        if stamp.is_file() and stamp.read_text() == now:
            return
        for index in indices:
            index.unlink(missing_ok=True)
        folder.mkdir(parents=True, exist_ok=True)
        stamp.write_text(now)


def _name(folder: Path) -> str:
    """What Numba calls a folder of sources below ``NUMBA_CACHE_DIR``."""
    path = str(folder.absolute())
    return f"{folder.name}_{hashlib.sha1(path.encode()).hexdigest()}"
