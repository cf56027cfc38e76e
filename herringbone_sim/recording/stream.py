"""A file while it is being written: whether what was written still lies under its name."""

from __future__ import annotations

import fcntl
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from herringbone_sim.recording.cdr import Buffer


class FileLostError(OSError):
    """A file whose name no longer leads to what was written.

    Attributes:
        where: path that leads to all that was written; None where nothing does.
        cut: whether the name leads to the file still, but not to all of it.
    """

    def __init__(self, what: str, where: str | None = None, cut: bool = False) -> None:
        super().__init__(what)
        self.where = where
        self.cut = cut


@dataclass(frozen=True)
class Written:
    """A file that was finished, to be known again."""

    path: Path
    device: int
    inode: int
    size: int

    def fault(self, folder: Path) -> str:
        """What became of it; empty where it lies in a folder as it was left."""
        found = _named(folder / self.path.name)
        if found is None:
            return "is no longer there"
        if (found.st_dev, found.st_ino) != (self.device, self.inode):
            return "was replaced by another file"
        if found.st_size != self.size:
            return f"has {found.st_size} of its {self.size} bytes"
        return ""


class Stream:
    """A new file, unbuffered, that can fall back to its last whole record.

    It is locked until it is closed, also by a kill, so that others know that it is being written.

    It is opened to append, so a file that is cut by others stays short of what was written,
    however much follows.
    """

    def __init__(self, path: Path) -> None:
        """Create ``path``; OSError, also where it exists."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC
        self.handle = -1
        self.handle = os.open(path, flags, 0o644)
        with suppress(OSError):  # some network file systems have no locks
            fcntl.flock(self.handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self.path = path
        self.position = 0
        self.whole = 0

    def __del__(self) -> None:
        self.close()

    def write(self, content: Buffer) -> int:
        rest = memoryview(content)
        while rest:
            written = os.write(self.handle, rest)
            self.position += written
            rest = rest[written:]
        return len(content)

    def tell(self) -> int:
        return self.position

    def flush(self) -> None:
        os.fsync(self.handle)

    def rename(self, path: Path) -> None:
        """Give the file another name, which must be free."""
        if os.path.lexists(path):
            raise FileExistsError(f"{path} exists")
        os.rename(self.path, path)
        self.path = path

    def check(self) -> Written:
        """The file as it is; FileLostError where its name leads elsewhere or it lost a byte."""
        held, found = os.fstat(self.handle), _named(self.path)
        whole = held.st_size == self.position
        if found is None or (found.st_dev, found.st_ino) != (held.st_dev, held.st_ino):
            if held.st_nlink and whole:
                raise FileLostError("was moved away", self._where(held))
            raise FileLostError("was replaced by another file" if found else "was deleted")
        if not whole:
            sizes = f"{held.st_size} bytes instead of {self.position}"
            raise FileLostError(f"was changed by another program: it has {sizes}", cut=True)
        return Written(self.path, held.st_dev, held.st_ino, held.st_size)

    def _where(self, held: os.stat_result) -> str:
        """Where the file lies now, as far as the system tells."""
        try:
            path = os.readlink(f"/proc/self/fd/{self.handle}")
            found = os.stat(path)
        except OSError:
            return "another name"
        same = (found.st_dev, found.st_ino) == (held.st_dev, held.st_ino)
        return path if same else "another name"

    def cut(self) -> None:
        """Cut the file behind its last whole record, where it is that long."""
        if os.fstat(self.handle).st_size > self.whole:
            os.ftruncate(self.handle, self.whole)

    def close(self) -> None:
        handle, self.handle = self.handle, -1
        if handle >= 0:
            os.close(handle)


def is_written(path: Path) -> bool:
    """Whether a program holds a file open as a ``Stream``; False where there is no such file."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(handle)
    return False


def _named(path: Path) -> os.stat_result | None:
    """What a path leads to, None where it leads nowhere."""
    try:
        return os.stat(path, follow_symlinks=False)
    except (FileNotFoundError, NotADirectoryError):
        return None
