"""Batches of models, kept in a folder: what was done before is read, not run again.

Each chunk of a request is a file named by the hash of all that goes into it, so a killed
reproduction goes on where it stopped, and a changed parameter is never mistaken for an old one.
"""

from __future__ import annotations

import hashlib
import json
import os
import zipfile
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, fields
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from herringbone_sim.core.batch import Batch, run_batch
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters, to_mapping
from herringbone_sim.errors import AnalysisError
from herringbone_sim.paper.regimes import POINTS
from herringbone_sim.paper.scenarios import Array
from herringbone_sim.version import VERSION

CHUNK = 32


@dataclass(frozen=True)
class Request:
    """Models to run, as ``core.batch.run_batch`` takes them.

    Attributes:
        sets: n parameter sets of one layout.
        starts: (n, n_state) states at phase 0; None for the sets' own.
        transient, cycles, points, exponents: see ``run_batch``.
    """

    sets: tuple[Parameters, ...]
    starts: Array | None = None
    transient: int = 600
    cycles: int = POINTS
    points: int = POINTS
    exponents: bool = False

    def chunks(self) -> list[Request]:
        """The same in pieces of at most 32 sets."""
        return [self._part(i, min(i + CHUNK, len(self.sets))) for i in _starts(len(self.sets))]

    def _part(self, first: int, stop: int) -> Request:
        starts = None if self.starts is None else self.starts[first:stop]
        length = (self.transient, self.cycles, self.points, self.exponents)
        return Request(self.sets[first:stop], starts, *length)

    @property
    def key(self) -> str:
        """Hash of all that the result hangs on."""
        sets = [to_mapping(one) for one in self.sets]
        length = [self.transient, self.cycles, self.points, self.exponents]
        text = json.dumps([VERSION, sets, length], sort_keys=True).encode()
        starts = b"" if self.starts is None else np.ascontiguousarray(self.starts).tobytes()
        return hashlib.sha256(text + starts).hexdigest()[:24]


class Observer:
    """Runs requests on threads and keeps their batches in a folder; a context manager.

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
        self._folder, self._done = folder, done
        if folder:
            _make(folder)
        self._pool = ThreadPoolExecutor(workers)

    def __enter__(self) -> Observer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)

    def batch(self, request: Request) -> Batch:
        """The batch of one request."""
        return self.batches([request])[0]

    def batches(self, requests: Iterable[Request]) -> list[Batch]:
        """The batches of several requests, run side by side."""
        waiting = [self._submit(request) for request in requests]
        return [_joined([self._told(chunk) for chunk in chunks]) for chunks in waiting]

    def _submit(self, request: Request) -> list[Future[Batch]]:
        return [self._pool.submit(self._one, chunk) for chunk in request.chunks()]

    def _told(self, chunk: Future[Batch]) -> Batch:
        batch = chunk.result()
        self._done(len(batch.reasons))
        return batch

    def _one(self, chunk: Request) -> Batch:
        path = self._folder / f"{chunk.key}.npz" if self._folder else None
        known = _read(path) if path else None
        if known is not None:
            return known
        models = [build(one) for one in chunk.sets]
        batch = run_batch(
            models, chunk.starts, chunk.transient, chunk.cycles, chunk.points, chunk.exponents
        )
        if path:
            _write(path, batch)
        return batch


def _starts(n: int) -> range:
    return range(0, n, CHUNK)


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise AnalysisError(
            f"the output folder must be one that can be written, got {folder} "
            f"({error.strerror}): choose another --out"
        ) from None


def _read(path: Path) -> Batch | None:
    """A batch from its file; None when there is none, or a broken one."""
    try:
        with np.load(path) as file:
            arrays = {item.name: file[item.name] for item in fields(Batch)}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    return Batch(**{**arrays, "reasons": tuple(str(text) for text in arrays["reasons"])})


def _write(path: Path, batch: Batch) -> None:
    """Write beside and rename, so that a file is whole or not there."""
    part = path.with_suffix(".part")
    arrays: Any = {item.name: np.asarray(getattr(batch, item.name)) for item in fields(Batch)}
    with part.open("wb") as file:
        np.savez(file, **arrays)
    os.replace(part, path)


def _joined(parts: Sequence[Batch]) -> Batch:
    """Batches one behind the other."""
    arrays = {
        item.name: np.concatenate([getattr(part, item.name) for part in parts])
        for item in fields(Batch)
        if item.name != "reasons"
    }
    return Batch(**arrays, reasons=tuple(text for part in parts for text in part.reasons))
