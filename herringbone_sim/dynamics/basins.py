"""Basins of attraction: the attractor that each of a set of initial states leads to."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import binomtest

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.model import Model, state
from herringbone_sim.dynamics.attractors import Attractor, attractor_of, match_known
from herringbone_sim.dynamics.flow import symmetry

Sections = Callable[[Array], Array]
FAILED = -1
CHUNK = 64


@dataclass(frozen=True)
class Basins:
    """Attractors that a set of initial states leads to.

    Attributes:
        attractors: those given to ``explore`` as known, then new ones; if none were known, by
            descending number of initial states.
        labels: index into ``attractors`` for each initial state, (n_starts,) or (n, n) for a plane
            of them; -1 where the motion diverged.
    """

    attractors: tuple[Attractor, ...]
    labels: Indices

    @property
    def counts(self) -> Indices:
        """(n_attractors,) number of initial states that lead to each attractor."""
        return np.bincount(self.labels[self.labels >= 0], minlength=len(self.attractors))

    @property
    def failed(self) -> int:
        """Number of initial states whose motion diverged."""
        return int(np.sum(self.labels == FAILED))

    def shares(self, confidence: float = 0.95) -> Array:
        """(n_attractors, 3) fraction of the initial states, and ends of its Wilson interval."""
        n = self.labels.size
        rows = [[c / n, *wilson(int(c), n, confidence)] for c in self.counts]
        return np.array(rows).reshape(-1, 3)


def explore(
    sections_of: Sections,
    starts: Array,
    exchange: Indices | None = None,
    known: tuple[Attractor, ...] = (),
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Basins:
    """Integrate all initial states and identify the attractors that they lead to.

    They are integrated 64 at a time, so that memory does not grow with their number.

    Args:
        sections_of: maps states (m, n) to sections (m, points, n) after the transient, NaN where
            the motion diverged; see ``gear_sections``.
        starts: (n_starts, n) initial states.
        exchange: (n,) indices that swap left and right; mirror images then count as one attractor.
        known: attractors from an earlier call; they come first and keep their order.
        progress: wraps the iterable of batches, such as ``tqdm``.
    """
    attractors, labels = list(known), np.full(len(starts), FAILED)
    for first in progress(range(0, len(starts), CHUNK)):
        for i, section in enumerate(sections_of(starts[first : first + CHUNK]), start=first):
            if np.isfinite(section).all():
                attractor = attractor_of(section, exchange)
                labels[i] = match_known(attractor, attractors, exchange)
                if labels[i] == len(attractors):
                    attractors.append(replace(attractor, points=attractor.points.copy()))
    basins = Basins(tuple(attractors), labels)
    return basins if known else by_share(basins)


def by_share(basins: Basins) -> Basins:
    """Sort the attractors by descending number of initial states and renumber the labels."""
    order = np.argsort(-basins.counts, kind="stable")
    rank = np.append(np.argsort(order), FAILED)  # the last entry serves label -1
    return Basins(tuple(basins.attractors[i] for i in order), rank[basins.labels])


def wilson(count: int, n: int, confidence: float = 0.95) -> tuple[float, float]:
    """Confidence interval (low, high) of a fraction ``count / n``, after Wilson.

    J. Am. Stat. Assoc. 22 (1927) 209.
    """
    low, high = binomtest(count, n).proportion_ci(confidence, method="wilson")
    return float(low), float(high)


def gear_sections(
    model: Model, transient: int = 2000, points: int = 200, workers: int = 1
) -> Sections:
    """Return a function that maps initial states of a gear to its section points at phase 0.

    Args:
        transient: mesh cycles discarded before the section.
        points: mesh cycles recorded, one section point each.
        workers: threads among which the initial states are divided; the result does not depend on
            it.

    Returns:
        Function of initial states (m, n_state), in which states that effects add may be left out
        (at rest), that gives section points (m, points, n_state) with them, NaN where the motion
        diverged.
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
    """Draw n random initial states (n, n_state) at phase 0, without those that effects add.

    x (in b_c) and v (in b_c omega_n) of each mesh are uniform in -reach .. reach, left and right
    independently.
    """
    x, v = rng.uniform(-reach, reach, (2, n, model.layout.n_mesh))
    return np.array([state(model, *start, 0.0) for start in zip(x, v, strict=True)])


def slice_starts(model: Model, n: int, reach: float = 1.0) -> tuple[Array, Array]:
    """Return states at phase 0, mesh rates 0, on a plane: mean of left and right, difference.

    Args:
        reach: both coordinates lie in -reach .. reach, in b_c.

    Returns:
        axis: (n,) values of either coordinate, in b_c: centres of n equal cells.
        states: (n * n, n_state), without those that effects add, row by row, the difference rising
            from row to row; on sun and ring meshes ``x_L = mean + difference / 2`` and
            ``x_R = mean - difference / 2``.
    """
    axis = np.array([(i + 0.5) * 2.0 * reach / n - reach for i in range(n)])
    c, m = model.layout.n_classes, model.layout.n_mesh
    side = np.tile(np.repeat([0.5, -0.5], c), 2)
    starts = [
        state(model, shared + difference * side, np.zeros(m), 0.0)
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
    """Find the basins on the plane of ``slice_starts``; ``explore`` explains the arguments.

    If the gear is symmetric, half of the plane is integrated and mirrored.

    Returns:
        axis: (n,) values of either coordinate, in b_c.
        basins: labels (n, n), the left-right difference rising by row and the mean by column.
    """
    axis, starts = slice_starts(model, n, reach)
    exchange = symmetry(model)
    rows = n if exchange is None else (n + 1) // 2
    basins = explore(sections_of, starts[: rows * n], exchange, known=known, progress=progress)
    labels = basins.labels.reshape(rows, n)
    if exchange is not None:
        labels = np.concatenate([labels, labels[: n // 2][::-1]])
    whole = Basins(basins.attractors, labels)
    return axis, whole if known else by_share(whole)
