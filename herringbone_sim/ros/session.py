"""One recording of the node, written in a thread, with the counts of its samples."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, Queue
from typing import Any

from herringbone_sim.core.integrate import State
from herringbone_sim.core.layout import describe
from herringbone_sim.core.model import Model, by_kind
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.sensors import Clock
from herringbone_sim.errors import RecordingError, RecordingLostError
from herringbone_sim.recording.parameter_file import values_of_gear
from herringbone_sim.recording.run_folder import next_run
from herringbone_sim.recording.writer import RunWriter
from herringbone_sim.runtime import Delivery
from herringbone_sim.version import VERSION

QUEUE_BLOCKS = 256
FLUSH_S = 0.25
MOST_LISTED = 3  # losses that a line lists


def channels_content(
    model: Model, state: State, actives: Sequence[Active] = (), clock: Clock | None = None
) -> dict[str, Any]:
    """Content of the ``channels`` topic: everything needed to replay a run.

    Args:
        model: model in force at the first sample.
        state: state at the first sample.
        actives: effects of the gear and its sensors; stored with the parameters.
        clock: reading of the sensors' clock at the first sample; None: zero.
    """
    p = model.parameters
    return {
        "schema": "herringbone_sim/channels/1",
        "version": VERSION,
        "source": "simulator",
        "model": p.model,
        "channels": [describe(name) for name in model.layout.channels],
        "parameters": values_of_gear(p, actives),
        "omega_n": model.scales.omega_n,
        "half_backlash": half_backlash(model),
        "integrator": {"method": p.method, "order": p.order, "steps_per_cycle": p.steps},
        "samples_per_cycle": p.samples_per_cycle,
        "state": {
            "y": state.y.tolist(),
            "cycle": state.cycle,
            "index": state.index,
            "t": state.t,
        },
        "clock": vars(clock or Clock()).copy(),
    }


def content_of(delivery: Delivery) -> dict[str, Any]:
    """Content of the ``channels`` topic at the first sample of a delivery."""
    state = delivery.block.start
    return channels_content(delivery.model, state, delivery.actives, delivery.clock)


def half_backlash(model: Model) -> dict[str, float]:
    """Half-backlash b' [m] of the first mesh of each kind, ``sp`` and ``rp``."""
    return by_kind(model.half_backlash_m)


@dataclass(frozen=True)
class Limits:
    """Limits of a file, at which a recording goes on in its next file; 0 for none.

    Attributes:
        size_mb: size of a file [10^6 bytes].
        span_s: simulation time in a file [s].
    """

    size_mb: float = 0.0
    span_s: float = 0.0

    def reached(self, writer: RunWriter, t_s: float) -> bool:
        """Whether the sample at t_s [s] goes to the next file; false for the first of a file."""
        span_s = t_s - writer.file_first_s
        large = 0.0 < self.size_mb <= writer.file_bytes / 1e6
        return not math.isnan(span_s) and (large or 0.0 < self.span_s <= span_s)


@dataclass(frozen=True)
class Outcome:
    """Result of a recording.

    Attributes:
        path: folder of the last run that it wrote.
        written: number of samples on the disk.
        offered: number of samples that were to be recorded.
        losses: a sentence on each file that other programs deleted, replaced, cut or moved.
    """

    path: Path
    written: int
    offered: int
    losses: tuple[str, ...] = ()

    @property
    def lost(self) -> int:
        """Number of samples that are not on the disk."""
        return self.offered - self.written

    def __str__(self) -> str:
        said = f" ({loss_summary(self.losses)})" if self.losses else ""
        return f"{self.written} samples written, {self.lost} lost{said}, to {self.path}"


def loss_summary(losses: Sequence[str]) -> str:
    """The losses in one line: the last three and the number of those before."""
    more = [f"{len(losses) - MOST_LISTED} before that"] if len(losses) > MOST_LISTED else []
    return "; ".join([*losses[-MOST_LISTED:], *more])


