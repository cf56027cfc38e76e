"""What a set of runs would tell of each hypothesis, and what the others would leave of it.

The expected squares that an effect of size one adds, and those that remain once another hypothesis
was fitted to them: Fisher information, tolerances and the other's coefficients integrated out
(Lehmann and Casella, Theory of Point Estimation, 2.6). Linear about the nominal machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array

from herringbone_sim.diagnosis.products import Campaign, Coefficient
from herringbone_sim.diagnosis.regression import solve
from herringbone_sim.diagnosis.search import BENDINGS, FARTHEST, SIZES, Hypothesis

Array = NDArray[np.float64]


class Information:
    """Expected whitened squares of effects, the truths, and what hypotheses leave of them.

    Sizes are over a moderate one, in the direction of an effect's own parameters that shows least.

    Attributes:
        squares: (truths,) above those of the nominal machine at size one, as far as tolerances
            stay in their bounds.
        by_run: (truths, runs) share of them that each run tells.
        left: (truths, hypotheses) what is left at size one, likewise.
        count: whitened values.
    """

    def __init__(
        self, campaign: Campaign, truths: Sequence[Hypothesis], hypotheses: Sequence[Hypothesis]
    ) -> None:
        self._hypotheses = hypotheses
        base = campaign.base
        n = len(base)
        self._sd = np.array([c.sd for c in base])
        self._bound = np.array([c.bound for c in base])
        mains = [c for h in truths for c in h.coefficients[: h.mains]]
        others = [c for h in hypotheses for c in h.coefficients]
        of_mains, of_others = (np.array([c.sd for c in some]) for some in (mains, others))
        self._A = campaign.base_A.sum(0)
        self._factor = cho_factor(self._A + np.diag(self._sd**-2.0))
        at = np.cumsum([0, *(h.mains for h in truths)])
        weak = np.zeros((len(truths), len(mains)))
        squares, raw, shares = [], [], []
        for i, h in enumerate(truths):
            own = slice(at[i], at[i + 1])
            A, _ = campaign.normal(h.coefficients[: h.mains])
            A[:, n:] *= of_mains[own, None]
            A[:, :, n:] *= of_mains[own]
            step = np.concatenate([-cho_solve(self._factor, A[:, :n, n:].sum(0)), np.eye(h.mains)])
            per_run = step.T @ A @ step
            least, directions = np.linalg.eigh(per_run.sum(0))
            weak[i, own] = directions[:, 0]
            squares.append(max(float(least[0]), 0.0))
            raw.append(float(weak[i, own] @ A[:, n:, n:].sum(0) @ weak[i, own]))
            told = weak[i, own] @ per_run @ weak[i, own]
            shares.append(told / max(float(told.sum()), 1e-300))
        cross = (weak * of_mains) @ products_between(campaign, mains, [*base, *others])
        self._with_base, self._with_others = cross[:, :n], cross[:, n:] * of_others
        self._raw = np.array(raw)
        self.squares, self.by_run = np.array(squares), np.array(shares)
        self.count = sum(
            float(p.count[p.energy != 0.0].sum())
            for of_run in campaign.runs
            for p in of_run.values()
        )
        ends = np.cumsum([0, *(len(h.coefficients) for h in hypotheses)])
        self._at = [slice(a, b) for a, b in pairwise(ends.tolist())]
        self._of_h: list[tuple[Array, Array]] = []
        self.left = np.empty((len(truths), len(hypotheses)))
        for j, h in enumerate(hypotheses):
            A = campaign.normal(h.coefficients)[0].sum(0)
            scale = of_others[self._at[j]]
            self._of_h.append((A[:n, n:] * scale, A[n:, n:] * np.outer(scale, scale)))
            self.left[:, j] = np.maximum(self.squares - self._taken(j), 0.0)

    def _taken(self, j: int) -> Array:
        """Squares (truths,) that hypothesis j takes off, tolerances anywhere in their priors."""
        of_h, G = self._of_h[j]
        X = self._with_others[:, self._at[j]]
        X = X - cho_solve(self._factor, self._with_base.T).T @ of_h
        return _followed(self._hypotheses[j], G - of_h.T @ cho_solve(self._factor, of_h), X)

    def seen(self, i: int, size: float) -> float:
        """Squares that truth i adds at a size, tolerances in their bounds."""
        if self._inside(i, size):
            return float(size**2 * self.squares[i])
        mean = solve(self._A, size * self._with_base[i], self._sd, self._bound).mean
        taken = 2.0 * size * self._with_base[i] @ mean - mean @ self._A @ mean
        return max(float(size**2 * self._raw[i] - taken), 0.0)

    def left_at(self, i: int, j: int, size: float) -> float:
        """What hypothesis j leaves of truth i at a size, tolerances in their bounds."""
        if self._inside(i, size):
            return float(size**2 * self.left[i, j])
        h, (of_h, G) = self._hypotheses[j], self._of_h[j]
        b = size * np.concatenate([self._with_base[i], self._with_others[i, self._at[j]]])
        A = np.block([[self._A, of_h], [of_h.T, G]])
        bent, wide = _priors(h, size)
        sd, n = np.where(bent, size, wide), len(self._sd)
        for _ in range(BENDINGS + 1):
            bound = np.where(bent, FARTHEST * sd, np.inf)
            mean = solve(A, b, np.append(self._sd, sd), np.append(self._bound, bound)).mean
            own = float(np.abs(mean[n:][~bent]).max(initial=0.0))
            sd = np.where(bent, max(own, SIZES[0] ** 2 * size), wide)
            if not bent.any():
                break
        taken = 2.0 * b @ mean - mean @ A @ mean
        return max(float(size**2 * self._raw[i] - taken), 0.0)

    def _inside(self, i: int, size: float) -> bool:
        """Whether tolerances could take truth i without leaving their bounds."""
        free = size * cho_solve(self._factor, self._with_base[i])
        return bool(np.all(np.abs(free) <= self._bound))


def _priors(h: Hypothesis, size: float) -> tuple[NDArray[np.bool_], Array]:
    """Which coefficients depart from the catalogue's curve, and priors of the others."""
    bent = np.array([c.departs > 0 for c in h.coefficients])
    wide = [SIZES[-1] * max(size, 1.0) if c.sized else 1.0 for c in h.coefficients]
    return bent, np.array(wide)


def _followed(h: Hypothesis, G: Array, X: Array) -> Array:
    """Squares (truths,) that a hypothesis takes off those of each truth.

    The curve of an effect departs from the catalogue's in proportion to the effect: prior and
    bounds of its departures go with the size that its own parameters have.

    Args:
        G: (k, k) products of its columns; X: (truths, k) with each truth.
    """
    bent, wide = _priors(h, 1.0)
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
