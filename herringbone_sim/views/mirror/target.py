"""Target of a mirror: a viewer, a server or a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class MirrorTarget:
    """Viewer, server or file to which a mirror sends.

    Attributes:
        mode: ``off``; ``spawn`` starts a viewer; ``connect`` sends to the viewer at ``address``;
            ``serve`` waits for viewers at ``address``; ``save`` writes ``path``.
        address: ``HOST:PORT``, ``PORT`` or ``rerun+http://HOST:PORT/proxy``; empty for Rerun's
            default 127.0.0.1:9876.
        path: the .rrd file that ``save`` writes, which needs one.
        memory_limit: size above which a started viewer or server drops its oldest data.
    """

    mode: str
    address: str = ""
    path: Path | None = None
    memory_limit: str = "1GB"
