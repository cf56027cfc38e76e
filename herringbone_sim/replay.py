"""Integrate a recorded run again from its parameters and start state; compare bit for bit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.integrate import State
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters, live_names
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.sensors import Clock, Sensors
from herringbone_sim.effects.stepper import change, stepper
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.parameter_file import EFFECTS, gear_of_values
from herringbone_sim.recording.reader import Recording

CHUNK = 65536


@dataclass(frozen=True)
class Verdict:
    """Result of comparing a recorded run with its repetition.

    Attributes:
        samples: number of samples compared.
        changes: number of recorded parameter changes applied during the repetition.
        first_difference: index of the first sample in which a bit differs, or that the repetition
            lacks because it diverged before; -1 if all agree.
        largest_difference: largest absolute difference over all channels, each in its SI unit;
            infinite if the repetition diverged before the end of the recording.
    """

    samples: int
    changes: int
    first_difference: int
    largest_difference: float

    @property
    def identical(self) -> bool:
        return self.first_difference < 0


def verify(recording: Recording) -> Verdict:
    """Integrate a recorded run again and compare each sample with the recording bit for bit.

    If the repetition diverges, only the samples up to that point are compared; the next one, if
    there is any, counts as a difference.

    Raises:
        RecordingError: the run is not one of this simulator, its parameters or start state are
            missing or do not fit its samples, or its changes are out of order.
    """
    first, largest, at, changes = -1, 0.0, 0, 0
    for rows, made in repeat(recording):
        recorded = recording.samples.data[at : at + len(rows)]
        same = (rows.view(np.int64) == np.ascontiguousarray(recorded).view(np.int64)).all(axis=1)
        if not same.all():
            difference = np.abs(rows - recorded)
            largest = max(largest, float(np.nanmax(difference, initial=0.0)))
            if first < 0:
                first = at + int(np.argmin(same))
        at += len(rows)
        changes += made
    if at < len(recording.samples):
        first, largest = at if first < 0 else first, np.inf
    return Verdict(at, changes, first, largest)


def repeat(recording: Recording) -> Iterator[tuple[Array, int]]:
    """Integrate a recorded run again; yield its samples block by block, until it diverges.

    Yields:
        Samples (n, c) of all recorded channels as the sensors show them, n <= ``CHUNK``; and the
        number of recorded changes that were applied just before the first of them.

    Raises:
        RecordingError: as ``verify``.
    """
    state, parameters, actives, clock = _start(recording)
    model = build(parameters)
    machine = stepper(model, actives)
    if len(state.y) != len(machine.start().y):
        raise RecordingError(
            f"{recording.name} holds a state of {len(state.y)} numbers, its gear has "
            f"{len(machine.start().y)}: an effect of this name is another one here"
        )
    sensors = Sensors(machine, actives, clock)
    if model.layout.channels != recording.samples.names:
        raise RecordingError(
            f"{recording.name} has channels that its model {parameters.model} does not have: "
            "only unaltered runs of the simulator can be repeated"
        )
    cuts = _cuts(recording)
    ends = [*[at for at, _ in cuts[1:]], len(recording.samples)]
    made = 0
    for (at, values), end in zip(cuts, ends, strict=True):
        if values:
            of_model = {name: value for name, value in values.items() if name != EFFECTS}
            chosen = read_effects(values[EFFECTS]) if EFFECTS in values else actives
            new = stepper(build(machine.model.parameters.changed(of_model)), chosen)
            state = change(machine, new, state)
            sensors, machine, actives = sensors.followed(new, chosen, state.t), new, chosen
        made += 1 if values else 0
        while at < end:
            block = machine.advance(state, min(CHUNK, end - at))
            yield sensors.show(block).rows, made
            if block.diverged:
                return
            at, state, made = at + len(block.rows), block.end, 0


def _start(recording: Recording) -> tuple[State, Parameters, tuple[Active, ...], Clock]:
    channels = recording.channels
    if channels.state is None or not channels.parameters:
        raise RecordingError(
            f"{recording.name} does not say its parameters and initial state: only a run of this "
            "simulator can be repeated"
        )
    parameters, actives = gear_of_values(channels.parameters)
    if channels.state.index >= parameters.steps:
        raise RecordingError(
            f"{recording.name} starts at step {channels.state.index} of a cycle of "
            f"{parameters.steps}: its state and its parameters are not those of one run"
        )
    y = np.array(channels.state.y)
    nothing = np.empty((0, len(y)))
    state = State(
        y, channels.state.cycle, channels.state.index, channels.state.t, nothing, np.empty(0)
    )
    return state, parameters, actives, channels.clock


def _cuts(recording: Recording) -> list[tuple[int, dict[str, Any]]]:
    """Return (first sample, new values) of each live change, preceded by ``(0, {})``.

    Changes after the last sample are left out; RecordingError if they are out of order.
    """
    times = recording.samples.times
    cuts: list[tuple[int, dict[str, Any]]] = [(0, {})]
    for made in recording.changes:
        values = {k: v for k, v in made.values.items() if k in (*live_names(), EFFECTS)}
        at = int(np.searchsorted(times, made.t_s - 1e-9))
        if at < cuts[-1][0]:
            raise RecordingError(
                f"{recording.name} has a change at {made.t_s!r} s behind a later one: its "
                "changes are out of order, so it can't be repeated"
            )
        if values and at < len(times):
            cuts.append((at, values))
    return cuts
