"""Target of a mirror: a viewer, a server or a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from herringbone_sim.errors import ParameterError

MODES = ("off", "spawn", "connect", "serve", "save")


@dataclass(frozen=True)
class MirrorTarget:
    """Viewer, server or file to which a mirror sends.

    Attributes:
        mode: ``off``; ``spawn`` starts a viewer; ``connect`` sends to the viewer at ``address``;
            ``serve`` waits for viewers at ``address``; ``save`` writes ``path``.
        address: ``HOST:PORT``, ``PORT`` or ``rerun+http://HOST:PORT/proxy``; empty for Rerun's
            default 127.0.0.1:9876.
        path: the .rrd file that ``save`` writes.
        memory_limit: size above which a started viewer or server drops its oldest data.

    Raises:
        ParameterError: an unknown mode, or ``save`` without a path.
    """

    mode: str
    address: str = ""
    path: Path | None = None
    memory_limit: str = "1GB"

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise ParameterError(
                f"the mirror's mode must be one of {', '.join(MODES)}, got {self.mode!r}: "
                "choose one"
            )
        if self.mode == "save" and self.path is None:
            raise ParameterError("mode 'save' needs a path, got none: name the .rrd file to write")
