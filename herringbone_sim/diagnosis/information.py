"""Fisher information of a set of runs on each effect, alone and against rival hypotheses.

Expected chi2 added by an effect of size one, and the part of it left after a fit of another
hypothesis, with tolerances and the rival's coefficients profiled out (Lehmann and Casella, Theory
of Point Estimation, 2.6). Linear about the nominal machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array

from herringbone_sim.arrays import Array, Flags
from herringbone_sim.diagnosis.coefficients import CampaignProducts, Coefficient
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.diagnosis.regression import posterior_mean
from herringbone_sim.diagnosis.score import DEPARTURE_ROUNDS, MAX_DEPARTURE_SD, PRIOR_SCALES


class Information:
    """Expected chi2 of true effects, and the chi2 that hypotheses fitted to them leave.

    Size one is the moderate effect: its own coefficients at the standard deviations of their
    priors, of several in the direction that adds least chi2.

    Args:
        campaign: products about the nominal machine.
        truths: effects assumed true, without departures from their curves.
        hypotheses: rivals fitted to them.

    Attributes:
        squares: (truths,) chi2 added at size one, tolerances fitted without bounds.
        by_run: (truths, runs) fraction of it in each run.
        left: (truths, hypotheses) chi2 left at size one by each hypothesis, tolerances fitted
            without bounds.
        count: number of whitened values.
    """

    def __init__(
        self,
        campaign: CampaignProducts,
        truths: Sequence[Hypothesis],
        hypotheses: Sequence[Hypothesis],
    ) -> None:
        self._hypotheses = hypotheses
        base = campaign.base
        n = len(base)
        self._sd = np.array([c.sd for c in base])
        self._bound = np.array([c.bound for c in base])
        mains = [c for h in truths for c in h.coefficients[: h.n_own]]
        others = [c for h in hypotheses for c in h.coefficients]
        of_mains, of_others = (np.array([c.sd for c in some]) for some in (mains, others))
        self._A = campaign.base_A.sum(0)
        self._factor = cho_factor(self._A + np.diag(self._sd**-2.0))
        at = np.cumsum([0, *(h.n_own for h in truths)])
        weak = np.zeros((len(truths), len(mains)))
        squares, raw, shares = [], [], []
        for i, h in enumerate(truths):
            own = slice(at[i], at[i + 1])
            A, _ = campaign.normal_equations(h.coefficients[: h.n_own])
            A[:, n:] *= of_mains[own, None]
            A[:, :, n:] *= of_mains[own]
            step = np.concatenate([-cho_solve(self._factor, A[:, :n, n:].sum(0)), np.eye(h.n_own)])
            per_run = step.T @ A @ step
            least, directions = np.linalg.eigh(per_run.sum(0))
            weak[i, own] = directions[:, 0]
            squares.append(max(float(least[0]), 0.0))
            raw.append(float(weak[i, own] @ A[:, n:, n:].sum(0) @ weak[i, own]))
            by_run = weak[i, own] @ per_run @ weak[i, own]
            shares.append(by_run / max(float(by_run.sum()), 1e-300))
        cross = (weak * of_mains) @ cross_gram(campaign, mains, [*base, *others])
        self._with_base, self._with_others = cross[:, :n], cross[:, n:] * of_others
        self._free = [cho_solve(self._factor, row) for row in self._with_base]
        self._fitted = (-1, 0.0, np.zeros(n))  # truth, size, tolerances
        self._raw = np.array(raw)
        self.squares, self.by_run = np.array(squares), np.array(shares)
        self.count = sum(p.values for of_run in campaign.runs for p in of_run.values())
        ends = np.cumsum([0, *(len(h.coefficients) for h in hypotheses)])
        self._at = [slice(a, b) for a, b in pairwise(ends.tolist())]
        self._hypothesis_gram: list[tuple[Array, Array]] = []
        self.left = np.empty((len(truths), len(hypotheses)))
        for j, h in enumerate(hypotheses):
            A = campaign.normal_equations(h.coefficients)[0].sum(0)
            scale = of_others[self._at[j]]
            self._hypothesis_gram.append((A[:n, n:] * scale, A[n:, n:] * np.outer(scale, scale)))
            self.left[:, j] = np.maximum(self.squares - self._reduction(j), 0.0)

    def _reduction(self, j: int) -> Array:
        """Chi2 (truths,) removed by hypothesis j at size one, tolerances without bounds."""
        of_h, G = self._hypothesis_gram[j]
        X = self._with_others[:, self._at[j]]
        X = X - cho_solve(self._factor, self._with_base.T).T @ of_h
        return _reduction_with_departures(
            self._hypotheses[j], G - of_h.T @ cho_solve(self._factor, of_h), X
        )

    def seen(self, i: int, size: float) -> float:
        """Chi2 that truth i adds at a size, with tolerances fitted inside their bounds."""
        if self._tolerances_inside(i, size):
            return float(size**2 * self.squares[i])
        mean = self._tolerances(i, size)
        taken = 2.0 * size * self._with_base[i] @ mean - mean @ self._A @ mean
        return max(float(size**2 * self._raw[i] - taken), 0.0)

    def left_at(self, i: int, j: int, size: float) -> float:
        """Chi2 of truth i at a size that hypothesis j leaves, tolerances inside their bounds."""
        if self._tolerances_inside(i, size):
            return float(size**2 * self.left[i, j])
        h, (of_h, G) = self._hypotheses[j], self._hypothesis_gram[j]
        b = size * np.concatenate([self._with_base[i], self._with_others[i, self._at[j]]])
        A = np.block([[self._A, of_h], [of_h.T, G]])
        bent, wide = _priors(h, size)
        sd, n = np.where(bent, size, wide), len(self._sd)
        mean = np.append(self._tolerances(i, size), np.zeros(len(sd)))
        for _ in range(DEPARTURE_ROUNDS + 1):
            bound = np.append(self._bound, np.where(bent, MAX_DEPARTURE_SD * sd, np.inf))
            mean = posterior_mean(A, b, np.append(self._sd, sd), bound, mean)
            own = float(np.abs(mean[n:][~bent]).max(initial=0.0))
            sd = np.where(bent, max(own, PRIOR_SCALES[0] ** 2 * size), wide)
            if not bent.any():
                break
        taken = 2.0 * b @ mean - mean @ A @ mean
        return max(float(size**2 * self._raw[i] - taken), 0.0)

    def _tolerances(self, i: int, size: float) -> Array:
        """(p,) tolerances fitted to truth i at a size, inside their bounds; the last is kept."""
        if self._fitted[:2] != (i, size):
            mean = posterior_mean(self._A, size * self._with_base[i], self._sd, self._bound)
            self._fitted = (i, size, mean)
        return self._fitted[2]

    def _tolerances_inside(self, i: int, size: float) -> bool:
        """Whether the unbounded fit of tolerances to truth i stays inside their bounds."""
        return bool(np.all(np.abs(size * self._free[i]) <= self._bound))


def _priors(h: Hypothesis, size: float) -> tuple[Flags, Array]:
    """(k,) which coefficients are departures from the curve; (k,) prior deviations of the others.

    Deviations are in units of the moderate effect, wide enough for a true effect of ``size``.
    """
    bent = np.array([c.departs_from > 0 for c in h.coefficients])
    wide = [
        PRIOR_SCALES[-1] * max(size, 1.0) if c.scales_with_effect else 1.0 for c in h.coefficients
    ]
    return bent, np.array(wide)


def _reduction_with_departures(h: Hypothesis, G: Array, X: Array) -> Array:
    """Chi2 (truths,) of each truth that a hypothesis of k coefficients removes.

    Prior and bounds of departures from the catalogue's curve scale with the fitted size of the
    effect's own parameters, so both are found by iteration.

    Args:
        G: (k, k) Gram matrix of its columns.
        X: (truths, k) products of its columns with each truth.
    """
    bent, wide = _priors(h, 1.0)
    sd = np.broadcast_to(np.where(bent, 1.0, wide), X.shape)
    own = G[np.ix_(~bent, ~bent)] + np.diag(wide[~bent] ** -2.0)
    for _ in range(DEPARTURE_ROUNDS + 1):
        mean = np.linalg.solve(G + _diagonal(sd**-2.0), X[:, :, None])[:, :, 0]
        mean = np.where(bent, np.clip(mean, -MAX_DEPARTURE_SD * sd, MAX_DEPARTURE_SD * sd), mean)
        rest = X[:, ~bent] - mean[:, bent] @ G[np.ix_(bent, ~bent)]
        mean[:, ~bent] = np.linalg.solve(own, rest.T).T
        size = np.maximum(np.abs(mean[:, ~bent]).max(axis=1, initial=0.0), PRIOR_SCALES[0] ** 2)
        sd = np.where(bent, size[:, None], wide)
    taken = 2.0 * np.sum(mean * X, axis=1) - np.sum((mean @ G) * mean, axis=1)
    return np.asarray(taken)


def _diagonal(values: Array) -> Array:
    """(n, k, k) diagonal matrices of rows (n, k)."""
    return np.asarray(values[:, :, None] * np.eye(values.shape[1]))


def cross_gram(
    campaign: CampaignProducts, ones: Sequence[Coefficient], others: Sequence[Coefficient]
) -> Array:
    """(ones, others) products of the whitened columns of two sets of coefficients, over all runs.

    Nuisance parameters are marginalised.
    """
    gram = np.zeros((len(ones), len(others)))
    for o in campaign.observations:
        for r, of_run in enumerate(campaign.runs):
            p = of_run[o]
            at = {name: i for i, name in enumerate(p.functions)}
            left, right = (_weights(c, o, r, at, len(p.c)) for c in (ones, others))
            shared = [np.zeros((len(c), len(p.cross))) for c in (ones, others)]
            for row in range(len(p.c)):
                acting = np.unique(right[row].indices).astype(int)
                weights = right[row][:, acting].toarray()
                gram += left[row] @ p.grams.times(row, acting, weights).T
                for sums, w in zip(shared, (left[row], right[row]), strict=True):
                    sums += w @ p.cross[:, row].T
            gram -= shared[0] @ shared[1].T
    return gram


def _weights(
    coefficients: Sequence[Coefficient], o: str, r: int, at: dict[str, int], rows: int
) -> list[csr_array]:
    """Weights (coefficients, functions) of run r in observation o, a sparse matrix per row."""
    rows_of: list[list[int]] = [[] for _ in range(rows)]
    functions: list[list[int]] = [[] for _ in range(rows)]
    weights: list[list[float]] = [[] for _ in range(rows)]
    for i, c in enumerate(coefficients):
        placement = c.placements.get(o)
        for row, f, w in placement.entries if placement is not None else ():
            rows_of[row].append(i)
            functions[row].append(at[f])
            weights[row].append(float(w[r]))
    shape = len(coefficients), len(at)
    every = zip(rows_of, functions, weights, strict=True)
    return [csr_array((w, (i, f)), shape=shape) for i, f, w in every]
