"""Start and stop recordings of the node; a failing recording never ends the simulation."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from herringbone_sim.core.integrate import State
from herringbone_sim.core.model import Model
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.sensors import Clock
from herringbone_sim.errors import RecordingError
from herringbone_sim.ros.session import Limits, Outcome, Session, loss_summary
from herringbone_sim.runtime import Delivery

UNLIMITED = Limits()


class Recorder:
    """Starts and stops recordings, one at a time, each written by its own thread.

    Args:
        node_name: full name of the node, the prefix of its topics.
        decimate: selects the rows of a delivery that go to ``state``.
        warn: called with a text if a recording fails or loses samples.
    """

    def __init__(
        self,
        node_name: str,
        decimate: Callable[[Delivery], list[int]],
        warn: Callable[[str], None],
    ) -> None:
        self._node_name = node_name
        self._decimate = decimate
        self._warn = warn
        self._lock = threading.Lock()
        self._session: Session | None = None

    @property
    def path(self) -> Path | None:
        """Folder of the run being recorded; None without a recording."""
        session = self._session
        return session.path if session else None

    @property
    def samples(self) -> int:
        """Number of samples of the current recording on the disk; 0 without one."""
        session = self._session
        return session.samples_kept if session else 0

    @property
    def error(self) -> str:
        """Why the recording ended early, or which files were disturbed; empty if neither."""
        session = self._session
        if session is None or not (session.error or session.losses):
            return ""
        if session.error:
            return session.error
        said = f"a file of the recording was disturbed: {loss_summary(session.losses)}"
        return f"{said}; recording to {session.path}"

    def start(
        self,
        record_dir: Path,
        name: str,
        model: Model,
        state: State,
        actives: Sequence[Active] = (),
        clock: Clock | None = None,
        limits: Limits = UNLIMITED,
    ) -> Path:
        """Start a run that begins with the sample at ``state``; returns its absolute path.

        Raises:
            RecordingError: a recording is running, or the folder can't be created.
        """
        if self._session:
            raise RecordingError(f"already recording to {self.path}: call record/stop first")
        first = (model, state, actives, clock)
        self._session = Session(
            record_dir.absolute(), name, self._node_name, limits, first, self._decimate, self._warn
        )
        return self._session.path

    def put(self, delivery: Delivery) -> None:
        """Queue a delivery if recording; blocks if the disk is too slow, so no sample is lost."""
        with self._lock:
            if self._session:
                self._session.put(delivery)

    def stop(self) -> Outcome:
        """Finish the recording and return its outcome.

        Raises:
            RecordingError: none is running, or it ended early (what was written is kept).
        """
        with self._lock:
            session, self._session = self._session, None
        if session is None:
            raise RecordingError("no recording is running: call record/start first")
        return session.stop()

    def end(self) -> Outcome | RecordingError:
        """Like ``stop``, but returns the error instead of raising it."""
        try:
            return self.stop()
        except RecordingError as error:
            return error


def run_name(given: str, running: bool) -> str:
    """Name of the next run: ``given``, or ``run`` with the wall time appended.

    The time is also appended to ``given`` if a recording is running.
    """
    stamp = time.strftime("%Y-%m-%d_%H-%M-%S") + f"-{time.time_ns() // 10**6 % 1000:03d}"
    return given if given and not running else f"{given or 'run'}_{stamp}"
