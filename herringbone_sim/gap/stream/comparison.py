"""Live comparison of the streams of samples of a rig and a simulator."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import HerringboneError, RecordingError
from herringbone_sim.gap.stream.analysis import NOISELESS, motion_at_operating_point, residual
from herringbone_sim.gap.stream.buffer import SampleBuffer
from herringbone_sim.gap.stream.stretch import (
    MotionStatistics,
    Residual,
    join,
    joinable,
    same_operating_point,
)
from herringbone_sim.recording.cdr import Buffer
from herringbone_sim.recording.channels import Channels, read_channels
from herringbone_sim.recording.messages import decode_samples

KEPT = 20  # latest stretches that a comparison uses
STALE_S = 3.0  # wall time without a block after which a stream counts as silent


@dataclass(frozen=True)
class StreamStatus:
    """State of a stream of samples.

    Attributes:
        topic: topic of the samples.
        age_s: wall time since the last block [s]; None before the first.
        t_s: time of its newest sample [s]; NaN before the first.
        received, lost, restarts: counts of samples and breaks, see ``SampleBuffer``.
        refused: number of blocks that could not be read.
        trouble: why the last block could not be read; empty if it could.
        diagnostics: last message of the sender in ``/diagnostics``.
    """

    topic: str
    age_s: float | None
    t_s: float
    received: int
    lost: int
    restarts: int
    refused: int
    trouble: str
    diagnostics: str = ""

    @property
    def fresh(self) -> bool:
        """Whether a block came in the last ``STALE_S`` seconds."""
        return self.age_s is not None and self.age_s < STALE_S


@dataclass(frozen=True)
class ComparisonResult:
    """Result of a live comparison at one moment.

    Attributes:
        rig, simulator: state of the streams.
        residual: residual of the rig against the nominal model; None if unknown.
        rig_motion, simulator_motion: motion statistics; None without samples.
        remarks: sentences on what is unknown, and why.
    """

    rig: StreamStatus
    simulator: StreamStatus
    residual: Residual | None
    rig_motion: MotionStatistics | None
    simulator_motion: MotionStatistics | None
    remarks: tuple[str, ...]

    @property
    def comparable(self) -> bool:
        """Whether rig and simulator have the same meshes and the same operating point."""
        a, b = self.rig_motion, self.simulator_motion
        return (
            a is not None
            and b is not None
            and a.meshes == b.meshes
            and same_operating_point(a.point, b.point)
        )


class SampleStream:
    """Samples, channels and diagnostics of a rig or a simulator; safe to use from two threads.

    Args:
        topic: topic of the samples, for messages.
        clock: function that returns monotonic time [s].
    """

    def __init__(self, topic: str, clock: Callable[[], float] = time.monotonic) -> None:
        self.topic = topic
        self._clock = clock
        self._buffer = SampleBuffer()
        self._lock = threading.Lock()
        self._channels = Channels()
        self._received_at: float | None = None
        self._refused, self._trouble, self._diagnostics = 0, "", ""

    def add_samples(self, message: Buffer) -> None:
        """Add a serialised block of samples.

        An unreadable block is counted and reported in ``status``; it restarts ``age_s`` too, so
        that a stream of such blocks is ``fresh``.
        """
        with self._lock:
            self._received_at = self._clock()
            try:
                self._buffer.put(*decode_samples(message))
                self._trouble = ""
            except HerringboneError as error:
                self._refused += 1
                self._trouble = str(error)

    def set_channels(self, text: str) -> None:
        """Set the content of the topic ``channels``; content that can't be read is ignored."""
        with suppress(RecordingError):
            channels, _ = read_channels(text)
            with self._lock:
                self._channels = channels

    def set_diagnostics(self, text: str) -> None:
        """Set the latest message of the sender in ``/diagnostics``."""
        with self._lock:
            self._diagnostics = text

    @property
    def parameters(self) -> Mapping[str, Any]:
        """Parameters in the last readable message on ``channels``; empty before the first."""
        return self._channels.parameters

    @property
    def simulated(self) -> bool:
        """Whether the samples come from a simulator, and so have no noise."""
        return self._channels.source == "simulator"

    def take(self) -> TimeSeries | None:
        """Return and remove the newest stretch; None while it is too short."""
        with self._lock:
            return self._buffer.take()

    def status(self) -> StreamStatus:
        """Return the present state of the stream."""
        with self._lock:
            at, buffer = self._received_at, self._buffer
            return StreamStatus(
                topic=self.topic,
                age_s=None if at is None else self._clock() - at,
                t_s=buffer.t_s,
                received=buffer.received,
                lost=buffer.lost,
                restarts=buffer.restarts,
                refused=self._refused,
                trouble=self._trouble,
                diagnostics=self._diagnostics,
            )


