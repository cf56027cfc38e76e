"""Copy all intact messages of an MCAP file into a new one with an index."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.bag import Bag, Tally, Topic
from herringbone_sim.recording.load import is_samples
from herringbone_sim.recording.messages import decode_samples
from herringbone_sim.recording.run_files import RECORD_NAME
from herringbone_sim.recording.safe_yaml import YamlError, parse_yaml
from herringbone_sim.recording.scan import MOST_NOTES, Scan, ScannedMessage

_QOS = "offered_qos_profiles"


@dataclass
class Survey:
    """Content of an MCAP file that was read to its end.

    Attributes:
        scan: finished scan of the file.
        tallies: (topic name, type) -> number of messages, also of topics without messages.
        samples: number of readable samples.
        span_s: times of the first and last readable sample [s]; None without samples.
        notes: a sentence on each irregularity.
    """

    scan: Scan
    tallies: dict[tuple[str, str], Tally] = field(default_factory=dict)
    samples: int = 0
    span_s: tuple[float, float] | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def file(self) -> Path:
        return self.scan.path

    @property
    def messages(self) -> int:
        """Number of intact messages."""
        return sum(tally.count for tally in self.tallies.values())

    @property
    def loses_data(self) -> bool:
        """Whether a copy lacks data of the file: an incomplete end, damaged or skipped records."""
        scan = self.scan
        return bool(scan.intact_bytes < scan.size or scan.damaged or scan.skipped)


def survey(file: Path) -> Survey:
    """Read an MCAP file to its end and count its content; RecordingError if it can't be read."""
    file_survey = Survey(Scan(file))
    n_unread = 0
    for message in file_survey.scan.messages():
        tally = file_survey.tallies.setdefault(_key(message.topic), Tally(message.topic))
        tally.add(message.log_ns)
        if is_samples(message.topic):
            try:
                _count_samples(file_survey, message)
            except RecordingError as error:
                n_unread += 1
                note = f"a message of {message.topic.name} is kept, but can't be read: {error}"
                file_survey.notes += [note] * (n_unread <= MOST_NOTES)
    topics = {_key(topic): topic for topic in file_survey.scan.topics.values()}
    ordered = {key: file_survey.tallies.get(key, Tally(topic)) for key, topic in topics.items()}
    file_survey.tallies = ordered | file_survey.tallies
    for tally in file_survey.tallies.values():
        tally.topic, notes = _with_good_qos(tally.topic)
        file_survey.notes += notes
    file_survey.notes += file_survey.scan.notes
    return file_survey


def _key(topic: Topic) -> tuple[str, str]:
    return topic.name, topic.type_name


def _count_samples(survey_so_far: Survey, message: ScannedMessage) -> None:
    """Add number and time span of the samples in a message to the survey."""
    names, rows = decode_samples(message.message)
    survey_so_far.samples += len(rows)
    if len(rows) and "t" in names:
        times = rows[:, names.index("t")]
        first = survey_so_far.span_s[0] if survey_so_far.span_s else float(times[0])
        survey_so_far.span_s = (first, float(times[-1]))


def _with_good_qos(topic: Topic) -> tuple[Topic, list[str]]:
    """Return the topic, without QoS profiles that can't be parsed, and notes on that."""
    try:
        profiles = parse_yaml(topic.metadata.get(_QOS, "")) or []
        if isinstance(profiles, list) and all(isinstance(profile, dict) for profile in profiles):
            return topic, []
    except YamlError:
        pass
    metadata = {name: value for name, value in topic.metadata.items() if name != _QOS}
    note = f"the quality of service of {topic.name} can't be read and is left out"
    return replace(topic, metadata=metadata), [note]


def rebuild(source: Survey, part: Path, name: str) -> Sequence[Tally]:
    """Copy every intact message into a new, finished file; return its tallies.

    Args:
        source: survey of the file to copy.
        part: file to write, which must not exist; removed if the copy fails.
        name: final name of the file, to which the caller renames it.

    Raises:
        OSError: the disk fails.
        RecordingError: the source can't be read any more.
    """
    bag = Bag(part)
    try:
        channels = {key: bag.add_topic(tally.topic) for key, tally in source.tallies.items()}
        for message in Scan(source.file).messages():
            key = _key(message.topic)
            if key in channels:
                bag.write(channels[key], message.log_ns, message.publish_ns, message.message)
        bag.flush()
        for record, content in _records(source):
            bag.add_record(record, content)
        bag.end(name)
        bag.stream.close()
    except BaseException:
        with suppress(OSError):
            bag.abandon()
        part.unlink()
        raise
    return bag.tallies


def _records(source: Survey) -> list[tuple[str, dict[str, str]]]:
    """Return the metadata records of the copy: those of the source, marked as recovered."""
    other_records = [
        record for record in source.scan.metadata if record[0] not in ("rosbag2", RECORD_NAME)
    ]
    source_fields = dict(source.scan.metadata).get(RECORD_NAME, {})
    counted = {"samples_written": str(source.samples), **source_fields, "recovered": "true"}
    return [*other_records, (RECORD_NAME, counted)]
