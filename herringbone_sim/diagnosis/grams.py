"""Gram matrices of the whitened columns of a block: all entries, or computed where asked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array, Indices


@dataclass(frozen=True)
class DenseGrams:
    """Gram matrices with all entries: ``values`` (R, Q, Q)."""

    values: Array

    def weighted(self, rows: Indices, functions: Indices, weights: Array) -> Array:
        """Weights (g, p, k) on k functions on both sides of g rows' matrices: their sum (p, p)."""
        entries = self.values[rows[:, None, None], functions[:, None], functions]
        return np.asarray(np.tensordot(weights @ entries, weights, ((0, 2), (0, 2))))

    def times(self, row: int, functions: Indices, weights: Array) -> Array:
        """Weights (p, k) on k functions times a row's matrix: (p, Q)."""
        return np.asarray(weights @ self.values[row][functions])

    @property
    def is_finite(self) -> bool:
        """Whether the matrices are finite."""
        return bool(np.isfinite(self.values).all())


@dataclass(frozen=True)
class GramsOfColumns:
    """Gram matrices of columns most of which all rows share, computed where asked.

    There may be more columns than samples; then they take less memory than their matrices.

    Attributes:
        own: (R, Q - C, n) columns of each row.
        common: (C, n) columns of all rows.
        scale: (R,) factor on the products, which whitens them.
        nuisance: (R, S, Q) U of each row: U'U is what marginalising its nuisance parameters takes
            from the matrix.
    """

    own: Array
    common: Array
    scale: Array
    nuisance: Array

    def weighted(self, rows: Indices, functions: Indices, weights: Array) -> Array:
        """See ``DenseGrams``."""
        whole = np.zeros((weights.shape[1], weights.shape[1]))
        for row, w in zip(rows.tolist(), weights, strict=True):
            X = w @ self._columns(row, functions)
            U = w @ self.nuisance[row][:, functions].T
            whole += self.scale[row] * (X @ X.T) - U @ U.T
        return whole

    def times(self, row: int, functions: Indices, weights: Array) -> Array:
        """See ``DenseGrams``."""
        X = self.scale[row] * (weights @ self._columns(row, functions))
        U = weights @ self.nuisance[row][:, functions].T
        every = np.hstack([X @ self.own[row].T, X @ self.common.T])
        return np.asarray(every - U @ self.nuisance[row])

    def _columns(self, row: int, functions: Indices) -> Array:
        """Columns (k, n) of k functions in a row."""
        first = self.own.shape[1]
        if functions.size and functions.min() >= first:
            return np.asarray(self.common[functions - first])
        every = [self.own[row, q] if q < first else self.common[q - first] for q in functions]
        return np.stack(every) if every else np.zeros((0, self.own.shape[2]))

    @property
    def is_finite(self) -> bool:
        """Whether the columns are finite."""
        return bool(np.isfinite(self.own).all() and np.isfinite(self.common).all())


Grams = DenseGrams | GramsOfColumns
