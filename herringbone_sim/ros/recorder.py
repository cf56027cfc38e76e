"""The recorder's thread: takes every block, loses none, and never ends the simulation."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from queue import Empty, Queue
from typing import Any

from herringbone_sim.core.integrate import State
from herringbone_sim.core.layout import describe
from herringbone_sim.core.model import Model
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.sensors import Clock
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.parameter_file import values_of_gear
from herringbone_sim.recording.writer import RunWriter
from herringbone_sim.runtime import Delivery
from herringbone_sim.version import VERSION

QUEUE_BLOCKS = 256
FLUSH_S = 0.25


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


class Recorder:
    """Writes deliveries to a run in a thread of its own.

    Args:
        node_name: full name of the node, the prefix of its topics.
        decimate: picks the rows of a delivery that go to ``state``.
        warn: called with a text when a recording fails.
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
        self._queue: Queue[Delivery | None] = Queue(QUEUE_BLOCKS)
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._writer: RunWriter | None = None
        self.error = ""
        self.offered = 0

    @property
    def path(self) -> Path | None:
        """Folder of the run that is being recorded, or None."""
        return self._writer.path if self._writer else None

    @property
    def samples(self) -> int:
        """Samples written to the run so far."""
        return self._writer.samples_written if self._writer else 0

    def start(
        self,
        record_dir: Path,
        name: str,
        model: Model,
        state: State,
        actives: Sequence[Active] = (),
        clock: Clock | None = None,
    ) -> Path:
        """Open a run that begins with the sample at ``state``; returns its absolute path.

        Raises:
            RecordingError: one is running already, or the folder can't be made.
        """
        if self._writer:
            raise RecordingError(
                f"already recording to {self._writer.path}: call record/stop first"
            )
        writer = RunWriter.create(
            record_dir,
            name,
            self._node_name,
            channels_content(model, state, actives, clock),
            model.layout.channels,
            time.time_ns() - round(state.t * 1e9),
        )
        self._writer, self.error, self.offered = writer, "", 0
        self._thread = threading.Thread(
            target=self._run, args=(writer,), name="recorder", daemon=True
        )
        self._thread.start()
        return writer.path

    def put(self, delivery: Delivery) -> None:
        """Take a delivery; waits when the disk is slower than the motion, so none is lost."""
        with self._lock:
            if self._writer and not self.error:
                self.offered += len(delivery.block.rows)
                self._queue.put(delivery)

    def stop(self) -> tuple[Path, int, int]:
        """Finish the run: its path, the samples written, the samples offered.

        Raises:
            RecordingError: none is running, or it failed (what was written is kept).
        """
        with self._lock:
            writer, thread = self._writer, self._thread
            if not writer or not thread:
                raise RecordingError("no recording is running: call record/start first")
            self._writer, self._thread = None, None
            self._queue.put(None)
        thread.join()
        if self.error:
            error, self.error = self.error, ""
            raise RecordingError(f"{error} (kept: {writer.path})")
        return writer.path, writer.samples_written, self.offered

    def _run(self, writer: RunWriter) -> None:
        flushed = time.monotonic()
        while True:
            try:
                delivery = self._queue.get(timeout=FLUSH_S)
            except Empty:
                delivery = None
                ended = False
            else:
                ended = delivery is None
            try:
                if delivery is not None and not self.error:
                    self._write(writer, delivery)
                if time.monotonic() - flushed >= FLUSH_S and not self.error:
                    writer.flush()
                    flushed = time.monotonic()
                if ended:
                    writer.close({"samples_offered": str(self.offered)})
            except Exception as error:
                self.error = str(error) if isinstance(error, RecordingError) else repr(error)
                self._warn(f"the recording ended: {self.error}; the simulation goes on")
            if ended:
                return

    def _write(self, writer: RunWriter, delivery: Delivery) -> None:
        block, layout = delivery.block, delivery.model.layout
        now = time.time_ns()
        for change in delivery.changes:
            writer.write_parameter_event(change.t_s, self._node_name, dict(change.values), now)
        writer.write_samples(block.rows, now)
        n = layout.n_mesh
        for i in self._decimate(delivery):
            row = block.rows[i]
            x, v, force = row[5 : 5 + n], row[5 + n : 5 + 2 * n], row[5 + 2 * n : 5 + 3 * n]
            writer.write_state(float(row[0]), layout.meshes, x, v, force, now)
