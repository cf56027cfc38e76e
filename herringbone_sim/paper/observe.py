"""Batches of models, kept in a folder: what was done before is read, not run again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.core.batch import Batch, run_batch
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.written import effects_text
from herringbone_sim.paper.regimes import POINTS
from herringbone_sim.paper.scenarios import Array
from herringbone_sim.sweeps.array_cache import ArrayCache

CHUNK = 32
NAMES = tuple(item.name for item in fields(Batch))


@dataclass(frozen=True)
class Request:
    """Models to run, as ``core.batch.run_batch`` takes them.

    Attributes:
        sets: n parameter sets of one layout.
        starts: (n, n_state) states at phase 0; None for the sets' own.
        transient, cycles, points, exponents: see ``run_batch``.
        before: mesh cycles that each has run earlier.
        effects: of every gear.
    """

    sets: tuple[Parameters, ...]
    starts: Array | None = None
    transient: int = 600
    cycles: int = POINTS
    points: int = POINTS
    exponents: bool = False
    before: int = 0
    effects: tuple[Active, ...] = ()

    def chunks(self) -> list[Request]:
        """The same in pieces of at most 32 sets."""
        return [self._part(i, min(i + CHUNK, len(self.sets))) for i in _starts(len(self.sets))]

    def _part(self, first: int, stop: int) -> Request:
        starts = None if self.starts is None else self.starts[first:stop]
        return replace(self, sets=self.sets[first:stop], starts=starts)

    @property
    def length(self) -> tuple[int, int, int, bool]:
        return self.transient, self.cycles, self.points, self.exponents

    @property
    def parts(self) -> list[Any]:
        """All that the result hangs on."""
        rest = [self.before, effects_text(self.effects)]
        return [NAMES, self.sets, self.starts, self.length, *rest]


class Observer:
    """Runs requests on threads and keeps their batches in a folder.

    Args:
        folder: made when it is new; None keeps nothing.
        workers: threads.
        done: told the number of sets after each chunk.

    Raises:
        AnalysisError: the folder can't be written.
    """

    def __init__(
        self,
        folder: Path | None = None,
        workers: int = 2,
        done: Callable[[int], object] = lambda sets: None,
    ) -> None:
        self._kept, self._workers, self._done = ArrayCache(folder), workers, done

    def batch(self, request: Request) -> Batch:
        """The batch of one request."""
        return self.batches([request])[0]

    def batches(self, requests: Iterable[Request]) -> list[Batch]:
        """The batches of several requests, run side by side."""
        pieces = [request.chunks() for request in requests]
        with ThreadPoolExecutor(self._workers) as pool:
            found = pool.map(self._one, chain.from_iterable(pieces))
            return [_joined([self._told(next(found)) for _ in own]) for own in pieces]

    def _one(self, chunk: Request) -> Batch:
        arrays = self._kept.get(chunk.parts, lambda: vars(_run(chunk)))
        return Batch(**{**arrays, "reasons": tuple(map(str, arrays["reasons"]))})

    def _told(self, batch: Batch) -> Batch:
        self._done(len(batch.reasons))
        return batch


def _run(chunk: Request) -> Batch:
    models = [build_with(one, chunk.effects) for one in chunk.sets]
    before = np.full(len(models), chunk.before)
    return run_batch(models, chunk.starts, *chunk.length, before=before)


def _starts(n: int) -> range:
    return range(0, n, CHUNK)


def _joined(parts: Sequence[Batch]) -> Batch:
    """Batches one behind the other."""
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in NAMES
        if name != "reasons"
    }
    return Batch(**arrays, reasons=tuple(text for part in parts for text in part.reasons))
