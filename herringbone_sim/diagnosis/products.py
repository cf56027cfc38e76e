"""Gram matrices of whitened columns, computed once for all hypotheses.

A block is one observation of one run: R rows (residuals over time, such as one for each mesh) and
Q columns (what a unit amplitude of each function adds to a row). A hypothesis is a weighted sum of
functions on rows, so its normal equations are weighted sums of entries of these matrices. Nuisance
parameters of a row (drift, hum) and of a run (encoder eccentricity) have a Gaussian prior and are
marginalised here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.diagnosis.grams import DenseGrams, Grams, GramsOfColumns

NO_OFFSET = 1e-6  # standard deviation over the noise that stands for zero; its inverse is used


@dataclass(frozen=True)
class Block:
    """One observation of one run: n samples, R rows, Q functions.

    Attributes:
        observation: name of the observation.
        residual, sigma: (n, R) measured minus expected, and the standard deviation of its noise.
        functions: names of the columns.
        columns: (n, R, Q - C) what a unit amplitude of each function adds to the residual.
        nuisance: (n, R, S) columns of S nuisance parameters of each row.
        nuisance_sd: (R, S) their prior standard deviations.
        shared: (T, R, Q) amplitudes of the functions by a unit of each of T nuisance parameters
            that act on several rows at once.
        shared_sd: (T,) their prior standard deviations.
        independent_share: number of independent values over the number of samples.
        sample_index: (n,) index in the run of each sample of the residual; None: all samples.
        common_columns: (n, C) columns of the last C functions, which are equal in all rows, so
            that their products are computed once; allowed only where the noise is constant in time
            and all rows have the same nuisance columns. None: C = 0.
    """

    observation: str
    residual: Array
    sigma: Array
    functions: tuple[str, ...]
    columns: Array
    nuisance: Array
    nuisance_sd: Array
    shared: Array
    shared_sd: Array
    independent_share: float = 1.0
    sample_index: Indices | None = None
    common_columns: Array | None = None

    def columns_of(self, row: int) -> Array:
        """Columns (n, Q) of all functions in one row."""
        own = self.columns[:, row]
        return own if self.common_columns is None else np.hstack([own, self.common_columns])


@dataclass(frozen=True)
class Products:
    """Products of one block with the nuisance parameters of single rows marginalised.

    Attributes:
        functions: as in the block.
        grams: Gram matrices X'X (Q, Q) of the whitened columns of each row.
        c: (R, Q) X'y with the whitened residual y.
        chi2: (R,) y'y.
        count: (R,) number of independent values.
        cross: (T, R, Q) L^-1 N'X with the columns N of the shared nuisances; LL' is N'N plus their
            prior precision.
        cross_y: (T,) L^-1 N'y, summed over the rows.
    """

    functions: tuple[str, ...]
    grams: Grams
    c: Array
    chi2: Array
    count: Array
    cross: Array
    cross_y: Array

    @property
    def values(self) -> float:
        """Number of independent values in recorded rows; ``chi2`` of the others is exactly 0."""
        return float(self.count[self.chi2 != 0.0].sum())

    @property
    def chi2_without_nuisance(self) -> Array:
        """(R,) chi2 with shared nuisances marginalised too.

        They lower the sum over the rows; each row is lowered in proportion to its ``chi2``.
        """
        whole = float(self.chi2.sum())
        shared = float(self.cross_y @ self.cross_y)
        return self.chi2 * (1.0 - shared / whole) if whole > 0.0 else self.chi2


def with_offsets(block: Block, offsets: Array | None, noise: Array | None) -> Block:
    """Block with a constant as one more nuisance of each row, and its noise times a factor (R,).

    Args:
        offsets: (R,) prior standard deviation of the constant, over the block's noise; None: no
            constant.
        noise: (R,) factor on the block's noise; None: 1.
    """
    sd = None if offsets is None else np.sqrt(np.mean(block.sigma**2, axis=0))
    if noise is not None:
        block = replace(block, sigma=block.sigma * noise)
    if offsets is None or sd is None:
        return block
    sd = np.maximum(offsets, NO_OFFSET) * sd
    constant = np.ones((*block.residual.shape, 1))
    return replace(
        block,
        nuisance=np.concatenate([block.nuisance, constant], axis=2),
        nuisance_sd=np.column_stack([block.nuisance_sd, sd]),
    )


def products(block: Block) -> Products:
    """Compute the products of a block, with nuisances of single rows marginalised."""
    n, R = block.residual.shape
    of_block = _dense_grams if block.common_columns is None else _grams_of_columns
    grams, c, chi2 = of_block(block)
    cross, cross_y = _shared_products(block, grams, c)
    return Products(
        block.functions,
        grams,
        c,
        chi2,
        np.full(R, n * block.independent_share),
        cross,
        cross_y,
    )


def _dense_grams(block: Block) -> tuple[Grams, Array, Array]:
    """Gram matrices, X'y (R, Q) and y'y (R,) of a block, with nuisances of rows marginalised."""
    _, R, Q = block.columns.shape
    G, c, chi2 = np.empty((R, Q, Q)), np.empty((R, Q)), np.empty(R)
    root = np.sqrt(block.independent_share)
    for row in range(R):
        w = root / block.sigma[:, row]
        X = np.column_stack([block.columns[:, row] * w[:, None], block.residual[:, row] * w])
        N = block.nuisance[:, row] * w[:, None]
        U = _whitened_products(N.T @ N, block.nuisance_sd[row], N.T @ X)
        whole = X.T @ X - U.T @ U
        G[row], c[row], chi2[row] = whole[:Q, :Q], whole[:Q, Q], whole[Q, Q]
    return DenseGrams(G), c, chi2


def _grams_of_columns(block: Block) -> tuple[Grams, Array, Array]:
    """``_dense_grams`` of a block with common columns."""
    assert block.common_columns is not None
    R, Q, N = block.residual.shape[1], len(block.functions), block.nuisance[:, 0]
    common = np.ascontiguousarray(block.common_columns.T)
    own = np.ascontiguousarray(block.columns.transpose(1, 2, 0))
    scale = block.independent_share / block.sigma[0] ** 2
    N_N, common_N = N.T @ N, common @ N
    nuisance = np.empty((R, N.shape[1], Q))
    c, chi2 = np.empty((R, Q)), np.empty(R)
    for row in range(R):
        y = block.residual[:, row]
        X_N = np.vstack([own[row] @ N, common_N, y @ N])
        U = _whitened_products(scale[row] * N_N, block.nuisance_sd[row], scale[row] * X_N.T)
        nuisance[row], of_y = U[:, :Q], U[:, Q]
        c[row] = scale[row] * np.append(own[row] @ y, common @ y) - of_y @ nuisance[row]
        chi2[row] = scale[row] * (y @ y) - of_y @ of_y
    return GramsOfColumns(own, common, scale, nuisance), c, chi2


def _whitened_products(N_N: Array, sd: Array, N_X: Array) -> Array:
    """U (S, k) such that U'U is what marginalising S nuisances takes from X'X.

    Args:
        N_N, N_X: N'N (S, S) and N'X (S, k) of whitened columns.
        sd: (S,) prior standard deviations of the nuisances.
    """
    if not len(sd):  # not every SciPy solves a system of none
        return np.zeros((0, N_X.shape[1]))
    root = np.linalg.cholesky(N_N + np.diag(sd**-2.0))
    return np.asarray(solve_triangular(root, N_X, lower=True, check_finite=False))


def _shared_products(block: Block, grams: Grams, c: Array) -> tuple[Array, Array]:
    """Return ``cross`` (T, R, Q) and ``cross_y`` (T,) of ``Products``.

    Args:
        grams, c: X'X and X'y (R, Q) of the block.
    """
    T = len(block.shared_sd)
    if not T:
        return np.zeros((0, *c.shape)), np.zeros(0)
    acting = np.flatnonzero(np.any(block.shared != 0.0, axis=(0, 1)))
    weights = block.shared[:, :, acting]
    cross = np.stack([grams.times(r, acting, weights[:, r]) for r in range(len(c))], axis=1)
    normal = cross[:, :, acting].reshape(T, -1) @ weights.reshape(T, -1).T
    cross_y = weights.reshape(T, -1) @ c[:, acting].ravel()
    root = np.linalg.cholesky(normal + np.diag(block.shared_sd**-2.0))
    whitened = np.linalg.solve(root, np.column_stack([cross.reshape(T, -1), cross_y]))
    return np.asarray(whitened[:, :-1].reshape(cross.shape)), np.asarray(whitened[:, -1])


def residual_without_nuisance(block: Block) -> Array:
    """Return residual / sigma (n, R), minus its fit by all nuisances at their posterior mean."""
    free, mean = _fitted_nuisances(block)
    root = np.sqrt(block.independent_share)
    return np.asarray((free[:, :, 0] - free[:, :, 1:] @ mean) / root)


def shared_nuisances(block: Block) -> Array:
    """Posterior mean (T,) of the nuisance parameters that act on several rows of a block.

    Those of single rows are marginalised; no effect is fitted.
    """
    return _fitted_nuisances(block)[1]


def _fitted_nuisances(block: Block) -> tuple[Array, Array]:
    """Fit the shared nuisances, with those of single rows marginalised.

    Returns:
        Residual and columns of the shared nuisances, whitened and without nuisances of the rows
        (n, R, 1 + T); the posterior mean (T,).
    """
    w = (np.sqrt(block.independent_share) / block.sigma)[:, :, None]
    rows = range(block.residual.shape[1])
    shared = np.stack([block.columns_of(row) @ block.shared[:, row].T for row in rows], axis=1)
    every = np.concatenate([block.residual[:, :, None], shared], axis=2) * w
    free = np.stack([_without_row_nuisances(block, row, every[:, row]) for row in rows], axis=1)
    normal = np.einsum("nrt,nru->tu", every[:, :, 1:], free)
    precision = np.diag(block.shared_sd**-2.0)
    return free, np.asarray(np.linalg.solve(normal[:, 1:] + precision, normal[:, 0]))


def _without_row_nuisances(block: Block, row: int, values: Array) -> Array:
    """Return whitened values (n, k) minus their ridge fit by a row's nuisances.

    Whitened: multiplied by the root of ``independent_share``, over the noise.
    """
    N = block.nuisance[:, row] * (np.sqrt(block.independent_share) / block.sigma[:, row])[:, None]
    if not N.size:
        return values
    normal = cho_factor(N.T @ N + np.diag(block.nuisance_sd[row] ** -2.0))
    return np.asarray(values - N @ cho_solve(normal, N.T @ values))


def recentred(p: Products, a: Array) -> Products:
    """Products of a linear observation about amplitudes ``a`` (R, Q) instead of zero."""
    acting = np.flatnonzero(np.any(a != 0.0, axis=0))
    along = np.vstack([p.grams.times(row, acting, w[None, acting]) for row, w in enumerate(a)])
    return replace(
        p,
        c=p.c - along,
        chi2=p.chi2 - 2.0 * np.sum(p.c * a, axis=1) + np.sum(along * a, axis=1),
        cross_y=p.cross_y - np.tensordot(p.cross, a, 2),
    )
