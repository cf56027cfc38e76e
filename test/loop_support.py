"""A loop against a clock that the test owns, and what it delivered."""

from __future__ import annotations

import time

import numpy as np

from herringbone_sim.core.model import Model
from herringbone_sim.runtime import (
    Delivery,
    Loop,
    WallTime,
)


class WallClock:
    """Time that passes only where the loop sleeps, or when the test says so."""

    def __init__(self) -> None:
        self.now = 0.0
        self.slept: list[float] = []

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now += seconds


class Run:
    """A loop whose deliveries are kept; closed by the fixture."""

    def __init__(self, model: Model, **options: object) -> None:
        self.clock = WallClock()
        self.got: list[Delivery] = []
        self.left: list[float] = []
        self.faults: list[str] = []
        self.hook = lambda delivery: None
        self.loop = Loop(
            model,
            self._take,
            wall=WallTime(self.clock, self.clock.sleep),
            fail=self.faults.append,
            **options,
        )

    def _take(self, delivery: Delivery) -> None:
        self.got.append(delivery)
        self.left.append(self.clock.now)
        self.hook(delivery)
        time.sleep(0.001)

    def until(self, blocks: int) -> None:
        limit = time.monotonic() + 120.0  # a kernel may have to be compiled
        while len(self.got) < blocks:
            assert time.monotonic() < limit
            time.sleep(0.002)

    @property
    def rows(self) -> np.ndarray:
        return np.vstack([d.block.rows for d in self.got])
