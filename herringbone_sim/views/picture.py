"""A picture with its caption, for a page."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Picture:
    """A PNG file and its caption."""

    path: Path
    caption: str

    @property
    def source(self) -> str:
        """The PNG file as a data URL, so that a page contains it and needs no separate file."""
        return f"data:image/png;base64,{base64.b64encode(self.path.read_bytes()).decode()}"
