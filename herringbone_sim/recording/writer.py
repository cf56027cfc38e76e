"""Recording of a run: a bag that survives a kill, a full disk and a wrong name.

The caller, one thread, hands in blocks of samples, states and parameter changes, calls ``flush``
every half second, and ``close`` at the end.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.bag import Bag, Topic
from herringbone_sim.recording.cdr import Array, Buffer
from herringbone_sim.recording.messages import (
    JointState,
    ParameterEvent,
    Value,
    encode_joint_state,
    encode_parameter_event,
    encode_samples,
    encode_string,
)
from herringbone_sim.recording.schemas import (
    FLOAT64_MULTI_ARRAY,
    JOINT_STATE,
    PARAMETER_EVENT,
    STRING,
    qos_profile,
)

__all__ = ["RECORD_NAME", "RunWriter", "encode_samples", "split_rows", "stamp_ns"]

MESSAGE_LIMIT = 64_000
RECORD_NAME = "herringbone_sim"


def stamp_ns(t_s: float) -> int:
    """Nanoseconds, rounded, of a time [s]."""
    return round(t_s * 1e9)


def split_rows(n: int, c: int, label_bytes: int | None = None) -> list[slice]:
    """Slices of a block (n, c) whose messages each stay below 64000 bytes.

    Args:
        n: samples in the block.
        c: channels.
        label_bytes: length of the comma-separated channel names; 32 a channel if not given.

    Raises:
        RecordingError: not even one sample fits.
    """
    head = 64 + (32 * c if label_bytes is None else label_bytes)
    most = (MESSAGE_LIMIT - head) // (8 * c)
    if most < 1:
        raise RecordingError(
            f"a sample must fit into a message of {MESSAGE_LIMIT} bytes, got {c} channels: "
            "record fewer channels"
        )
    return [slice(start, min(start + most, n)) for start in range(0, n, most)]


def _check_name(name: str) -> None:
    led_out = name in ("", ".", "..") or any(mark in name for mark in "/\\") or Path(name).drive
    if led_out or name != name.strip() or not name.isprintable():
        raise RecordingError(
            f"the name of a run must be that of one folder inside record_dir, got {name!r}: "
            "leave out separators, '..' and spaces at its ends"
        )


def _check_channels(names: Sequence[str]) -> None:
    odd = [name for name in names if not name.strip() or "," in name or name != name.strip()]
    if odd or "t" not in names or len(set(names)) != len(names):
        raise RecordingError(
            "channel names must be unique, without commas, and one must be 't', got "
            f"{', '.join(map(repr, names)) or 'none'}: mend the names"
        )


def _json(channels: Mapping[str, Any]) -> str:
    try:
        return json.dumps(channels, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise RecordingError(
            f"the content of channels must be plain JSON with finite numbers, got {error}: "
            "convert it before it is recorded"
        ) from error


def _make_folder(record_dir: Path, name: str) -> Path:
    folder = record_dir / name
    try:
        record_dir.mkdir(parents=True, exist_ok=True)
        folder.mkdir()
    except FileExistsError as error:
        what = f"the run {folder} exists" if folder.exists() else f"{record_dir} is not a folder"
        raise RecordingError(
            f"{what}: a recording never overwrites; choose another name or record_dir"
        ) from error
    except (OSError, ValueError) as error:
        raise RecordingError(
            f"can't create the run folder {folder} ({_reason(error)}): choose a record_dir that "
            "can be written"
        ) from error
    return folder


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error) or type(error).__name__


class RunWriter:
    """Writes one run; made by ``RunWriter.create``.

    The first failure of the disk raises RecordingError, cuts the file behind its last whole
    record, and ends the recording: what was written stays readable, every later write is refused
    with RecordingError, and ``close`` does nothing.
    """

    def __init__(self, bag: Bag, prefix: str, channel_names: tuple[str, ...], start_ns: int):
        self._bag = bag
        self._names = channel_names
        self._start_ns = start_ns
        self._samples_written = 0
        self._ended: str | None = None
        samples = Topic.of(f"{prefix}/samples", FLOAT64_MULTI_ARRAY, qos_profile(10))
        state = Topic.of(f"{prefix}/state", JOINT_STATE, qos_profile(10))
        channels = Topic.of(f"{prefix}/channels", STRING, qos_profile(1, latched=True))
        events = Topic.of("/parameter_events", PARAMETER_EVENT, qos_profile(1000))
        self._channels = bag.add_topic(channels)
        self._samples = bag.add_topic(samples)
        self._state = bag.add_topic(state)
        self._events = bag.add_topic(events)

    @classmethod
    def create(
        cls,
        record_dir: Path,
        name: str,
        topic_prefix: str,
        channels: Mapping[str, Any],
        channel_names: tuple[str, ...],
        start_ns: int,
    ) -> RunWriter:
        """Create ``record_dir/name/name_0.mcap`` and write the ``channels`` message.

        Args:
            record_dir: folder of the runs, made if it is missing.
            name: name of the run.
            topic_prefix: full name of the node, as ``/herringbone_sim``.
            channels: content of the ``channels`` topic, to be written as JSON.
            channel_names: c names of the columns of a block; one is ``t``.
            start_ns: wall time [ns] of t = 0.

        Raises:
            RecordingError: a name that exists or leads out of ``record_dir``, channel names that
                no recording can have, or a folder that can't be written.
        """
        _check_name(name)
        _check_channels(channel_names)
        split_rows(1, len(channel_names), len(",".join(channel_names).encode()))
        text = _json(channels)
        prefix = f"/{topic_prefix.strip('/')}" if topic_prefix.strip("/") else ""
        folder = _make_folder(Path(record_dir).absolute(), name)
        try:
            bag = Bag(folder / f"{name}_0.mcap")
        except OSError as error:
            with suppress(OSError):
                folder.rmdir()
            raise RecordingError(
                f"can't create a file in {folder} ({_reason(error)}): choose a record_dir that "
                "can be written"
            ) from error
        writer = cls(bag, prefix, channel_names, start_ns)
        writer._write(writer._channels, 0.0, encode_string(text), None)
        writer.flush()
        return writer

    @property
    def path(self) -> Path:
        """Absolute path of the run folder."""
        return self._bag.path.parent

    @property
    def samples_written(self) -> int:
        """Samples taken so far: the counter that proves that none was lost."""
        return self._samples_written

    def write_samples(self, block: Array, publish_ns: int | None = None) -> None:
        """Write a block (n, c) of samples, split into messages below 64 kB.

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
        label_bytes = len(",".join(self._names).encode())
        for rows in split_rows(len(block), len(self._names), label_bytes):
            message = encode_samples(self._names, block[rows])
            self.write_serialized_samples(
                message, float(times[rows.start]), rows.stop - rows.start, publish_ns
            )

    def write_serialized_samples(
        self, message: Buffer, t_s: float, n: int, publish_ns: int | None = None
    ) -> None:
        """Write a message of ``encode_samples`` with n samples, the first at t_s [s]."""
        self._write(self._samples, t_s, message, publish_ns)
        self._samples_written += n

    def write_state(
        self,
        t_s: float,
        names: tuple[str, ...],
        position: Array,
        velocity: Array,
        effort: Array,
        publish_ns: int | None = None,
    ) -> None:
        """Write displacement [m], its rate [m/s] and force [N], each (m,), of m meshes at t_s."""
        state = JointState(self._stamp(t_s), names, position, velocity, effort)
        self._write(self._state, t_s, encode_joint_state(state), publish_ns)

    def write_parameter_event(
        self,
        t_s: float,
        node_name: str,
        changed: Mapping[str, Value],
        publish_ns: int | None = None,
    ) -> None:
        """Write accepted changes, with the simulation time [s] at which they took effect."""
        event = ParameterEvent(self._stamp(t_s), node_name, changed)
        self._write(self._events, t_s, encode_parameter_event(event), publish_ns)

    def flush(self) -> None:
        """Bring everything to the disk: call it every half second."""
        with self._writing():
            self._bag.flush()

    def close(self, health: Mapping[str, str] | None = None) -> None:
        """Finish the file and write ``metadata.yaml``; nothing if the recording has ended.

        Args:
            health: what else to keep in the file, as counters of dropped blocks.

        Raises:
            RecordingError: the disk fails only now.
        """
        if self._ended:
            return
        self.flush()
        with self._writing():
            counts = {"samples_written": str(self._samples_written)}
            self._bag.add_record(RECORD_NAME, {**(health or {}), **counts})
            self._bag.finish()
        self._ended = f"the recording {self.path} is closed: start another"

    def _stamp(self, t_s: float) -> int:
        if not np.isfinite(t_s):
            raise RecordingError(
                f"the time of a message must be finite, got {t_s!r} s: record nothing of a "
                "motion that has diverged"
            )
        return stamp_ns(t_s)

    def _write(self, channel: int, t_s: float, message: Buffer, publish_ns: int | None) -> None:
        log_ns = self._start_ns + self._stamp(t_s)
        with self._writing():
            published = log_ns if publish_ns is None else publish_ns
            self._bag.write(channel, log_ns, published, message)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        if self._ended:
            raise RecordingError(self._ended)
        try:
            yield
        except OSError as error:
            with suppress(OSError):
                self._bag.abandon()
            failed = f"the recording {self.path} ended early ({_reason(error)})"
            self._ended = f"{failed}: free the disk and start another"
            raise RecordingError(
                f"{failed} after {self._samples_written} samples; what is on disk stays readable: "
                f"free the disk, run 'python -m herringbone_sim recover {self.path}', and start "
                "another"
            ) from error
