"""Keeps the compiler's cache true: compiled code is forgotten when the kernel has changed.

Numba looks only at the file of the function it loads, not at those that were compiled into it.
"""

from __future__ import annotations

import contextlib
import hashlib
from pathlib import Path

STAMP = "sources.sha256"


def forget_stale(package: Path, sources: Path) -> None:
    """Remove compiled code below a package unless the sources are those it was compiled from.

    Nothing happens where nothing can be written: an installed package does not change in place.
    """
    stamp = package / "__pycache__" / STAMP
    now = digest(sources)
    with contextlib.suppress(OSError):
        if stamp.is_file() and stamp.read_text() == now:
            return
        for index in package.rglob("__pycache__/*.nbi"):
            index.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(now)


def digest(sources: Path) -> str:
    """Of the names and contents of all Python files below a folder."""
    found = hashlib.sha256()
    for source in sorted(sources.rglob("*.py")):
        content = source.read_bytes()
        found.update(f"{source.relative_to(sources).as_posix()} {len(content)}\n".encode())
        found.update(content)
    return found.hexdigest()
