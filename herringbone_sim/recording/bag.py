"""Write the MCAP files of a rosbag2 bag and its ``metadata.yaml``."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

from herringbone_sim.recording.cdr import Buffer
from herringbone_sim.recording.guarded_file import GuardedFile
from herringbone_sim.recording.safe_yaml import parse_yaml
from herringbone_sim.recording.schemas import MessageType, dump_yaml

CHUNK_SIZE = 1 << 20
LIBRARY = "herringbone_sim"
METADATA_NAME = "metadata.yaml"
METADATA_VERSION = 9
# Key in ``custom_data``: names of the files that were missing at a recovery, one per line.
MISSING_KEY = "herringbone_sim_missing_files"


@dataclass(frozen=True)
class Topic:
    """A topic as a channel of an MCAP file.

    Attributes:
        name: full name of the topic.
        type_name: message type, such as ``std_msgs/msg/String``.
        definition: message definition in ``schema_encoding``.
        schema_encoding, message_encoding: as MCAP names them.
        metadata: channel metadata: ``offered_qos_profiles`` (YAML) and ``topic_type_hash``.
    """

    name: str
    type_name: str
    definition: bytes
    schema_encoding: str = "ros2msg"
    message_encoding: str = "cdr"
    metadata: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, name: str, kind: MessageType, qos: Mapping[str, Any]) -> Topic:
        """Make a topic with one publisher whose QoS profile is ``qos``, see ``qos_profile``."""
        metadata = {
            "offered_qos_profiles": dump_yaml([dict(qos)]),
            "topic_type_hash": kind.type_hash,
        }
        return cls(name, kind.name, kind.text.encode(), metadata=metadata)


@dataclass
class Tally:
    """Number of messages of one topic, and their earliest and latest log time [ns]."""

    topic: Topic
    count: int = 0
    first_ns: int = 0
    last_ns: int = 0

    def add(self, log_ns: int) -> None:
        """Count one message with log time ``log_ns`` [ns]."""
        self.first_ns = min(self.first_ns, log_ns) if self.count else log_ns
        self.last_ns = max(self.last_ns, log_ns) if self.count else log_ns
        self.count += 1


def split_metadata(
    files: Mapping[str, Sequence[Tally]], missing: Sequence[str] = ()
) -> dict[str, Any]:
    """Return the content of ``rosbag2_bagfile_information`` with all keys that rosbag2 requires.

    Args:
        files: file name -> tallies of its topics, for the files of the bag in time order.
        missing: names of files of the bag that no longer exist.
    """
    every = [tally for tallies in files.values() for tally in tallies]
    return {
        "version": METADATA_VERSION,
        "storage_identifier": "mcap",
        **_span(every),
        "topics_with_message_count": [_topic_metadata(tally) for tally in _by_topic(every)],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": list(files),
        "files": [{"path": name, **_span(tallies)} for name, tallies in files.items()],
        "custom_data": {MISSING_KEY: "\n".join(missing)} if missing else None,
        "ros_distro": "jazzy",
    }


def _span(tallies: Sequence[Tally]) -> dict[str, Any]:
    """Return duration, start time and message count under the keys of rosbag2.

    Each call builds new objects, because YAML would write shared objects as anchors and aliases.
    """
    used = [tally for tally in tallies if tally.count]
    first_ns = min((tally.first_ns for tally in used), default=0)
    last_ns = max((tally.last_ns for tally in used), default=0)
    return {
        "duration": {"nanoseconds": last_ns - first_ns},
        "starting_time": {"nanoseconds_since_epoch": first_ns},
        "message_count": sum(tally.count for tally in used),
    }


def _by_topic(tallies: Iterable[Tally]) -> list[Tally]:
    """Return one tally per topic with the message count over all files, without times."""
    totals: dict[str, Tally] = {}
    for tally in tallies:
        total = totals.setdefault(tally.topic.name, Tally(tally.topic))
        total.count += tally.count
    return list(totals.values())


def _topic_metadata(tally: Tally) -> dict[str, Any]:
    """Return the entry of one topic in ``topics_with_message_count``."""
    topic = tally.topic
    qos = parse_yaml(topic.metadata.get("offered_qos_profiles", "")) or []
    return {
        "topic_metadata": {
            "name": topic.name,
            "type": topic.type_name,
            "serialization_format": topic.message_encoding,
            "offered_qos_profiles": qos,
            "type_description_hash": topic.metadata.get("topic_type_hash", ""),
        },
        "message_count": tally.count,
    }


def write_metadata(folder: Path, information: Mapping[str, Any]) -> None:
    """Write ``metadata.yaml`` into a bag folder atomically; raises OSError.

    Args:
        folder: folder of the bag.
        information: content as from ``split_metadata``.
    """
    part = folder / f"{METADATA_NAME}.part"
    try:
        with part.open("w", encoding="utf-8") as stream:
            stream.write(dump_yaml({"rosbag2_bagfile_information": dict(information)}))
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(folder / METADATA_NAME)
    except OSError:
        part.unlink(missing_ok=True)
        raise


class Bag:
    """Writer of one MCAP file of a bag.

    Chunks are compressed with lz4, which on float64 samples takes a third of the time of the zstd
    of ``mcap``. Every method may raise OSError, or FileLostError if another program deleted,
    replaced, cut or moved the file; after an error only ``end`` (for a file that was moved),
    ``stream.close`` and ``abandon`` may be called.

    Attributes:
        stream: the file.
        complete: whether index and footer are written.
    """

    def __init__(self, path: Path) -> None:
        """Create the file ``path``, which must not exist, and write the MCAP header."""
        self.stream = GuardedFile(path)
        self.complete = False
        self._writer = Writer(self.stream, chunk_size=CHUNK_SIZE, compression=CompressionType.LZ4)
        self._writer.start(profile="ros2", library=LIBRARY)
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._tallies: dict[int, Tally] = {}

    @property
    def tallies(self) -> tuple[Tally, ...]:
        """Message count and log times of each topic, in the order of ``add_topic``."""
        return tuple(self._tallies.values())

    def add_topic(self, topic: Topic) -> int:
        """Register a topic and return its channel number, for ``write``."""
        key = (topic.type_name, topic.definition)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(
                topic.type_name, topic.schema_encoding, topic.definition
            )
        channel: int = self._writer.register_channel(
            topic.name, topic.message_encoding, self._schemas[key], dict(topic.metadata)
        )
        self._tallies[channel] = Tally(topic)
        return channel

    def write(self, channel: int, log_ns: int, publish_ns: int, message: Buffer) -> None:
        """Append a serialised message to a channel; log and publish time in ns."""
        tally = self._tallies[channel]
        self._writer.add_message(channel, log_ns, message, publish_ns, sequence=tally.count)
        tally.add(log_ns)
        self.stream.whole = self.stream.position

    def flush(self) -> None:
        """Write all buffered messages to the disk, so that they survive a kill and a power cut."""
        self.stream.check()
        self._writer.flush()
        self.stream.whole = self.stream.position
        self.stream.check()

    def add_record(self, name: str, content: Mapping[str, str]) -> None:
        """Append an MCAP metadata record."""
        self._writer.add_metadata(name, dict(content))

    def end(self, file_name: str | None = None) -> None:
        """Append rosbag2's metadata record and the index, and flush; call ``stream.close`` next.

        Args:
            file_name: final name of the file, if it will be renamed.
        """
        information = split_metadata({file_name or self.stream.path.name: self.tallies})
        self.add_record("rosbag2", {"serialized_metadata": dump_yaml(information)})
        self._writer.finish()
        self.stream.flush()
        self.stream.whole = self.stream.position
        self.complete = True

    def abandon(self) -> None:
        """Truncate the file after its last complete record and close it, without an index."""
        try:
            self.stream.cut()
        finally:
            self.stream.close()
