"""The live mirror: blocks go into a bounded queue, a thread of its own hands them to Rerun.

Nothing here waits for a viewer: what does not fit is dropped and counted, what fails becomes
``state``. The Rerun package is imported by that thread, so that a node without it, or with the
mirror off, starts as fast as ever.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from queue import Empty, Full, Queue
from threading import Event, Thread
from typing import TYPE_CHECKING

from herringbone_sim.core.layout import Layout
from herringbone_sim.errors import ParameterError
from herringbone_sim.views.mirror_block import MirrorBlock, Scale

if TYPE_CHECKING:
    from herringbone_sim.views.rerun_sink import Sink
    from herringbone_sim.views.rerun_stream import RerunStream

MODES = ("off", "spawn", "connect", "serve", "save")
POLL_S = 0.1
RETRY_S = 2.0
FLUSH_S = 5.0


class RerunMirror:
    """A mirror of the motion in the Rerun viewer, never in the way of who feeds it.

    Args:
        mode: ``off``; ``spawn`` starts a viewer; ``connect`` sends to the viewer at ``address``
            and tries again every two seconds when none answers; ``serve`` waits for viewers at
            the port in ``address``; ``save`` writes ``path``.
        layout: names of the meshes.
        address: ``HOST:PORT``, ``PORT`` or ``rerun+http://HOST:PORT/proxy``; empty for Rerun's
            own 127.0.0.1:9876.
        path: the .rrd file to write.
        memory_limit: beyond this a spawned viewer or a server forgets the oldest, as ``1GB``.
        scale: units and backlash; without it displacements are in micrometres and there is no
            contact state.
        burst_cycles: mesh cycles at the end of each block that are shown at full rate.
        queue_blocks: blocks that may wait.
        mesh: the mesh of the phase plane, the first of the layout when empty.

    Raises:
        ParameterError: an unknown mode or mesh, ``save`` without a path, a size below 1.
    """

    def __init__(
        self,
        mode: str,
        layout: Layout,
        *,
        address: str = "",
        path: Path | None = None,
        memory_limit: str = "1GB",
        scale: Scale | None = None,
        burst_cycles: int = 20,
        queue_blocks: int = 8,
        mesh: str = "",
    ) -> None:
        check_options(mode, path, burst_cycles, queue_blocks)
        if mesh and mesh not in layout.meshes:
            raise ParameterError(
                f"mesh must be one of {', '.join(layout.meshes)}, got {mesh!r}: choose one of them"
            )
        self.mode = mode
        self.dropped = 0
        self.address = address
        self._path = path
        self._memory_limit = memory_limit
        self._drawing = (layout, scale, burst_cycles, mesh)
        self._state = "off" if mode == "off" else "running"
        self._queue: Queue[MirrorBlock] = Queue(maxsize=queue_blocks)
        self._closing = Event()
        self._thread = Thread(target=self._run, name="rerun-mirror", daemon=True)
        if mode != "off":
            self._thread.start()

    @property
    def state(self) -> str:
        """``off``, ``running`` or ``failed: reason``."""
        return self._state

    def put(self, block: MirrorBlock, *, wait_s: float = 0.0) -> bool:
        """Hand in a block; whether it was taken. Returns at once unless ``wait_s`` is given."""
        if self.mode == "off" or self._closing.is_set():
            return False
        with suppress(Full):
            if self._state == "running":
                self._queue.put(block, block=wait_s > 0, timeout=wait_s or None)
                return True
        self.dropped += 1
        return False

    def close(self, timeout: float = 10.0) -> None:
        """Send what waits, finish the file or the connection, wait at most ``timeout`` seconds."""
        self._closing.set()
        if self.mode == "off":
            return
        self._thread.join(timeout)
        if self._thread.is_alive():
            self._state = f"failed: the viewer did not take the rest within {timeout:g} s"
        elif self._state == "running":
            self._state = "off"

    def _run(self) -> None:
        while True:
            try:
                self._mirror()
                return
            except Exception as error:
                # Whatever a viewer does must not reach the integrator: this is the wall.
                self._fail(error)
            if self.mode != "connect" or self._closing.wait(RETRY_S):
                return

    def _mirror(self) -> None:
        from herringbone_sim.views.rerun_sink import open_sink
        from herringbone_sim.views.rerun_stream import RerunStream

        sink = open_sink(self.mode, self.address, self._path, self._memory_limit)
        try:
            self.address = sink.address
            self._state = "running"
            self._feed(sink, RerunStream(sink.recording, *self._drawing))
        except Exception as error:
            # Letting go of a frozen viewer takes seconds: say so before.
            self._fail(error)
            raise
        finally:
            sink.close(FLUSH_S)

    def _feed(self, sink: Sink, stream: RerunStream) -> None:
        while True:
            try:
                stream.send(self._queue.get(timeout=POLL_S))
            except Empty:
                if self._closing.is_set():
                    return
            sink.deliver()

    def _fail(self, error: Exception) -> None:
        missing = isinstance(error, ModuleNotFoundError)
        hint = ": install it with `pip install 'rerun-sdk==0.41.*'`" if missing else ""
        self._state = f"failed: {error}{hint}"
        with suppress(Empty):
            while True:
                self._queue.get_nowait()
                self.dropped += 1


def check_options(mode: str, path: Path | None, burst_cycles: int, queue_blocks: int) -> None:
    """Refuse what no mirror can do; raises ParameterError."""
    if mode not in MODES:
        raise ParameterError(
            f"the mirror's mode must be one of {', '.join(MODES)}, got {mode!r}: choose one"
        )
    if mode == "save" and path is None:
        raise ParameterError("mode 'save' needs a path, got none: name the .rrd file to write")
    for name, value in (("burst_cycles", burst_cycles), ("queue_blocks", queue_blocks)):
        if value < 1:
            raise ParameterError(f"{name} must be at least 1, got {value}: choose a larger one")
