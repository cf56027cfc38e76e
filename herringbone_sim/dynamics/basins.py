"""Basins: which attractor each start leads to, and the share of starts that each attracts."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from herringbone_sim.analysis.periods import TOLERANCE
from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.model import Model, initial_state, state
from herringbone_sim.dynamics.attractors import Attractor, Exchange, attractor_of, recognise
from herringbone_sim.dynamics.flow import symmetry

Array = NDArray[np.float64]
Sections = Callable[[Array], Array]
FAILED = -1
CHUNK = 64


@dataclass(frozen=True)
class Basins:
    """Where starts lead to.

    Attributes:
        attractors: found, the one with the largest share first.
        labels: (n_starts,) index of the attractor, -1 where the run failed; (n, n) of a slice.
    """

    attractors: tuple[Attractor, ...]
    labels: NDArray[np.int64]

    @property
    def counts(self) -> NDArray[np.int64]:
        """(n_attractors,) starts that lead to each."""
        return np.bincount(self.labels[self.labels >= 0], minlength=len(self.attractors))

    @property
    def failed(self) -> int:
        return int(np.sum(self.labels == FAILED))

    def shares(self, confidence: float = 0.95) -> Array:
        """(n_attractors, 3) share of all starts, and its Wilson interval."""
        n = self.labels.size
        return np.array([[c / n, *wilson(int(c), n, confidence)] for c in self.counts])


def explore(
    sections_of: Sections,
    starts: Array,
    exchange: Exchange | None = None,
    tolerance: float = TOLERANCE,
    known: tuple[Attractor, ...] = (),
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Basins:
    """Run all starts, 64 at a time, and tell the attractors apart; memory does not grow with them.

    Args:
        sections_of: takes starts (m, n) to sections (m, points, n) after the transient, NaN where
            a run failed; ``gear_sections`` of a model.
        starts: (n_starts, n) states.
        exchange: (n,) indices that swap left and right; mirror images then count as one.
        tolerance: up to which section points are one, in the units of the state.
        known: attractors found before; they keep their order and come first.
        progress: sees the chunks go by, such as ``tqdm``.
    """
    found, labels = list(known), np.full(len(starts), FAILED)
    for first in progress(range(0, len(starts), CHUNK)):
        for i, section in enumerate(sections_of(starts[first : first + CHUNK]), start=first):
            if np.isfinite(section).all():
                attractor = attractor_of(section, exchange, tolerance)
                labels[i] = recognise(attractor, found, exchange, tolerance)
                if labels[i] == len(found):
                    found.append(replace(attractor, points=attractor.points.copy()))
    basins = Basins(tuple(found), labels)
    return basins if known else by_share(basins)


def by_share(basins: Basins) -> Basins:
    """The same with the most frequent attractor first."""
    order = np.argsort(-basins.counts, kind="stable")
    rank = np.append(np.argsort(order), FAILED)  # the last one serves label -1
    return Basins(tuple(basins.attractors[i] for i in order), rank[basins.labels])


def wilson(count: int, n: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of a share, count of n; Wilson, J. Am. Stat. Assoc. 22 (1927) 209."""
    z = float(norm.ppf(0.5 + 0.5 * confidence))
    share = count / n
    middle = share + z**2 / (2 * n)
    half = z * float(np.sqrt(share * (1 - share) / n + z**2 / (4 * n**2)))
    scale = 1 + z**2 / n
    return max((middle - half) / scale, 0.0), min((middle + half) / scale, 1.0)


def gear_sections(
    model: Model, transient: int = 2000, points: int = 200, workers: int = 1
) -> Sections:
    """Sections of a gear at phase 0: the last points after a transient, in mesh cycles.

    Args:
        workers: threads among which the starts are shared; the sections do not hang on it.
    """

    def run(starts: Array) -> Array:
        models = [model] * len(starts)
        return run_batch(models, starts, transient, cycles=points, points=points).sections

    def sections_of(starts: Array) -> Array:
        with ThreadPoolExecutor(workers) as pool:
            shares = np.array_split(starts, min(workers, len(starts)))
            return np.concatenate(list(pool.map(run, shares)))

    return sections_of


def random_starts(model: Model, n: int, rng: np.random.Generator, reach: float = 1.0) -> Array:
    """(n, n_state) states with all x and v of the meshes even in -reach .. reach, left and right
    each on its own; x in b_c, v in b_c omega_n."""
    x, v = rng.uniform(-reach, reach, (2, n, model.layout.n_mesh))
    return np.array([state_at(model, *one) for one in zip(x, v, strict=True)])


def state_at(model: Model, x: Array, v: Array) -> Array:
    """State (n_state,) at phase 0 by x and v (n_mesh,) of the meshes; own states of effects are
    as in the initial state."""
    y = initial_state(model)
    y[: model.layout.n_state] = state(model, x, v, 0.0)
    return y


def slice_starts(model: Model, n: int, reach: float = 1.0) -> tuple[Array, Array]:
    """A plane of states at rest: displacement that left and right share over their difference.

    Returns:
        axis (n,) of both, and states (n * n, n_state): row by row, the difference grows from row
        to row. ``x_L = shared + difference / 2`` on sun and ring meshes, ``x_R`` with a minus.
    """
    axis = np.array([(i + 0.5) * 2.0 * reach / n - reach for i in range(n)])
    c, m = model.layout.n_classes, model.layout.n_mesh
    side = np.tile(np.repeat([0.5, -0.5], c), 2)
    starts = [
        state_at(model, shared + difference * side, np.zeros(m))
        for difference in axis
        for shared in axis
    ]
    return axis, np.array(starts)


def explore_slice(
    model: Model,
    sections_of: Sections,
    n: int,
    reach: float = 1.0,
    known: tuple[Attractor, ...] = (),
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> tuple[Array, Basins]:
    """The plane of ``slice_starts``; of a gear with equal halves one half of it is run.

    Returns:
        axis (n,) of both, and basins with labels (n, n): rows for the difference of left and
        right, columns for what they share.
    """
    axis, starts = slice_starts(model, n, reach)
    exchange = symmetry(model)
    rows = n if exchange is None else (n + 1) // 2
    found = explore(sections_of, starts[: rows * n], exchange, known=known, progress=progress)
    labels = found.labels.reshape(rows, n)
    if exchange is not None:
        labels = np.concatenate([labels, labels[: n // 2][::-1]])
    return axis, Basins(found.attractors, labels)
