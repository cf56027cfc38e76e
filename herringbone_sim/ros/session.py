"""One recording of the node, from its start to its end: every block, and the truth about them."""

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
from herringbone_sim.core.model import Model
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
TOLD = 3  # losses that one line tells


def channels_content(
    model: Model, state: State, actives: Sequence[Active] = (), clock: Clock | None = None
) -> dict[str, Any]:
    """Content of the ``channels`` topic: all that a run can be repeated from.

    Args:
        state: at the first sample.
        actives: effects of the gear and its sensors; they stand with the parameters.
        clock: how that of the sensors stands.
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
        "half_backlash": {
            kind: float(model.half_backlash_m[i * model.layout.n_mesh // 2])
            for i, kind in enumerate(("sp", "rp"))
        },
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


@dataclass(frozen=True)
class Limits:
    """When a file is large enough for the next one to begin; 0 is never.

    Attributes:
        size_mb: megabytes, of 10^6 bytes.
        span_s: simulation time [s].
    """

    size_mb: float = 0.0
    span_s: float = 0.0

    def reached(self, writer: RunWriter, t_s: float) -> bool:
        """Whether the sample at t_s [s] belongs in the next file; not in one without samples."""
        span_s = t_s - writer.file_first_s
        large = 0.0 < self.size_mb <= writer.file_bytes / 1e6
        return not math.isnan(span_s) and (large or 0.0 < self.span_s <= span_s)


@dataclass(frozen=True)
class Outcome:
    """What became of a recording.

    Attributes:
        path: folder of its last run.
        written: samples that lie on the disk.
        offered: samples that there were to record.
        losses: a sentence on each file that others deleted, replaced, cut or moved away.
    """

    path: Path
    written: int
    offered: int
    losses: tuple[str, ...] = ()

    @property
    def lost(self) -> int:
        """Samples that lie nowhere on the disk."""
        return self.offered - self.written

    def __str__(self) -> str:
        said = f" ({told(self.losses)})" if self.losses else ""
        return f"{self.written} samples written, {self.lost} lost{said}, to {self.path}"


def told(losses: Sequence[str]) -> str:
    """The losses in one line, of many the last ones."""
    more = [f"{len(losses) - TOLD} before that"] if len(losses) > TOLD else []
    return "; ".join([*losses[-TOLD:], *more])


@dataclass(frozen=True)
class Place:
    """Where a recording is written, and how.

    Attributes:
        record_dir: folder of the runs.
        name: of the run.
        node_name: full name of the node, the prefix of its topics.
        limits: of each file.
    """

    record_dir: Path
    name: str
    node_name: str
    limits: Limits


class Session:
    """Writes deliveries to a run in a thread of its own, and goes on in another where it vanishes.

    Args:
        place: where to.
        first: what the first sample comes from: model, state, effects, clock.
        decimate: picks the rows of a delivery that go to ``state``.
        warn: called with a text when the recording fails or loses something.

    Attributes:
        offered: samples that there were to record.
        error: why it ended early; empty while it goes on.

    Raises:
        RecordingError: the run can't be made.
    """

    def __init__(
        self,
        place: Place,
        first: tuple[Model, State, Sequence[Active], Clock | None],
        decimate: Callable[[Delivery], list[int]],
        warn: Callable[[str], None],
    ) -> None:
        self._place = place
        self._decimate = decimate
        self._warn = warn
        self._queue: Queue[Delivery | None] = Queue(QUEUE_BLOCKS)
        self.offered, self.error, self._told = 0, "", 0
        model, state, _, _ = first
        self._start_ns = time.time_ns() - round(state.t * 1e9)
        self._vanished = False
        self._runs = [self._create(place.name, model, channels_content(*first), state.t)]
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def _create(self, name: str, model: Model, content: dict[str, Any], t_s: float) -> RunWriter:
        place, names = self._place, model.layout.channels
        start = self._start_ns
        return RunWriter.create(
            place.record_dir, name, place.node_name, content, names, start, t_s
        )

    @property
    def path(self) -> Path:
        """Folder of the run that is written now."""
        return self._runs[-1].path

    @property
    def kept(self) -> int:
        """Samples known to lie on the disk."""
        return sum(run.samples_kept for run in self._runs)

    @property
    def losses(self) -> tuple[str, ...]:
        """A sentence on each file that others deleted, replaced, cut or moved away."""
        return tuple(loss for run in self._runs for loss in run.losses)

    def put(self, delivery: Delivery) -> None:
        """Take a delivery; waits when the disk is slower than the motion, so none is lost."""
        self.offered += len(delivery.block.rows)
        if not self.error:
            self._queue.put(delivery)

    def stop(self) -> Outcome:
        """Finish the run.

        Raises:
            RecordingError: it had ended early; what was written is kept.
        """
        self._queue.put(None)
        self._thread.join()
        outcome = Outcome(self.path, self.kept, self.offered, self.losses)
        if self.error:
            raise RecordingError(f"{self.error}; {outcome}")
        return outcome

    def _run(self) -> None:
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
            self._tell()

    def _next(self) -> tuple[Delivery | None, bool]:
        """The next delivery, if there is one in time, and whether it was the last."""
        try:
            delivery = self._queue.get(timeout=FLUSH_S)
        except Empty:
            return None, False
        return delivery, delivery is None

    def _fail(self, error: Exception) -> None:
        if isinstance(error, RecordingLostError):
            self._vanished = True
            return
        said = str(error) if isinstance(error, RecordingError) else repr(error)
        self.error = self.error or said
        self._warn(f"the recording ended: {said}; the simulation goes on")

    def _tell(self) -> None:
        """Log what is lost since the last time."""
        losses = self.losses
        for loss in losses[self._told :]:
            self._warn(f"a file of the recording was disturbed: {loss}")
        self._told = len(losses)

    def _take(self, delivery: Delivery) -> None:
        if len(delivery.block.rows):
            self._open_for(delivery)
        self._write(delivery)

    def _open_for(self, delivery: Delivery) -> None:
        """A file for the delivery: the one that is open, the next one, or one of a new run."""
        t_s = float(delivery.block.rows[0, 0])
        try:
            if not self._vanished and self._place.limits.reached(self._runs[-1], t_s):
                self._runs[-1].next_file(_content(delivery), t_s)
        except RecordingLostError:
            self._vanished = True
        if self._vanished:
            name = next_run(self._place.record_dir / self._place.name)
            self._runs.append(self._create(name, delivery.model, _content(delivery), t_s))
            self._vanished = False
            self._warn(f"recording goes on in {self.path}")

    def _write(self, delivery: Delivery) -> None:
        block, layout, writer = delivery.block, delivery.model.layout, self._runs[-1]
        now = time.time_ns()
        for change in delivery.changes:
            values = dict(change.values)
            writer.write_parameter_event(change.t_s, self._place.node_name, values, now)
        writer.write_samples(block.rows, now)
        n = layout.n_mesh
        for i in self._decimate(delivery):
            row = block.rows[i]
            x, v, force = row[5 : 5 + n], row[5 + n : 5 + 2 * n], row[5 + 2 * n : 5 + 3 * n]
            writer.write_state(float(row[0]), layout.meshes, x, v, force, now)


def _content(delivery: Delivery) -> dict[str, Any]:
    """Content of the ``channels`` topic at the first sample of a delivery."""
    state = delivery.block.start
    return channels_content(delivery.model, state, delivery.actives, delivery.clock)
