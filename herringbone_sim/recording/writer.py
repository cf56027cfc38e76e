"""Record a run as a bag that survives a kill, a full disk, and deletion of its files by others.

The caller, in one thread, passes blocks of samples, states and parameter changes, calls ``flush``
at least every half second, ``next_file`` when a file is large enough, and ``close`` at the end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.bag import Topic
from herringbone_sim.recording.cdr import Buffer
from herringbone_sim.recording.messages import (
    ParameterEvent,
    Value,
    encode_joint_state,
    encode_parameter_event,
    encode_samples,
    encode_string,
)
from herringbone_sim.recording.run_files import RECORD_NAME, RunFiles
from herringbone_sim.recording.run_folder import (
    channels_text,
    check_channels,
    check_name,
    make_run_folder,
    reason,
)
from herringbone_sim.recording.schemas import (
    FLOAT64_MULTI_ARRAY,
    JOINT_STATE,
    PARAMETER_EVENT,
    STRING,
    qos_profile,
)

__all__ = ["RECORD_NAME", "RunWriter", "encode_samples", "split_rows", "stamp_ns"]

SAMPLES, STATE, EVENTS = 1, 2, 3  # index of each topic in a file; 0 is channels
MESSAGE_LIMIT = 64_000


def stamp_ns(t_s: float) -> int:
    """Convert a time [s] to nanoseconds, rounded."""
    return round(t_s * 1e9)


def split_rows(n: int, names: Sequence[str]) -> list[slice]:
    """Split the rows of a block (n, c) into slices whose messages have at most 64000 bytes.

    Args:
        n: number of samples in the block.
        names: of the c channels.

    Raises:
        RecordingError: not even one sample fits.
    """
    head = 64 + len(",".join(names).encode())
    most = (MESSAGE_LIMIT - head) // (8 * len(names))
    if most < 1:
        raise RecordingError(
            f"a sample must fit into a message of {MESSAGE_LIMIT} bytes, got {len(names)} "
            "channels: record fewer channels"
        )
    return [slice(start, min(start + most, n)) for start in range(0, n, most)]


class RunWriter(RunFiles):
    """Writer of one run, made by ``RunWriter.create``.

    The first disk failure raises RecordingError, truncates the file after its last complete record
    and ends the recording: what was written stays readable, every later write raises
    RecordingError, and ``close`` does nothing. If another program deletes, replaces, cuts or moves
    the current file, the recording ends likewise, with RecordingLostError.

    Attributes:
        path: absolute path of the run folder.
        losses: a sentence on each file that another program deleted, replaced, cut or moved.
            Finished files are checked at each ``flush``; their loss raises nothing.
    """

    def __init__(
        self, path: Path, topics: Sequence[Topic], channel_names: tuple[str, ...], start_ns: int
    ) -> None:
        super().__init__(path, topics)
        self._names = channel_names
        self._start_ns = start_ns

    @classmethod
    def create(
        cls,
        record_dir: Path,
        name: str,
        topic_prefix: str,
        channels: Mapping[str, Any],
        channel_names: tuple[str, ...],
        start_ns: int,
        t_s: float = 0.0,
    ) -> RunWriter:
        """Create ``record_dir/name/name_0.mcap`` and write the ``channels`` message into it.

        Args:
            record_dir: folder of the runs, created if missing.
            name: name of the run.
            topic_prefix: full name of the node, such as ``/herringbone_sim``.
            channels: content of the ``channels`` topic, written as JSON.
            channel_names: names of the c columns of a block; one is ``t``.
            start_ns: wall time [ns] of t = 0.
            t_s: time [s] of the first sample.

        Raises:
            RecordingError: a name that exists or leads out of ``record_dir``, invalid channel
                names, or a folder that can't be written.
        """
        check_name(name)
        check_channels(channel_names)
        split_rows(1, channel_names)
        text = channels_text(channels)
        prefix = f"/{topic_prefix.strip('/')}" if topic_prefix.strip("/") else ""
        folder = make_run_folder(Path(record_dir).absolute(), name)
        writer = cls(folder, _topics(prefix), channel_names, start_ns)
        try:
            writer._open(writer._log_ns(t_s), encode_string(text))
        except OSError as error:
            with suppress(OSError):
                folder.rmdir()
            raise RecordingError(
                f"can't create a file in {folder} ({reason(error)}): choose a record_dir that "
                "can be written"
            ) from error
        return writer

    def write_samples(self, block: Array, publish_ns: int | None = None) -> None:
        """Write a block (n, c) of samples, split into messages of at most 64 kB.

        Args:
            block: samples, columns as ``channel_names``.
            publish_ns: publish time [ns]; None: the log time of each message.

        Raises:
            RecordingError: a wrong shape, a time that is not finite, a failing disk, or a
                recording that has ended.
        """
        if block.ndim != 2 or block.shape[1] != len(self._names):
            raise RecordingError(
                f"a block must have the shape (n, {len(self._names)}), got {block.shape}: hand "
                "in one row a sample and one column a channel"
            )
        times = block[:, self._names.index("t")]
        for rows in split_rows(len(block), self._names):
            message, first_s = encode_samples(self._names, block[rows]), float(times[rows.start])
            self._write(SAMPLES, first_s, message, publish_ns)
            self._counts[-1].add(rows.stop - rows.start, first_s, float(times[rows.stop - 1]))

    def write_state(
        self,
        t_s: float,
        names: tuple[str, ...],
        position: Array,
        velocity: Array,
        effort: Array,
        publish_ns: int | None = None,
    ) -> None:
        """Write a sensor_msgs/JointState of m meshes to the topic ``state`` of the run.

        Args:
            t_s: simulation time [s]; gives the stamp and the log time.
            names: (m,) meshes.
            position, velocity, effort: (m,) displacement [m], its rate [m/s], and force [N].
            publish_ns: publish time of the message, wall time [ns]; None: that of ``t_s``.

        Raises:
            RecordingError: a time that is not finite, an array not as long as ``names``, a disk
                that fails, or a recording that has ended.
        """
        message = encode_joint_state(self._stamp(t_s), names, position, velocity, effort)
        self._write(STATE, t_s, message, publish_ns)

    def write_parameter_event(
        self,
        t_s: float,
        node_name: str,
        changed: Mapping[str, Value],
        publish_ns: int | None = None,
    ) -> None:
        """Write a message on ``/parameter_events`` with accepted parameter changes.

        Args:
            t_s: simulation time at which they took effect [s].
            node_name: full name of the node.
            changed: parameter name -> new value.
            publish_ns: publish time of the message, wall time [ns]; None: that of ``t_s``.

        Raises:
            RecordingError: a time that is not finite, a value of a type that ROS does not have, a
                failing disk, or a recording that has ended.
        """
        event = ParameterEvent(self._stamp(t_s), node_name, changed)
        self._write(EVENTS, t_s, encode_parameter_event(event), publish_ns)

    def next_file(self, channels: Mapping[str, Any], t_s: float) -> None:
        """Finish the current file and begin the next: ``NAME_1.mcap`` after ``NAME_0.mcap``.

        Args:
            channels: content of the ``channels`` topic with the state at the next sample, so that
                the file can be replayed alone.
            t_s: time [s] of the next sample.

        Raises:
            RecordingLostError: the file is no longer what was written.
            RecordingError: the disk fails.
        """
        log_ns, message = self._log_ns(t_s), encode_string(channels_text(channels))
        self._finish({})
        with self._writing():
            self._open(log_ns, message)

    def close(self, health: Mapping[str, str] | None = None) -> None:
        """Finish the file and write ``metadata.yaml``; do nothing if the recording has ended.

        Args:
            health: more counters to store in the file, such as ``samples_offered``.

        Raises:
            RecordingLostError: the file is no longer what was written.
            RecordingError: the disk fails.
        """
        if not self.ended:
            super().close(health or {})

    def _stamp(self, t_s: float) -> int:
        """Convert a time [s] to nanoseconds; RecordingError if it is not finite."""
        if not np.isfinite(t_s):
            raise RecordingError(
                f"the time of a message must be finite, got {t_s!r} s: record nothing of a "
                "motion that has diverged"
            )
        return stamp_ns(t_s)

    def _write(self, topic: int, t_s: float, message: Buffer, publish_ns: int | None) -> None:
        """Append the message of time t_s [s] to the topic with the index ``topic``."""
        log_ns = self._log_ns(t_s)
        publish_ns = log_ns if publish_ns is None else publish_ns
        with self._writing():
            self._bag.write(self._numbers[topic], log_ns, publish_ns, message)

    def _log_ns(self, t_s: float) -> int:
        """Return the wall time [ns] of a simulation time [s]."""
        return self._start_ns + self._stamp(t_s)


def _topics(prefix: str) -> list[Topic]:
    """Return the topics of each file of a run: channels, samples, state, parameter events."""
    return [
        Topic.of(f"{prefix}/channels", STRING, qos_profile(1, latched=True)),
        Topic.of(f"{prefix}/samples", FLOAT64_MULTI_ARRAY, qos_profile(10)),
        Topic.of(f"{prefix}/state", JOINT_STATE, qos_profile(10)),
        Topic.of("/parameter_events", PARAMETER_EVENT, qos_profile(1000)),
    ]
