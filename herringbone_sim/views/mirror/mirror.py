"""The live mirror: a bounded queue of blocks, and a thread that sends them to Rerun.

The caller never waits for a viewer: blocks that do not fit into the queue are dropped and counted;
a failure becomes ``state``, is reported, and the viewer is tried again. Rerun is imported in the
thread, so that a node without it, or with the mirror off, is not slowed down.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from queue import Empty, Full, Queue
from threading import Event, Thread
from time import monotonic
from typing import TYPE_CHECKING

from herringbone_sim.views.mirror.block import Drawing, MirrorBlock
from herringbone_sim.views.mirror.target import MirrorTarget

if TYPE_CHECKING:
    from herringbone_sim.views.mirror.sink import Sink
    from herringbone_sim.views.mirror.stream import RerunStream

POLL_S = 0.1
RETRY_S = 2.0
LONGEST_RETRY_S = 60.0
# Interval at which a failure that repeats is reported again.
REPEAT_S = 10.0
FLUSH_S = 5.0


class RerunMirror:
    """Mirror of the motion in the Rerun viewer, which does not delay its caller.

    With ``connect`` it tries again every two seconds when no viewer answers. Another target that
    can't be opened is tried again at growing intervals; a started viewer that the user closes is
    not started again.

    Args:
        target: viewer, server or file to send to.
        drawing: what is drawn of each block, and in which units.
        queue_blocks: size of the queue, 1 or more.
        report: called in the mirror's thread with each new failure, and with a repeated failure
            and its count at most every ``REPEAT_S`` seconds.

    Attributes:
        mode, address: of the target; when open, the address of the receiver.
        dropped: number of blocks that were not shown.
    """

    def __init__(
        self,
        target: MirrorTarget,
        drawing: Drawing,
        *,
        queue_blocks: int = 8,
        report: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.mode = target.mode
        self.dropped = 0
        self.address = target.address
        self._target = target
        self._drawing = drawing
        self._state = "off" if self.mode == "off" else "running"
        self._reporter = FailureReporter(report)
        # Blocks are queued until the target is open, and while it is.
        self._accepts_blocks = True
        self._queue: Queue[MirrorBlock] = Queue(maxsize=queue_blocks)
        self._closing = Event()
        self._thread = Thread(target=self._run, name="rerun-mirror", daemon=True)
        if self.mode != "off":
            self._thread.start()

    @property
    def state(self) -> str:
        """``off``, ``running`` or ``failed: reason``."""
        return self._state

    def put(self, block: MirrorBlock, *, wait_s: float = 0.0) -> bool:
        """Queue a block, waiting up to ``wait_s`` seconds for room.

        Returns:
            Whether it was queued. A block for which there is no room, or whose target could not be
            opened, counts in ``dropped``.
        """
        if self.mode == "off" or self._closing.is_set():
            return False
        with suppress(Full):
            if self._accepts_blocks:
                self._queue.put(block, block=wait_s > 0, timeout=wait_s or None)
                return True
        self.dropped += 1
        return False

    def close(self, timeout: float = 10.0) -> None:
        """Send the queued blocks and close the target, within ``timeout`` seconds at most."""
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
        """Mirror until closed or failed; return False if the target is to be opened again."""
        opened = False
        try:
            from herringbone_sim.views.mirror.sink import open_sink

            sink = open_sink(self._target)
            opened = True
            self._mirror(sink)
        except Exception as error:
            # A failure of the viewer must not reach the integrator.
            self._stop(error)
            # Opening a file again would empty it; a closed viewer was closed by the user.
            return opened and self.mode in ("save", "spawn")
        return True

    def _mirror(self, sink: Sink) -> None:
        try:
            self.address, self._state, self._accepts_blocks = sink.address, "running", True
            self._feed(sink)
        except Exception as error:
            # Set the state first: disconnecting from a frozen viewer takes seconds.
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
        """Send a block; return the stream for the next block, a new one after a failure."""
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

        return RerunStream(sink.recording, self._drawing)

    def _fail(self, error: Exception) -> None:
        self._state = failure(error)
        self._reporter(self._state)

    def _stop(self, error: Exception) -> None:
        """Report a failure and drop all blocks until the target is open again."""
        self._accepts_blocks = False
        self._fail(error)
        with suppress(Empty):
            while True:
                self._queue.get_nowait()
                self.dropped += 1


def failure(error: Exception) -> str:
    """Return the state of a failed mirror: the reason, and how to install a missing Rerun."""
    missing = isinstance(error, ModuleNotFoundError)
    hint = ": install it with `pip install 'rerun-sdk==0.41.*'`" if missing else ""
    return f"failed: {error}{hint}"


class FailureReporter:
    """Reports each new failure, and a repeated one with its count every ``REPEAT_S`` seconds.

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