class Comparison:
    """Compares a rig with a simulator over the last ``KEPT`` stretches at one operating point.

    Args:
        rig, simulator: their streams of samples.
        nominal: parameters of the data sheet of the rig.
        noise_share: RMS of the rig's noise over that of each channel; None: from spectra.
    """

    def __init__(
        self,
        rig: SampleStream,
        simulator: SampleStream,
        nominal: Parameters,
        noise_share: float | None = None,
    ) -> None:
        self.rig, self.simulator = rig, simulator
        self._nominal = nominal
        self._noise_share = noise_share
        self._residuals: deque[Residual] = deque(maxlen=KEPT)
        self._motions: dict[SampleStream, deque[MotionStatistics]] = {
            stream: deque(maxlen=KEPT) for stream in (rig, simulator)
        }
        self._trouble: dict[SampleStream, str] = {rig: "", simulator: ""}
        self._no_residual = ""

    def update(self) -> ComparisonResult:
        """Use the new samples of both streams; return the comparison over the last stretches."""
        for stream in (self.rig, self.simulator):
            series = stream.take()
            if series is not None:
                self._add(stream, series)
        joined = join(tuple(self._residuals)) if self._residuals else None
        rig, simulator = (
            join(tuple(self._motions[stream])) if self._motions[stream] else None
            for stream in (self.rig, self.simulator)
        )
        result = ComparisonResult(
            self.rig.status(),
            self.simulator.status(),
            joined,
            rig,
            simulator,
            (),
        )
        return _with_remarks(result, (self._no_residual, *self._trouble.values()))

    def _add(self, stream: SampleStream, series: TimeSeries) -> None:
        """Add the motion statistics of a stretch and, for the rig, its residual."""
        try:
            _append(
                self._motions[stream],
                motion_at_operating_point(series, self._nominal, stream.parameters),
            )
            self._trouble[stream] = ""
        except HerringboneError as error:
            self._trouble[stream] = f"{stream.topic}: {error}"
        if stream is not self.rig:
            return
        share = NOISELESS if stream.simulated and self._noise_share is None else self._noise_share
        try:
            _append(self._residuals, residual(series, self._nominal, share, stream.parameters))
            self._no_residual = ""
        except HerringboneError as error:
            self._residuals.clear()
            self._no_residual = f"{stream.topic}: {error}"


def _append(stretches: deque[Any], new: Residual | MotionStatistics) -> None:
    """Append the result of a stretch; drop all earlier ones if the first can't be joined with it.

    The first, as a slow drift of the operating point changes each a little from the one before.
    """
    if stretches and not joinable(new, stretches[0]):
        stretches.clear()
    stretches.append(new)


def _with_remarks(result: ComparisonResult, troubles: tuple[str, ...]) -> ComparisonResult:
    """Add remarks on silent streams, on troubles, and on motions that can't be compared."""
    remarks = [text for text in dict.fromkeys(troubles) if text]
    for status in (result.rig, result.simulator):
        why = f" (it says: {status.diagnostics})" if status.diagnostics else ""
        if status.age_s is None:
            remarks.append(f"nothing on {status.topic} yet{why}")
        elif not status.fresh:
            age = f"{status.age_s:.0f} s"
            remarks.append(f"nothing on {status.topic} for {age}{why}: what stands is old")
        if status.trouble:
            remarks.append(f"{status.topic}: {status.trouble}")
    if result.residual is not None:
        remarks += result.residual.remarks
    a, b = result.rig_motion, result.simulator_motion
    if a is not None and b is not None and not result.comparable:
        remarks.append(_difference_of_points(a, b))
    return replace(result, remarks=tuple(remarks))


def _difference_of_points(rig: MotionStatistics, simulator: MotionStatistics) -> str:
    """Return the reason why the motions of rig and simulator are not compared."""
    if rig.meshes != simulator.meshes:
        return (
            f"the rig has meshes {rig.meshes[0]}, ..., the simulator {simulator.meshes[0]}, ...: "
            "start it with the rig's model to compare the motions"
        )
    points = (
        ", ".join(f"{name} {value:.4g}" for name, value in motion.point.items())
        for motion in (rig, simulator)
    )
    return (
        "the motions are not compared, the simulator runs at another operating point: rig "
        f"{next(points)}; simulator {next(points)}: set its parameters to the rig's"
    )
