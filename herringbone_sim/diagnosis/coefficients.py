"""Coefficients of hypotheses, and the normal equations of any set of them from products."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from herringbone_sim.arrays import Array
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
        self._G = {o: np.stack([r[o].G for r in runs]) for o in self.observations}
        self._x = {o: np.stack([r[o].cross for r in runs]) for o in self.observations}
        # X'y with shared nuisances marginalised; in ``_G``, they are not.
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
        products = (self.chi2, *self._G.values(), *self._b.values())
        return all(bool(np.isfinite(values).all()) for values in products)

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
            G, b = self._G[o], self._b[o]
            products = np.zeros((runs, p, *b.shape[1:]))
            nuisances = np.zeros((runs, p, self._x[o].shape[1]))
            for i, coefficient in enumerate(self.base):
                for row, f, w in self._entries(coefficient, o):
                    products[:, i, row] += w[:, None] * G[:, row, f]
                    nuisances[:, i] += w[:, None] * self._x[o][:, :, row, f]
            self._base_G[o], self._base_x[o] = products, nuisances
            for i, coefficient in enumerate(self.base):
                for row, f, w in self._entries(coefficient, o):
                    self.base_A[:, :, i] += products[:, :, row, f] * w[:, None]
                    self.base_b[:, i] += b[:, row, f] * w
            self.base_A -= nuisances @ nuisances.transpose(0, 2, 1)

    def normal_equations(self, coefficients: Sequence[Coefficient]) -> tuple[Array, Array]:
        """Normal equations A (runs, p, p), b (runs, p) of the base, then these coefficients."""
        n, q, runs = len(self.base), len(coefficients), len(self.runs)
        A, b = np.zeros((runs, n + q, n + q)), np.zeros((runs, n + q))
        A[:, :n, :n], b[:, :n] = self.base_A, self.base_b
        for o in self.observations:
            entries = [(i, e) for i, c in enumerate(coefficients) for e in self._entries(c, o)]
            if not entries:
                continue
            X = np.zeros((runs, q, self._x[o].shape[1]))
            for row in dict.fromkeys(row for _, (row, _, _) in entries):
                of_row = [(i, f, w) for i, (at_row, f, w) in entries if at_row == row]
                at = {f: k for k, f in enumerate(dict.fromkeys(f for _, f, _ in of_row))}
                index = np.array(list(at))
                W = np.zeros((runs, q, len(index)))
                for i, f, w in of_row:
                    W[:, i, at[f]] += w
                T = W.transpose(0, 2, 1)
                A[:, n:, n:] += W @ self._G[o][:, row][:, index[:, None], index] @ T
                A[:, :n, n:] += self._base_G[o][:, :, row, index] @ T
                b[:, n:] += (W @ self._b[o][:, row, index][:, :, None])[:, :, 0]
                X += W @ self._x[o][:, :, row, index].transpose(0, 2, 1)
            A[:, n:, n:] -= X @ X.transpose(0, 2, 1)
            A[:, :n, n:] -= self._base_x[o] @ X.transpose(0, 2, 1)
        A[:, n:, :n] = A[:, :n, n:].transpose(0, 2, 1)
        return A, b

    def _entries(self, coefficient: Coefficient, o: str) -> list[tuple[int, int, Array]]:
        """Triples of row, index of the function and weights (runs,) in observation ``o``."""
        placement = coefficient.placements.get(o)
        if placement is None:
            return []
        index = self._function_index[o]
        return [(row, index[f], w) for row, f, w in placement.entries]
