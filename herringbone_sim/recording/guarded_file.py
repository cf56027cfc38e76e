"""Write a file and detect whether another program deleted, replaced, cut or moved it."""

from __future__ import annotations

import fcntl
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from herringbone_sim.recording.cdr import Buffer


class FileLostError(OSError):
    """Error: another program deleted, replaced, moved or cut a file that is being written.

    Attributes:
        where: present path of a moved, complete file, or a text if it is unknown; None for a
            file that is not complete.
        cut: whether the file is still at its path, but with another size than was written.
    """

    def __init__(self, what: str, where: str | None = None, cut: bool = False) -> None:
        super().__init__(what)
        self.where = where
        self.cut = cut


@dataclass(frozen=True)
class FileIdentity:
    """Path, device, inode and size of a file, to recognise it later."""

    path: Path
    device: int
    inode: int
    size: int

    def fault(self, folder: Path) -> str:
        """Return what happened to the file in ``folder``, as a predicate.

        Empty if device, inode and size are the same; a change of content alone is not seen.
        """
        path_stat = _named(folder / self.path.name)
        if path_stat is None:
            return "is no longer there"
        if (path_stat.st_dev, path_stat.st_ino) != (self.device, self.inode):
            return "was replaced by another file"
        if path_stat.st_size != self.size:
            return f"has {path_stat.st_size} of its {self.size} bytes"
        return ""


class GuardedFile:
    """A new unbuffered file that can be truncated to its last complete record.

    It is locked until it is closed, or its process ends, so that other programs can tell that it
    is being written. It is opened for appending, so a file that another program cut stays shorter
    than what was written.

    Attributes:
        position: number of bytes written.
        whole: bytes up to the end of the last complete record, set by the user of this class.
    """

    def __init__(self, path: Path) -> None:
        """Create ``path``; raises OSError, also if it exists."""
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
        """Append all bytes; return their number."""
        rest = memoryview(content)
        while rest:
            written = os.write(self.handle, rest)
            self.position += written
            rest = rest[written:]
        return len(content)

    def tell(self) -> int:
        """Number of bytes written."""
        return self.position

    def flush(self) -> None:
        """Write the file to the disk (fsync)."""
        os.fsync(self.handle)

    def rename(self, path: Path) -> None:
        """Rename the file to a path that must not exist."""
        if os.path.lexists(path):
            raise FileExistsError(f"{path} exists")
        os.rename(self.path, path)
        self.path = path

    def check(self) -> FileIdentity:
        """Return the identity; FileLostError if the path leads elsewhere or the size is wrong."""
        open_stat, path_stat = os.fstat(self.handle), _named(self.path)
        right_size = open_stat.st_size == self.position
        if path_stat is None or (path_stat.st_dev, path_stat.st_ino) != (
            open_stat.st_dev,
            open_stat.st_ino,
        ):
            if open_stat.st_nlink and right_size:
                raise FileLostError("was moved away", self._where(open_stat))
            raise FileLostError("was replaced by another file" if path_stat else "was deleted")
        if not right_size:
            sizes = f"{open_stat.st_size} bytes instead of {self.position}"
            raise FileLostError(f"was changed by another program: it has {sizes}", cut=True)
        return FileIdentity(self.path, open_stat.st_dev, open_stat.st_ino, open_stat.st_size)

    def _where(self, open_stat: os.stat_result) -> str:
        """Return the present path of the open file, or ``another name`` if it is unknown."""
        try:
            path = os.readlink(f"/proc/self/fd/{self.handle}")
            path_stat = os.stat(path)
        except OSError:
            return "another name"
        same = (path_stat.st_dev, path_stat.st_ino) == (open_stat.st_dev, open_stat.st_ino)
        return path if same else "another name"

    def cut(self) -> None:
        """Truncate the file after its last complete record."""
        if os.fstat(self.handle).st_size > self.whole:
            os.ftruncate(self.handle, self.whole)

    def close(self) -> None:
        handle, self.handle = self.handle, -1
        if handle >= 0:
            os.close(handle)


def is_written(path: Path) -> bool:
    """Whether a program holds a file open as a ``GuardedFile``; False if there is no such file."""
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
    """Return the stat result of a path without following links; None if it does not exist."""
    try:
        return os.stat(path, follow_symlinks=False)
    except (FileNotFoundError, NotADirectoryError):
        return None
