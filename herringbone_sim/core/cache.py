"""Delete cached compiled code whose sources have changed.

Numba checks only the file of the function that it loads, not those of the functions inlined into
it or called by it.
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
ROOMS = (  # folders with compiled functions or their constants
    *("core", "analysis", "dynamics", "sweeps", "effects"),
    *("gap/verification", "practice"),
)


def forget_stale(package: Path, *sources: Path) -> None:
    """Delete the cached compiled code of a package unless it comes from the present sources.

    The cache is in the folders ``__pycache__``, or below ``NUMBA_CACHE_DIR`` if that is set. Does
    nothing in a folder that can't be written: an installed package does not change in place.

    Args:
        package: folder of the package.
        sources: folders with all Python files that the compiled code depends on.
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
def on_compiling(call: Callable[[], None]) -> Iterator[None]:
    """Context in which ``call`` is called when Numba starts to compile, not when it loads code."""
    with event.install_listener("numba:compile", _OnStart(call)):
        yield


def compiled_from(package: Path) -> list[Path]:
    """Return the ``ROOMS`` of a package: folders of what is compiled into other functions."""
    return [package / room for room in ROOMS if (package / room).is_dir()]


def digest(*sources: Path) -> str:
    """Return the SHA-256, hexadecimal, of names and contents of all Python files in folders."""
    hasher = hashlib.sha256()
    for folder in sources:
        for source in sorted(folder.rglob("*.py")):
            content = source.read_bytes()
            hasher.update(f"{source.relative_to(folder).as_posix()} {len(content)}\n".encode())
            hasher.update(content)
    return hasher.hexdigest()


def _forget(folder: Path, indices: Iterable[Path], now: str) -> None:
    """Delete cache indices and renew the stamp file in a folder, unless it is ``now`` already."""
    stamp = folder / STAMP
    with contextlib.suppress(OSError):
        if stamp.is_file() and stamp.read_text() == now:
            return
        for index in indices:
            index.unlink(missing_ok=True)
        folder.mkdir(parents=True, exist_ok=True)
        stamp.write_text(now)


def _name(folder: Path) -> str:
    """Return the name that Numba gives a source folder below ``NUMBA_CACHE_DIR``."""
    path = str(folder.absolute())
    return f"{folder.name}_{hashlib.sha1(path.encode()).hexdigest()}"
