"""Pace of the loop against the wall clock: length of blocks, statistics, slowest factor."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from herringbone_sim.core.model import Model
from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.errors import ParameterError

BLOCK_WALL_S = 0.02  # wall time that a block covers
FREE_CYCLES = 64  # mesh cycles of a block as fast as possible
MOST_SAMPLES = 100_000  # of a block
LATEST_BLOCK_S = 0.1  # longest wall time between samples, so that a live view still moves


@dataclass(frozen=True)
class WallTime:
    """The clock that a loop runs against, and how it waits.

    Attributes:
        now: wall time [s], from any origin.
        sleep: waits for a number of seconds; None: a wait that ends when the loop is closed.
    """

    now: Callable[[], float] = time.monotonic
    sleep: Callable[[float], object] | None = None


WALL_TIME = WallTime()


@dataclass
class Pace:
    """Statistics of the loop's pace for diagnostics; only the loop writes them.

    Attributes:
        reached: simulation time over wall time in the last second.
        overruns: number of blocks so late that the loop fell behind the clock.
        samples: number of samples computed since the loop was created.
        recent: wall time at the end [s] and simulation time [s] of each block of the last second.
    """

    reached: float = 0.0
    overruns: int = 0
    samples: int = 0
    recent: deque[tuple[float, float]] = field(default_factory=deque)

    def note(self, wall: float, simulated: float) -> None:
        """Add a block of ``simulated`` seconds that left at wall time ``wall`` [s]."""
        self.recent.append((wall, simulated))
        while len(self.recent) > 2 and wall - self.recent[0][0] > 1.0:
            self.recent.popleft()
        elapsed = wall - self.recent[0][0]
        if elapsed > 0.0:
            self.reached = sum(s for _, s in list(self.recent)[1:]) / elapsed


def check_pace(model: Model, real_time_factor: float) -> None:
    """Refuse a real-time factor at which samples are more than 0.1 s of wall time apart.

    Raises:
        ParameterError: names the smallest factor and the number of samples per cycle that suffice.
    """
    if real_time_factor == 0.0:
        return
    apart = sample_period_s(model) / real_time_factor
    if apart > LATEST_BLOCK_S:
        enough = math.ceil(model.parameters.samples_per_cycle * apart / LATEST_BLOCK_S)
        least = 1.01 * sample_period_s(model) / LATEST_BLOCK_S  # three digits round by 0.5 %
        raise ParameterError(
            f"real_time_factor {real_time_factor:g} leaves {apart:.3g} s of wall time between "
            f"samples, more than {LATEST_BLOCK_S} s: raise it to "
            f"{least:.3g} or samples_per_cycle to {enough}"
        )


def block_length(model: Model, real_time_factor: float, rate: float) -> int:
    """Number of samples of the next block, at least 1.

    Args:
        model: model in force.
        real_time_factor: simulation time over wall time; 0: as fast as possible.
        rate: samples computed per second of wall time in the last block; 0 before the first.
    """
    if real_time_factor == 0.0:
        n = FREE_CYCLES * model.parameters.samples_per_cycle
    else:
        n = max(int(BLOCK_WALL_S * real_time_factor / sample_period_s(model)), 1)
    if rate:
        n = min(n, max(int(rate * LATEST_BLOCK_S / 2.0), 1))
    return min(n, MOST_SAMPLES)


def sample_period_s(model: Model) -> float:
    """Simulation time [s] between two samples."""
    cycle = TWO_PI / (model.packed.Omega * model.scales.omega_n)
    return cycle / model.parameters.samples_per_cycle
