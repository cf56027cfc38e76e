"""Rig and simulator as they are heard: what a live comparison knows at one moment."""

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
from herringbone_sim.gap.stream.intake import Intake
from herringbone_sim.gap.stream.live import NOISELESS, motion_of, residual
from herringbone_sim.gap.stream.stretch import (
    Motion,
    Residual,
    alike,
    belongs,
    join,
    join_motions,
)
from herringbone_sim.recording.cdr import Buffer
from herringbone_sim.recording.channels import Channels, read_channels
from herringbone_sim.recording.messages import decode_samples

KEPT = 20  # stretches that a picture is made of
STALE_S = 3.0


@dataclass(frozen=True)
class Heard:
    """How one of the two is heard.

    Attributes:
        topic: where it is listened to.
        age_s: since the last block, wall time; None when none came yet.
        t_s: time of its newest sample.
        received, lost, restarts: samples that came, samples missing between blocks, times at
            which its clock went back or its channels changed.
        refused: blocks that could not be read.
        trouble: why it can't be used now; empty when it can.
        says: what it last said of itself in ``/diagnostics``, as that it compiles.
    """

    topic: str
    age_s: float | None
    t_s: float
    received: int
    lost: int
    restarts: int
    refused: int
    trouble: str
    says: str = ""

    @property
    def fresh(self) -> bool:
        return self.age_s is not None and self.age_s < STALE_S


@dataclass(frozen=True)
class Picture:
    """What is known at one moment.

    Attributes:
        rig, simulator: how they are heard.
        residual: of the rig against the nominal model; None when there is none.
        stretches: how many it is made of.
        rig_motion, simulator_motion: statistics, None without samples.
        remarks: what can't be told, and why.
    """

    rig: Heard
    simulator: Heard
    residual: Residual | None
    stretches: int
    rig_motion: Motion | None
    simulator_motion: Motion | None
    remarks: tuple[str, ...]

    @property
    def comparable(self) -> bool:
        """Whether rig and simulator run at one operating point with meshes of the same names."""
        a, b = self.rig_motion, self.simulator_motion
        return a is not None and b is not None and a.meshes == b.meshes and alike(a.point, b.point)


class Ear:
    """Listens to one of the two; blocks come from one thread, questions from another.

    Args:
        topic: name, for people.
        clock: seconds, rising.
    """

    def __init__(self, topic: str, clock: Callable[[], float] = time.monotonic) -> None:
        self.topic = topic
        self._clock = clock
        self._intake = Intake()
        self._lock = threading.Lock()
        self._told = Channels()
        self._heard_at: float | None = None
        self._refused, self._trouble, self._says = 0, "", ""

    def samples(self, message: Buffer) -> None:
        """A serialised block of samples; one that can't be read is counted, and said."""
        with self._lock:
            self._heard_at = self._clock()
            try:
                self._intake.put(*decode_samples(message))
                self._trouble = ""
            except RecordingError as error:
                self._refused += 1
                self._trouble = str(error)

    def channels(self, text: str) -> None:
        """Content of the topic ``channels``; what can't be read tells nothing."""
        with suppress(RecordingError):
            told, _ = read_channels(text)
            with self._lock:
                self._told = told

    def says(self, text: str) -> None:
        """What it says of itself in ``/diagnostics``."""
        with self._lock:
            self._says = text

    @property
    def told(self) -> Mapping[str, Any]:
        """Parameters that the topic ``channels`` holds."""
        return self._told.parameters

    @property
    def simulated(self) -> bool:
        """Whether the samples come from a simulator, and so have no noise."""
        return self._told.source == "simulator"

    def take(self) -> TimeSeries | None:
        """The newest stretch since the last call."""
        with self._lock:
            return self._intake.take()

    def heard(self) -> Heard:
        """How it is heard now."""
        with self._lock:
            at, intake = self._heard_at, self._intake
            return Heard(
                topic=self.topic,
                age_s=None if at is None else self._clock() - at,
                t_s=intake.t_s,
                received=intake.received,
                lost=intake.lost,
                restarts=intake.restarts,
                refused=self._refused,
                trouble=self._trouble,
                says=self._says,
            )


