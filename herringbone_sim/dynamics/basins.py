"""Basins of attraction: the attractor that each initial state leads to, and its share of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from herringbone_sim.analysis.periods import TOLERANCE
from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.model import Model, initial_state, state
from herringbone_sim.dynamics.attractors import Attractor, attractor_of, match_known
from herringbone_sim.dynamics.flow import symmetry

Sections = Callable[[Array], Array]
FAILED = -1
CHUNK = 64


@dataclass(frozen=True)
class Basins:
    """Attractors that a set of initial states leads to.

    Attributes:
        attractors: known ones first, as given to ``explore``; without any, by descending share.
        labels: index into ``attractors`` for each initial state, (n_starts,) or (n, n) for a plane
            of them; -1 where the run failed.
    """

    attractors: tuple[Attractor, ...]
    labels: Indices

    @property
    def counts(self) -> Indices:
        """(n_attractors,) number of initial states that lead to each attractor."""
        return np.bincount(self.labels[self.labels >= 0], minlength=len(self.attractors))

    @property
    def failed(self) -> int:
        """Number of initial states whose run failed."""
        return int(np.sum(self.labels == FAILED))

    def shares(self, confidence: float = 0.95) -> Array:
        """Share of all initial states and its Wilson interval: (n_attractors, 3) share, low,
        high.
        """
        n = self.labels.size
        return np.array([[c / n, *wilson(int(c), n, confidence)] for c in self.counts])


def explore(
    sections_of: Sections,
    starts: Array,
    exchange: Indices | None = None,
    tolerance: float = TOLERANCE,
    known: tuple[Attractor, ...] = (),
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Basins:
    """Integrate all initial states and identify the attractors that they lead to.

    They are integrated 64 at a time, so that memory does not grow with their number.

    Args:
        sections_of: maps states (m, n) to sections (m, points, n) after the transient, NaN where a
            run failed; see ``gear_sections``.
        starts: (n_starts, n) initial states.
        exchange: (n,) indices that swap left and right; mirror images then count as one attractor.
        tolerance: largest RMS distance of section points that count as one, in the units of the
            state.
        known: attractors found before; they come first and keep their order.
        progress: wraps the iterable of batches, such as ``tqdm``.
    """
    found, labels = list(known), np.full(len(starts), FAILED)
    for first in progress(range(0, len(starts), CHUNK)):
        for i, section in enumerate(sections_of(starts[first : first + CHUNK]), start=first):
            if np.isfinite(section).all():
                attractor = attractor_of(section, exchange, tolerance)
                labels[i] = match_known(attractor, found, exchange, tolerance)
                if labels[i] == len(found):
                    found.append(replace(attractor, points=attractor.points.copy()))
    basins = Basins(tuple(found), labels)
    return basins if known else by_share(basins)


def by_share(basins: Basins) -> Basins:
    """Sort the attractors by descending share and renumber the labels."""
    order = np.argsort(-basins.counts, kind="stable")
    rank = np.append(np.argsort(order), FAILED)  # the last one serves label -1
    return Basins(tuple(basins.attractors[i] for i in order), rank[basins.labels])


def wilson(count: int, n: int, confidence: float = 0.95) -> tuple[float, float]:
    """Confidence interval (low, high) of a share ``count / n``; Wilson, J. Am. Stat. Assoc. 22
    (1927) 209.
    """
    z = float(norm.ppf(0.5 + 0.5 * confidence))
    share = count / n
    middle = share + z**2 / (2 * n)
    half = z * float(np.sqrt(share * (1 - share) / n + z**2 / (4 * n**2)))
    scale = 1 + z**2 / n
    return max((middle - half) / scale, 0.0), min((middle + half) / scale, 1.0)


def gear_sections(
    model: Model, transient: int = 2000, points: int = 200, workers: int = 1
) -> Sections:
    """Function that maps initial states of a gear to their sections at phase 0.

    Args:
        transient: mesh cycles left out before the section.
        points: mesh cycles recorded, one section point each.
        workers: threads among which the initial states are divided; the result does not depend on
            it.

    Returns:
        Function of initial states (n, n_state) that gives section points (n, points, n_state),
        NaN where the motion diverged.
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
    """Random initial states (n, n_state), uniform over x and v of the meshes.

    x (in b_c) and v (in b_c omega_n) of each mesh are drawn from -reach .. reach, left and right
    independently.
    """
    x, v = rng.uniform(-reach, reach, (2, n, model.layout.n_mesh))
    return np.array([state_at(model, *one) for one in zip(x, v, strict=True)])


def state_at(model: Model, x: Array, v: Array) -> Array:
    """State (n_state,) at phase 0 with given relative displacements x and velocities v (n_mesh,).

    Further states of effects take their initial values.
    """
    y = initial_state(model)
    y[: model.layout.n_state] = state(model, x, v, 0.0)
    return y


def slice_starts(model: Model, n: int, reach: float = 1.0) -> tuple[Array, Array]:
    """Initial states at rest over a plane: mean left-right displacement against their difference.

    Returns:
        axis: (n,) values of either coordinate, in b_c.
        states: (n * n, n_state) row by row, the difference rising from row to row; on sun and ring
            meshes ``x_L = mean + difference / 2`` and ``x_R = mean - difference / 2``.
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
    """Find the basins on the plane of ``slice_starts``; a symmetric gear is integrated on half of
    it.

    Returns:
        axis: (n,) values of either coordinate, in b_c.
        basins: labels (n, n), the left-right difference rising by row and the mean by column.
    """
    axis, starts = slice_starts(model, n, reach)
    exchange = symmetry(model)
    rows = n if exchange is None else (n + 1) // 2
    found = explore(sections_of, starts[: rows * n], exchange, known=known, progress=progress)
    labels = found.labels.reshape(rows, n)
    if exchange is not None:
        labels = np.concatenate([labels, labels[: n // 2][::-1]])
    return axis, Basins(found.attractors, labels)
