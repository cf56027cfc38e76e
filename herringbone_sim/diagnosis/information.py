"""What a set of runs would tell of each hypothesis, and what the others would leave of it.

The expected squares that an effect of size one adds, and those that remain once another hypothesis
was fitted to them: Fisher information, tolerances and the other's coefficients integrated out
(Lehmann and Casella, Theory of Point Estimation, 2.6). Linear about the nominal machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array

from herringbone_sim.diagnosis.products import Campaign, Coefficient
from herringbone_sim.diagnosis.search import BENDINGS, FARTHEST, SIZES, Hypothesis

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Information:
    """Expected whitened squares of effects of moderate size.

    Attributes:
        squares: (truths,) above those of the nominal machine, tolerances fitted, in the
            direction of the effect's own parameters that shows least.
        by_run: (truths, runs) share of them that each run tells.
        left: (truths, hypotheses) what is left once a hypothesis is fitted too.
        count: whitened values.
    """

    squares: Array
    by_run: Array
    left: Array
    count: float


def information(
    campaign: Campaign, truths: Sequence[Hypothesis], hypotheses: Sequence[Hypothesis]
) -> Information:
    """Of truths, by the products of a campaign about the nominal machine."""
    base = campaign.base
    mains = [c for h in truths for c in h.coefficients[: h.mains]]
    every = [*base, *(c for h in hypotheses for c in h.coefficients)]
    n, sd = len(base), np.array([c.sd for c in (*base, *mains)])
    of_base, of_mains = sd[:n], sd[n:]
    normal = campaign.base_A.sum(0) + np.diag(of_base**-2.0)
    factor = cho_factor(normal)
    cross = products_between(campaign, mains, every)
    of_every = np.array([c.sd for c in every[n:]])
    with_base, with_others = cross[:, :n] * of_mains[:, None], cross[:, n:]
    with_others = with_others * np.outer(of_mains, of_every)
    at = np.cumsum([0, *(h.mains for h in truths)])
    squares, shares, weak = [], [], np.zeros((len(truths), len(mains)))
    for i, h in enumerate(truths):
        own = slice(at[i], at[i + 1])
        A, _ = campaign.normal(h.coefficients[: h.mains])
        A[:, n:] *= of_mains[own, None]
        A[:, :, n:] *= of_mains[own]
        step = np.concatenate([-cho_solve(factor, A[:, :n, n:].sum(0)), np.eye(h.mains)])
        per_run = step.T @ A @ step
        least, directions = np.linalg.eigh(
            per_run.sum(0) + (step[:n].T * of_base**-2.0) @ step[:n]
        )
        weak[i, own] = directions[:, 0]
        squares.append(max(float(least[0]), 0.0))
        told = weak[i, own] @ per_run @ weak[i, own]
        shares.append(told / max(float(told.sum()), 1e-300))
    with_others, with_base = weak @ with_others, weak @ with_base
    left = np.empty((len(truths), len(hypotheses)))
    first = 0
    for j, h in enumerate(hypotheses):
        q = slice(first, first + len(h.coefficients))
        first = q.stop
        A = campaign.normal(h.coefficients)[0].sum(0)
        of_h = A[:n, n:] * of_every[q]
        G = A[n:, n:] * np.outer(of_every[q], of_every[q]) - of_h.T @ cho_solve(factor, of_h)
        X = with_others[:, q] - cho_solve(factor, with_base.T).T @ of_h
        left[:, j] = np.maximum(np.array(squares) - _followed(h, G, X), 0.0)
    count = sum(
        float(p.count[p.energy != 0.0].sum()) for of_run in campaign.runs for p in of_run.values()
    )
    return Information(np.array(squares), np.array(shares), left, count)


def _followed(h: Hypothesis, G: Array, X: Array) -> Array:
    """Squares (truths,) that a hypothesis takes off those of each truth.

    The curve of an effect departs from the catalogue's in proportion to the effect: prior and
    bounds of its departures go with the size that its own parameters have.

    Args:
        G: (k, k) products of its columns; X: (truths, k) with each truth.
    """
    wide = np.array([SIZES[-1] if c.sized else 1.0 for c in h.coefficients])
    bent = np.array([c.departs > 0 for c in h.coefficients])
    sd = np.broadcast_to(np.where(bent, 1.0, wide), X.shape)
    own = G[np.ix_(~bent, ~bent)] + np.diag(wide[~bent] ** -2.0)
    for _ in range(BENDINGS + 1):
        mean = np.linalg.solve(G + _diagonal(sd**-2.0), X[:, :, None])[:, :, 0]
        mean = np.where(bent, np.clip(mean, -FARTHEST * sd, FARTHEST * sd), mean)
        rest = X[:, ~bent] - mean[:, bent] @ G[np.ix_(bent, ~bent)]
        mean[:, ~bent] = np.linalg.solve(own, rest.T).T
        size = np.maximum(np.abs(mean[:, ~bent]).max(axis=1, initial=0.0), SIZES[0] ** 2)
        sd = np.where(bent, size[:, None], wide)
    taken = 2.0 * np.sum(mean * X, axis=1) - np.sum((mean @ G) * mean, axis=1)
    return np.asarray(taken)


def _diagonal(values: Array) -> Array:
    """(n, k, k) diagonal matrices of rows (n, k)."""
    return np.asarray(values[:, :, None] * np.eye(values.shape[1]))


def products_between(
    campaign: Campaign, ones: Sequence[Coefficient], others: Sequence[Coefficient]
) -> Array:
    """(ones, others) products of whitened columns over all runs."""
    found = np.zeros((len(ones), len(others)))
    for o in campaign.observations:
        for r, of_run in enumerate(campaign.runs):
            p = of_run[o]
            at = {name: i for i, name in enumerate(p.functions)}
            left, right = (_weights(c, o, r, at, len(p.rows)) for c in (ones, others))
            shared = [np.zeros((len(c), len(p.cross))) for c in (ones, others)]
            for row, G in enumerate(p.G):
                found += left[row] @ (right[row] @ G).T
                for sums, w in zip(shared, (left[row], right[row]), strict=True):
                    sums += w @ p.cross[:, row].T
            found -= shared[0] @ shared[1].T
    return found


def _weights(
    coefficients: Sequence[Coefficient], o: str, r: int, at: dict[str, int], rows: int
) -> list[csr_array]:
    """(coefficients, functions) of a run, row by row."""
    rows_of: list[list[int]] = [[] for _ in range(rows)]
    functions: list[list[int]] = [[] for _ in range(rows)]
    weights: list[list[float]] = [[] for _ in range(rows)]
    for i, c in enumerate(coefficients):
        part = c.parts.get(o)
        for row, f, w in part.entries if part is not None else ():
            rows_of[row].append(i)
            functions[row].append(at[f])
            weights[row].append(float(w[r]))
    shape = len(coefficients), len(at)
    every = zip(rows_of, functions, weights, strict=True)
    return [csr_array((w, (i, f)), shape=shape) for i, f, w in every]
