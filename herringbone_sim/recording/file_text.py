"""Read an untrusted text file: a regular file of limited length in UTF-8."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path


def file_text(path: Path, most_bytes: int, wrong: type[Exception], prefix: str) -> str:
    """Return the text of a file; pipes and devices are refused, as reading them could block.

    Raises:
        OSError: no such file, unreadable, or not a regular file.
        wrong: it has more than ``most_bytes`` bytes, or is not UTF-8; with ``prefix`` before it.
    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with open(handle, "rb") as stream:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise OSError(errno.EINVAL, "it is not a file", str(path))
        content = stream.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise wrong(f"{prefix}it must have {most_bytes} bytes at most, and has more")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise wrong(f"{prefix}{error.reason} at byte {error.start}, not UTF-8") from None