class Comparison:
    """Looks at both from time to time and keeps the last stretches of one operating point.

    Args:
        rig, simulator: ears.
        nominal: the rig as its data sheet has it.
        noise_share: of the rig, as a share of each channel's RMS; None: from the spectra.
    """

    def __init__(
        self, rig: Ear, simulator: Ear, nominal: Parameters, noise_share: float | None = None
    ) -> None:
        self.rig, self.simulator = rig, simulator
        self._nominal = nominal
        self._noise_share = noise_share
        self._residuals: deque[Residual] = deque(maxlen=KEPT)
        self._motions: dict[Ear, deque[Motion]] = {
            ear: deque(maxlen=KEPT) for ear in (rig, simulator)
        }
        self._trouble: dict[Ear, str] = {rig: "", simulator: ""}
        self._unknown = ""

    def look(self) -> Picture:
        """Take what came since the last look, and say what is known."""
        for ear in (self.rig, self.simulator):
            series = ear.take()
            if series is not None:
                self._add(ear, series)
        found = join(tuple(self._residuals)) if self._residuals else None
        rig, simulator = (
            join_motions(tuple(self._motions[ear])) if self._motions[ear] else None
            for ear in (self.rig, self.simulator)
        )
        picture = Picture(
            self.rig.heard(),
            self.simulator.heard(),
            found,
            len(self._residuals),
            rig,
            simulator,
            (),
        )
        return _with_remarks(picture, (self._unknown, *self._trouble.values()))

    def _add(self, ear: Ear, series: TimeSeries) -> None:
        try:
            _append(self._motions[ear], motion_of(series, self._nominal, ear.told))
            self._trouble[ear] = ""
        except HerringboneError as error:
            self._trouble[ear] = f"{ear.topic}: {error}"
        if ear is not self.rig:
            return
        share = NOISELESS if ear.simulated and self._noise_share is None else self._noise_share
        try:
            _append(self._residuals, residual(series, self._nominal, share, ear.told))
            self._unknown = ""
        except HerringboneError as error:
            self._residuals.clear()
            self._unknown = f"{ear.topic}: {error}"


def _append(kept: deque[Any], new: Residual | Motion) -> None:
    if kept and not belongs(new, kept[-1]):
        kept.clear()
    kept.append(new)


def _with_remarks(picture: Picture, troubles: tuple[str, ...]) -> Picture:
    said = [text for text in dict.fromkeys(troubles) if text]
    for heard in (picture.rig, picture.simulator):
        why = f" (it says: {heard.says})" if heard.says else ""
        if heard.age_s is None:
            said.append(f"nothing on {heard.topic} yet{why}")
        elif not heard.fresh:
            age = f"{heard.age_s:.0f} s"
            said.append(f"nothing on {heard.topic} for {age}{why}: what stands is old")
        if heard.trouble:
            said.append(f"{heard.topic}: {heard.trouble}")
    if picture.residual is not None:
        said += picture.residual.remarks
    a, b = picture.rig_motion, picture.simulator_motion
    if a is not None and b is not None and not picture.comparable:
        said.append(_unlike(a, b))
    return replace(picture, remarks=tuple(said))


def _unlike(rig: Motion, simulator: Motion) -> str:
    if rig.meshes != simulator.meshes:
        return (
            f"the rig has meshes {rig.meshes[0]}, ..., the simulator {simulator.meshes[0]}, ...: "
            "start it with the rig's model to compare the motions"
        )
    points = (
        ", ".join(f"{name} {value:.4g}" for name, value in one.point.items())
        for one in (rig, simulator)
    )
    return (
        "the motions are not compared, the simulator runs at another operating point: rig "
        f"{next(points)}; simulator {next(points)}: set its parameters to the rig's"
    )
