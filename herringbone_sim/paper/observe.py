"""Batches of runs for the reproduction of the paper; finished batches are cached in a folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from herringbone_sim.arrays import Array
from herringbone_sim.core.batch import Batch, run_batch
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.written import effects_text
from herringbone_sim.paper.regimes import POINTS
from herringbone_sim.sweeps.array_cache import ArrayCache
from herringbone_sim.sweeps.chunks import Chunk, ChunkRunner

CHUNK = 32  # runs that are stored together
NAMES = tuple(item.name for item in fields(Batch))


@dataclass(frozen=True)
class Request:
    """n runs of gears with the same layout and effects.

    Attributes:
        sets: n parameter sets.
        starts: (n, n_state) states at phase 0, dimensionless; None for the initial states.
        transient, cycles, points, exponents: see ``core.batch.run_batch``.
        before: mesh cycles elapsed before the starts, which set the phase of control and effects.
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

    def parts(self) -> list[Request]:
        """Split the request into requests of at most ``CHUNK`` runs."""
        slices = [slice(i, i + CHUNK) for i in range(0, len(self.sets), CHUNK)]
        starts = [None if self.starts is None else self.starts[rows] for rows in slices]
        pairs = zip(slices, starts, strict=True)
        return [replace(self, sets=self.sets[rows], starts=part) for rows, part in pairs]

    @property
    def length(self) -> tuple[int, int, int, bool]:
        """Transient, cycles, points, exponents: the arguments of ``run_batch`` in order."""
        return self.transient, self.cycles, self.points, self.exponents

    @property
    def key(self) -> list[Any]:
        """All inputs that the batch depends on, for ``ArrayCache``."""
        rest = [self.before, effects_text(self.effects)]
        return [NAMES, self.sets, self.starts, self.length, *rest]


class BatchRunner:
    """Integrates requests on threads and caches their batches in a folder.

    Args:
        folder: created if missing; None caches nothing.
        workers: number of threads.
        bar: counts the runs, see ``ChunkRunner``.

    Raises:
        AnalysisError: the folder can't be written.
    """

    def __init__(
        self, folder: Path | None = None, workers: int = 2, bar: tqdm | None = None
    ) -> None:
        self._chunks = ChunkRunner(ArrayCache(folder), workers, bar)

    def batch(self, request: Request) -> Batch:
        """Integrate the runs of one request, or read them from the cache."""
        return self.batches([request])[0]

    def batches(self, requests: Sequence[Request]) -> list[Batch]:
        """Integrate several requests on the threads at once, or read them from the cache.

        Returns:
            A batch per request, in order; sections lack the states that effects add.
        """
        jobs = [[_chunk(part) for part in request.parts()] for request in requests]
        return [
            Batch(**{**arrays, "reasons": tuple(map(str, arrays["reasons"]))})
            for arrays in self._chunks.arrays(jobs)
        ]


def _chunk(request: Request) -> Chunk:
    return Chunk(request.key, lambda: vars(_run(request)), len(request.sets))


def _run(request: Request) -> Batch:
    """Batch of a request, its sections without states that effects add."""
    models = [build_with(parameters, request.effects) for parameters in request.sets]
    before = np.full(len(models), request.before)
    batch = run_batch(models, request.starts, *request.length, before=before)
    return batch.of_gear(models[0].layout)
