"""Apply sensor effects to a run that proceeds block by block.

They change the samples that are published and recorded, never the motion. When effects change,
the clock continues from its present reading, so the shown time never jumps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.integrate import Block, State, Stepper
from herringbone_sim.core.layout import Layout
from herringbone_sim.core.model import Model
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.assemble import assemble
from herringbone_sim.effects.channels import channels_of, distort
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.gear import laws
from herringbone_sim.errors import ParameterError

BESIDE = 4  # samples on each side that the interpolation needs
HISTORY = 256  # latest samples stored, for a delay that is switched on later


@dataclass(frozen=True)
class Clock:
    """Reading ``shown_s`` [s] of the sensors' clock at simulation time ``t_s`` [s].

    From there it runs at the rate that the sensor effects give it.
    """

    t_s: float = 0.0
    shown_s: float = 0.0


class Sensors:
    """Sensor effects of a run; holds the clock and the latest samples without sensor effects.

    Args:
        gear_stepper: stepper of the running gear.
        actives: effects of the gear; only sensor effects are used.
        clock: reading of the clock at the start; None: it shows the simulation time.
        before: latest samples (m, n_channels) before the start; None: none are known.

    Raises:
        ParameterError: as ``check_sensors``.
    """

    def __init__(
        self,
        gear_stepper: Stepper,
        actives: Sequence[Active],
        clock: Clock | None = None,
        before: Array | None = None,
    ) -> None:
        names = gear_stepper.model.layout.channels
        self.clock = clock or Clock()
        self._stepper = gear_stepper
        self._actives = tuple(active for active in actives if active.effect.level == "sensor")
        self._reach_s = max(
            (active.effect.reach(active.theta) for active in self._actives), default=0.0
        )
        self.before = np.empty((0, len(names))) if before is None else before
        check_sensors(gear_stepper.model.layout, self._actives)

    def followed(self, gear_stepper: Stepper, actives: Sequence[Active], t_s: float) -> Sensors:
        """Return sensors that continue after a change of gear or effects at time t_s [s].

        They take over the reading of the clock and the latest samples.
        """
        mine = tuple(active for active in actives if active.effect.level == "sensor")
        clock = self.clock if mine == self._actives else Clock(t_s, self.shown_s(t_s))
        return Sensors(gear_stepper, mine, clock, self.before)

    def shown_s(self, t_s: float) -> float:
        """Return the reading [s] of the clock at a simulation time [s]."""
        probe = _some_samples(self._stepper.model.layout, t_s)
        return float(self._distorted(probe.data)[0, 0]) if self._actives else t_s + self._drift

    @property
    def _drift(self) -> float:
        return self.clock.shown_s - self.clock.t_s

    def show(self, block: Block) -> Block:
        """Return a block with sensor effects in its rows, and store its latest samples.

        For delays the samples after the block are integrated too, without advancing the run.
        """
        if not self._actives and not self._drift:
            self.before = np.concatenate([self.before, block.rows])[-HISTORY:]
            return block
        count = self._count()
        ahead = np.empty((0, block.rows.shape[1]))
        if count and not block.diverged:
            ahead = self._stepper.advance(_alone(block.end), count).rows
        rows = np.concatenate([self.before[-count:] if count else ahead, block.rows, ahead])
        first = min(count, len(self.before))
        self.before = np.concatenate([self.before, block.rows])[-max(count, HISTORY) :]
        if not len(rows):
            return block
        return replace(block, rows=self._distorted(rows)[first : first + len(block.rows)])

    def _count(self) -> int:
        """Return the number of samples on each side of a block on which its rows depend."""
        if not self._reach_s:
            return 0
        p, s = self._stepper.model.parameters, self._stepper.model.scales
        apart = 2.0 * math.pi / (p.Omega * s.omega_n * p.samples_per_cycle)
        return math.ceil(self._reach_s / apart) + BESIDE

    def _distorted(self, rows: Array) -> Array:
        """Return rows (n, n_channels) with sensor effects, their time read from the clock."""
        names = self._stepper.model.layout.channels
        since = rows.copy()
        since[:, 0] -= self.clock.t_s
        shown = distort(TimeSeries(since[:, 0].copy(), since, names), self._actives)
        data: Array = shown.data.copy()
        if np.array_equal(data[:, 0], since[:, 0]):
            data[:, 0] = rows[:, 0] + self._drift  # exact where there is no drift
        else:
            data[:, 0] += self.clock.shown_s
        return data


def check_effects(model: Model, actives: Sequence[Active]) -> None:
    """Raise ParameterError for a place, member or channel of an effect that the gear lacks."""
    laws(model, actives)
    assemble(model, actives)
    check_sensors(model.layout, actives)


def check_sensors(layout: Layout, actives: Sequence[Active]) -> None:
    """Raise ParameterError for a sensor effect that cannot act on a stream of samples.

    The layout lacks its place or a channel, it names no channel, or it needs a whole recording.
    """
    for active in actives:
        if active.effect.level != "sensor":
            continue
        active.locus.mask(layout)
        channels = channels_of(_some_samples(layout), active)
        if active.effect.needs_recording(channels):
            raise ParameterError(
                f"{active.effect.id} of {', '.join(channels)} shows samples ever further away, "
                "which a stream does not have: leave the effect or its channels out"
            )
        if any(o.start for o in active.effect.options) and not channels:
            raise ParameterError(
                f"{active.effect.id} concerns no channel: name some, as channels=F"
            )
        if active.effect.distort is not None:
            active.effect.distort(np.array(active.theta), _some_samples(layout), channels)


def _some_samples(layout: Layout, t_s: float = 0.0) -> TimeSeries:
    """Return eight samples of zeros at intervals of 1 s from t_s [s] on."""
    data = np.zeros((8, len(layout.channels)))
    data[:, 0] = t_s + np.arange(8.0)
    return TimeSeries(data[:, 0].copy(), data, layout.channels)


def _alone(state: State) -> State:
    """Return the state without tangents."""
    n = state.y.size
    return replace(state, tangents=np.zeros((0, n)), growth=np.zeros(0))
