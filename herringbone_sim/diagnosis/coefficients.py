"""Coefficients of hypotheses, and the normal equations of any set of them from products."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.diagnosis.products import Products


@dataclass(frozen=True)
class Placement:
    """Where a coefficient acts in one observation: on k functions, each in one row.

    Attributes:
        rows: (k,) indices of the rows.
        functions: (k,) names of the functions.
        weights: (runs, k) amplitude of each function for a coefficient of 1.
    """

    rows: tuple[int, ...]
    functions: tuple[str, ...]
    weights: Array

    @cached_property
    def entries(self) -> list[tuple[int, str, Array]]:
        """Triples of row, function and weights (runs,)."""
        return list(zip(self.rows, self.functions, self.weights.T, strict=True))


@dataclass(frozen=True)
class Coefficient:
    """One scalar unknown of a hypothesis.

    Attributes:
        name: as in reports.
        sd: prior standard deviation, in the unit of the coefficient.
        bound: largest deviation from ``center``.
        placements: where it acts, by observation.
        center: prior mean; 1 for what is present or absent, as an exchange of channels.
        departs_from: 0, or, for a departure from the catalogue's curve, the number of coefficients
            of the effect itself, which precede its first departure; the prior of the departure
            scales with their size.
        scales_with_effect: whether its prior is scaled by the effect's size (``PRIOR_SCALES``);
            false where columns change with the amplitudes, as of a stiffness in series.
    """

    name: str
    sd: float
    bound: float
    placements: dict[str, Placement]
    center: float = 0.0
    departs_from: int = 0
    scales_with_effect: bool = True


def functions_used(coefficients: Sequence[Coefficient]) -> dict[str, list[str]]:
    """Names of the functions on which coefficients act, by observation."""
    by_observation: dict[str, dict[str, None]] = {}
    for c in coefficients:
        for o, placement in c.placements.items():
            by_observation.setdefault(o, {}).update(dict.fromkeys(placement.functions))
    return {o: list(names) for o, names in by_observation.items()}


def amplitudes(
    coefficients: Sequence[Coefficient], mean: Array, runs: int, rows: Mapping[str, int]
) -> dict[str, dict[str, Array]]:
    """Amplitudes (runs, rows) of the functions of p coefficients, by observation and function.

    Args:
        mean: (p,) values of the coefficients; (p, runs) where they differ between runs.
    """
    by_observation: dict[str, dict[str, Array]] = {}
    for c, value in zip(coefficients, mean, strict=True):
        for o, placement in c.placements.items():
            by_function = by_observation.setdefault(o, {})
            for row, f, w in placement.entries:
                a = by_function.setdefault(f, np.zeros((runs, rows[o])))
                a[:, row] += value * w
    return by_observation


class CampaignProducts:
    """Products of all runs, and the normal equations of any set of coefficients.

    Args:
        runs: products of each run, by observation. All runs have the same observations, rows and
            functions; rows that a run has not recorded are zero.
        base: coefficients contained in every hypothesis: the tolerances.

    Attributes:
        chi2: (runs,) chi2 at the point of linearisation, nuisances marginalised.
        base_A, base_b: (runs, p, p), (runs, p) normal equations of the base.
    """

    def __init__(self, runs: Sequence[dict[str, Products]], base: Sequence[Coefficient]) -> None:
        self.runs = tuple(runs)
        self.base = tuple(base)
        self.observations = tuple(runs[0])
        self._function_index = {
            o: {name: i for i, name in enumerate(p.functions)} for o, p in runs[0].items()
        }
        self._x = {o: np.stack([r[o].cross for r in runs]) for o in self.observations}
        # X'y with shared nuisances marginalised; in ``Products.grams``, they are not.
        self._b = {
            o: np.stack([r[o].c - np.tensordot(r[o].cross_y, r[o].cross, 1) for r in runs])
            for o in self.observations
        }
        self.chi2 = np.array(
            [sum(float(p.chi2_without_nuisance.sum()) for p in r.values()) for r in runs]
        )
        self._prepare_base()

    @property
    def is_finite(self) -> bool:
        """Whether all products are finite; they are not where the motion of a run diverges."""
        products = (self.chi2, *self._b.values())
        return all(bool(np.isfinite(values).all()) for values in products) and all(
            p.grams.is_finite for of_run in self.runs for p in of_run.values()
        )

    @property
    def counts(self) -> dict[str, float]:
        """Number of independent values in the recorded rows of all runs, by observation."""
        return {o: sum(r[o].values for r in self.runs) for o in self.observations}

    def _prepare_base(self) -> None:
        """Store the products of the base with itself, with all functions and with nuisances."""
        runs, p = len(self.runs), len(self.base)
        self._base_G, self._base_x = {}, {}
        self.base_A, self.base_b = np.zeros((runs, p, p)), np.zeros((runs, p))
        for o in self.observations:
            b, x = self._b[o], self._x[o]
            products = np.zeros((runs, p, *b.shape[1:]))
            nuisances = np.zeros((runs, p, x.shape[1]))
            of_rows = list(self._weights(self.base, o))
            for row, index, W in of_rows:
                for r, of_run in enumerate(self.runs):
                    products[r, :, row] = of_run[o].grams.times(row, index, W[r])
                nuisances += W @ x[:, :, row, index].transpose(0, 2, 1)
                self.base_b += (W @ b[:, row, index][:, :, None])[:, :, 0]
            for row, index, W in of_rows:
                self.base_A += products[:, :, row, index] @ W.transpose(0, 2, 1)
            self.base_A -= nuisances @ nuisances.transpose(0, 2, 1)
            self._base_G[o], self._base_x[o] = products, nuisances

    def normal_equations(self, coefficients: Sequence[Coefficient]) -> tuple[Array, Array]:
        """Normal equations A (runs, p, p), b (runs, p) of the base, then these coefficients."""
        n, q, runs = len(self.base), len(coefficients), len(self.runs)
        A, b = np.zeros((runs, n + q, n + q)), np.zeros((runs, n + q))
        A[:, :n, :n], b[:, :n] = self.base_A, self.base_b
        for o in self.observations:
            X = np.zeros((runs, q, self._x[o].shape[1]))
            for rows, index, weights in self._weights_alike(coefficients, o):
                row, each = rows[:, None], slice(None)
                W = weights.transpose(0, 2, 1, 3).reshape(runs, q, -1)
                T = W.transpose(0, 2, 1)
                for r, of_run in enumerate(self.runs):
                    A[r, n:, n:] += of_run[o].grams.weighted(rows, index, weights[r])
                G, x = (whole[o][each, each, row, index] for whole in (self._base_G, self._x))
                A[:, :n, n:] += G.reshape(runs, n, T.shape[1]) @ T
                b[:, n:] += (W @ self._b[o][each, row, index].reshape(runs, -1, 1))[:, :, 0]
                X += W @ x.reshape(*x.shape[:2], T.shape[1]).transpose(0, 2, 1)
            A[:, n:, n:] -= X @ X.transpose(0, 2, 1)
            A[:, :n, n:] -= self._base_x[o] @ X.transpose(0, 2, 1)
        A[:, n:, :n] = A[:, :n, n:].transpose(0, 2, 1)
        return A, b

    def _weights(
        self, coefficients: Sequence[Coefficient], o: str
    ) -> Iterator[tuple[int, Indices, Array]]:
        """Yield each row of observation ``o`` on which coefficients act.

        With the row, the indices (k,) of the functions on which they act there, and their weights
        (runs, coefficients, k).
        """
        at = self._function_index[o]
        by_row: dict[int, list[tuple[int, int, Array]]] = {}
        for i, coefficient in enumerate(coefficients):
            placement = coefficient.placements.get(o)
            for row, name, w in () if placement is None else placement.entries:
                by_row.setdefault(row, []).append((i, at[name], w))
        for row, entries in by_row.items():
            index = {f: k for k, f in enumerate(dict.fromkeys(f for _, f, _ in entries))}
            W = np.zeros((len(self.runs), len(coefficients), len(index)))
            for i, f, w in entries:
                W[:, i, index[f]] += w
            yield row, np.array(list(index)), W

    def _weights_alike(
        self, coefficients: Sequence[Coefficient], o: str
    ) -> Iterator[tuple[Indices, Indices, Array]]:
        """Yield rows (g,) with the same functions together; otherwise as ``_weights``.

        Weights are (runs, g, coefficients, k).
        """
        alike: dict[bytes, list[tuple[int, Indices, Array]]] = {}
        for row, index, W in self._weights(coefficients, o):
            alike.setdefault(index.tobytes(), []).append((row, index, W))
        for group in alike.values():
            rows, (index, *_), weights = zip(*group, strict=True)
            yield np.array(rows), index, np.stack(weights, axis=1)
