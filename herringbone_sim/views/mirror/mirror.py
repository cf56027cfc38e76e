"""The live mirror: blocks go into a bounded queue, a thread of its own hands them to Rerun.

Nothing here waits for a viewer: what does not fit is dropped and counted, what fails becomes
``state``, is reported, and is tried again. The Rerun package is imported by that thread, so that a
node without it, or with the mirror off, starts as fast as ever.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from queue import Empty, Full, Queue
from threading import Event, Thread
from time import monotonic
from typing import TYPE_CHECKING

from herringbone_sim.core.layout import Layout
from herringbone_sim.errors import ParameterError
from herringbone_sim.views.mirror.block import MirrorBlock, Scale

if TYPE_CHECKING:
    from herringbone_sim.views.mirror.sink import Sink
    from herringbone_sim.views.mirror.stream import RerunStream

MODES = ("off", "spawn", "connect", "serve", "save")
POLL_S = 0.1
RETRY_S = 2.0
LONGEST_RETRY_S = 60.0
# A failure that repeats is reported as often.
REPEAT_S = 10.0
FLUSH_S = 5.0


class RerunMirror:
    """A mirror of the motion in the Rerun viewer, never in the way of who feeds it.

    Args:
        mode: ``off``; ``spawn`` starts a viewer; ``connect`` sends to the viewer at ``address``
            and tries again every two seconds when none answers; ``serve`` waits for viewers at
            ``address``; ``save`` writes ``path``. What can't be opened is tried again, ever more
            rarely; a viewer that was started and is closed stays closed.
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
        report: is told each failure once, one that repeats every ``REPEAT_S`` seconds with how
            often it was; called in a thread of the mirror.

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
        report: Callable[[str], None] = lambda _: None,
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
        self._told = Told(report)
        # Whether blocks may wait: until it is open, and while it is.
        self._taking = True
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
            if self._taking:
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
        pause_s = RETRY_S
        while not self._attempt() and not self._closing.wait(pause_s):
            if self.mode != "connect":
                pause_s = min(2 * pause_s, LONGEST_RETRY_S)

    def _attempt(self) -> bool:
        """Mirror until it is closed or fails; whether there is nothing more to try."""
        opened = False
        try:
            from herringbone_sim.views.mirror.sink import open_sink

            sink = open_sink(self.mode, self.address, self._path, self._memory_limit)
            opened = True
            self._mirror(sink)
        except Exception as error:
            # Whatever a viewer does must not reach the integrator: this is the wall.
            self._stop(error)
            # To open a file again would empty it, and whoever closed a viewer wants none.
            return opened and self.mode in ("save", "spawn")
        return True

    def _mirror(self, sink: Sink) -> None:
        try:
            self.address, self._state, self._taking = sink.address, "running", True
            self._feed(sink)
        except Exception as error:
            # Letting go of a frozen viewer takes seconds: say so before.
            self._state = failure(error)
            raise
        finally:
            sink.close(FLUSH_S)

    def _feed(self, sink: Sink) -> None:
        stream = self._stream(sink)
        while True:
            try:
                block = self._queue.get(timeout=POLL_S)
            except Empty:
                if self._closing.is_set():
                    return
            else:
                stream = self._send(sink, stream, block)
            sink.deliver()

    def _send(self, sink: Sink, stream: RerunStream, block: MirrorBlock) -> RerunStream:
        """Draw a block; the stream for the next, a new one where this failed half way."""
        try:
            stream.send(block)
        except Exception as error:
            self.dropped += 1
            self._fail(error)
            return self._stream(sink)
        self._state = "running"
        return stream

    def _stream(self, sink: Sink) -> RerunStream:
        from herringbone_sim.views.mirror.stream import RerunStream

        return RerunStream(sink.recording, *self._drawing)

    def _fail(self, error: Exception) -> None:
        self._state = failure(error)
        self._told(self._state)

    def _stop(self, error: Exception) -> None:
        """Fail, and take no blocks until it is open again; those that wait are dropped."""
        self._taking = False
        self._fail(error)
        with suppress(Empty):
            while True:
                self._queue.get_nowait()
                self.dropped += 1


def failure(error: Exception) -> str:
    """State of a mirror that failed: the reason, and what to do where that is known."""
    missing = isinstance(error, ModuleNotFoundError)
    hint = ": install it with `pip install 'rerun-sdk==0.41.*'`" if missing else ""
    return f"failed: {error}{hint}"


class Told:
    """Hands failures on: each once, one that repeats every ``REPEAT_S`` seconds with its count.

    Args:
        report: takes a line of text.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._text = ""
        self._count = 0
        self._last_s = 0.0

    def __call__(self, text: str) -> None:
        new = text != self._text
        self._count = 1 if new else self._count + 1
        self._text = text
        if new or monotonic() - self._last_s >= REPEAT_S:
            self._last_s = monotonic()
            self._report(text if new else f"{text} ({self._count} times)")


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