class Session:
    """Writes deliveries to a run in a thread; continues in a new run if its file is lost.

    Args:
        record_dir: folder that contains the run folders.
        name: name of the run.
        node_name: full name of the node, the prefix of its topics.
        limits: limits of each file.
        first: model, state, effects and clock at the first sample.
        decimate: selects the rows of a delivery that go to ``state``.
        warn: called with a text if the recording fails or loses samples.

    Attributes:
        offered: number of samples that were to be recorded.
        error: why the recording ended early; empty if it did not.

    Raises:
        RecordingError: the run can't be created.
    """

    def __init__(
        self,
        record_dir: Path,
        name: str,
        node_name: str,
        limits: Limits,
        first: tuple[Model, State, Sequence[Active], Clock | None],
        decimate: Callable[[Delivery], list[int]],
        warn: Callable[[str], None],
    ) -> None:
        self._record_dir = record_dir
        self._name = name
        self._node_name = node_name
        self._limits = limits
        self._decimate = decimate
        self._warn = warn
        self._queue: Queue[Delivery | None] = Queue(QUEUE_BLOCKS)
        self.offered, self.error, self._reported = 0, "", 0
        model, state, _, _ = first
        self._start_ns = time.time_ns() - round(state.t * 1e9)
        self._vanished = False
        self._runs = [self._create(name, model, channels_content(*first), state.t)]
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def _create(self, name: str, model: Model, content: dict[str, Any], t_s: float) -> RunWriter:
        """Create a run folder and return its writer."""
        names, start = model.layout.channels, self._start_ns
        return RunWriter.create(
            self._record_dir, name, self._node_name, content, names, start, t_s
        )

    @property
    def path(self) -> Path:
        """Folder of the run that is being written."""
        return self._runs[-1].path

    @property
    def samples_kept(self) -> int:
        """Number of samples known to be on the disk."""
        return sum(run.samples_kept for run in self._runs)

    @property
    def losses(self) -> tuple[str, ...]:
        """A sentence on each file that other programs deleted, replaced, cut or moved."""
        return tuple(loss for run in self._runs for loss in run.losses)

    def put(self, delivery: Delivery) -> None:
        """Queue a delivery; blocks if the disk is too slow, so that no sample is lost."""
        self.offered += len(delivery.block.rows)
        if not self.error:
            self._queue.put(delivery)

    def stop(self) -> Outcome:
        """Write what is still queued, close the last file and return the counts of the recording.

        Raises:
            RecordingError: the recording had ended early; what was written is kept.
        """
        self._queue.put(None)
        self._thread.join()
        outcome = Outcome(self.path, self.samples_kept, self.offered, self.losses)
        if self.error:
            raise RecordingError(f"{self.error}; {outcome}")
        return outcome

    def _run(self) -> None:
        """Thread: write deliveries and flush every quarter of a second until the end."""
        flushed, ended = time.monotonic(), False
        while not ended:
            delivery, ended = self._next()
            try:
                if time.monotonic() - flushed >= FLUSH_S and not (self.error or self._vanished):
                    flushed = time.monotonic()
                    self._runs[-1].flush()
            except Exception as error:
                self._fail(error)
            try:
                if delivery is not None and not self.error:
                    self._take(delivery)
                if ended:
                    self._runs[-1].close({"samples_offered": str(self.offered)})
            except Exception as error:
                self._fail(error)
            self._report_losses()

    def _next(self) -> tuple[Delivery | None, bool]:
        """Next delivery, None if none in ``FLUSH_S``; whether ``stop`` was called, all taken."""
        try:
            delivery = self._queue.get(timeout=FLUSH_S)
        except Empty:
            return None, False
        return delivery, delivery is None

    def _fail(self, error: Exception) -> None:
        """Record that the recording has failed; for a lost file, only that a new run is needed."""
        if isinstance(error, RecordingLostError):
            self._vanished = True
            return
        said = str(error) if isinstance(error, RecordingError) else repr(error)
        self.error = self.error or said
        self._warn(f"the recording ended: {said}; the simulation goes on")

    def _report_losses(self) -> None:
        """Warn of the losses since the last call."""
        losses = self.losses
        for loss in losses[self._reported :]:
            self._warn(f"a file of the recording was disturbed: {loss}")
        self._reported = len(losses)

    def _take(self, delivery: Delivery) -> None:
        """Choose the file for a delivery, and write it."""
        if len(delivery.block.rows):
            self._open_for(delivery)
        self._write(delivery)

    def _open_for(self, delivery: Delivery) -> None:
        """Begin a new file if a delivery needs one.

        The next file of the run if the present one has reached a limit; the first file of a new
        run if the present one was lost.
        """
        t_s = float(delivery.block.rows[0, 0])
        try:
            if not self._vanished and self._limits.reached(self._runs[-1], t_s):
                self._runs[-1].next_file(content_of(delivery), t_s)
        except RecordingLostError:
            self._vanished = True
        if self._vanished:
            name = next_run(self._record_dir / self._name)
            self._runs.append(self._create(name, delivery.model, content_of(delivery), t_s))
            self._vanished = False
            self._warn(f"recording goes on in {self.path}")

    def _write(self, delivery: Delivery) -> None:
        """Write changes and samples of a delivery, and the decimated rows as mesh states."""
        block, layout, writer = delivery.block, delivery.model.layout, self._runs[-1]
        now = time.time_ns()
        for change in delivery.changes:
            values = dict(change.values)
            writer.write_parameter_event(change.t_s, self._node_name, values, now)
        writer.write_samples(block.rows, now)
        n = layout.n_mesh
        for i in self._decimate(delivery):
            row = block.rows[i]
            x, v, force = row[5 : 5 + n], row[5 + n : 5 + 2 * n], row[5 + 2 * n : 5 + 3 * n]
            writer.write_state(float(row[0]), layout.meshes, x, v, force, now)
