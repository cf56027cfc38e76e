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
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.sparse import csr_array

from herringbone_sim.diagnosis.products import Campaign, Coefficient
from herringbone_sim.diagnosis.search import SIZES, Hypothesis

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Information:
    """Expected whitened squares of effects of moderate size.

    Attributes:
        squares: (truths,) above those of the nominal machine, after the tolerances are fitted, in
            the direction of the effect's own parameters that shows least.
        by_run: (truths, runs) each run's share of them.
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
    taken = cho_solve(factor, with_base.T)

    at = np.cumsum([0, *(h.mains for h in truths)])
    own, shares = [], []
    for i, h in enumerate(truths):
        A, _ = campaign.normal(h.coefficients[: h.mains])
        p = slice(n, None)
        scale = np.outer(of_mains[at[i] : at[i + 1]], of_mains[at[i] : at[i + 1]])
        T = np.linalg.solve(normal, A[:, :n, p].sum(0))
        per = np.stack(
            [a[p, p] - a[:n, p].T @ T - T.T @ a[:n, p] + T.T @ a[:n, :n] @ T for a in A]
        )
        own.append(per.sum(0) * scale + T.T @ np.diag(of_base**-2.0) @ T * scale)
        values, vectors = np.linalg.eigh(own[-1])
        weak = vectors[:, 0]
        shares.append([float(weak @ (a * scale) @ weak) / max(values[0], 1e-300) for a in per])
    left = np.empty((len(truths), len(hypotheses)))
    first = 0
    for j, h in enumerate(hypotheses):
        q = slice(first, first + len(h.coefficients))
        first = q.stop
        A = campaign.normal(h.coefficients)[0].sum(0)
        scale = of_every[q]
        G = A[n:, n:] * np.outer(scale, scale)
        with_h = A[:n, n:] * scale
        G = G - with_h.T @ cho_solve(factor, with_h)
        X = with_others[:, q] - taken.T @ with_h
        widest = np.diag([SIZES[-1] ** -2.0 if c.sized else 1.0 for c in h.coefficients])
        L = np.linalg.cholesky(G + widest)
        U = solve_triangular(L, X.T, lower=True)
        for i in range(len(truths)):
            of = U[:, at[i] : at[i + 1]]
            left[i, j] = max(float(np.linalg.eigvalsh(own[i] - of.T @ of)[0]), 0.0)
    squares = np.array([max(float(np.linalg.eigvalsh(a)[0]), 0.0) for a in own])
    count = sum(
        float(p.count[p.energy != 0.0].sum()) for of_run in campaign.runs for p in of_run.values()
    )
    return Information(squares, np.array(shares), left, count)


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
    entries: list[tuple[list[int], list[int], list[float]]] = [([], [], []) for _ in range(rows)]
    for i, c in enumerate(coefficients):
        part = c.parts.get(o)
        for row, f, w in part.entries if part is not None else ():
            for store, value in zip(entries[row], (i, at[f], float(w[r])), strict=True):
                store.append(value)  # type: ignore[arg-type]
    shape = len(coefficients), len(at)
    return [csr_array((w, (i, f)), shape=shape) for i, f, w in entries]
