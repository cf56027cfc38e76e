"""Elimination of the start states of windows from residuals and columns, by least squares.

Continuity constraints, here called ties, join neighbouring windows only. So the normal matrix is
block tridiagonal, and work grows linearly with the number of windows (block Cholesky: Golub and
Van Loan, Matrix Computations, sec. 4.5).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from herringbone_sim.arrays import Array

# Prior precisions over the largest entry, tried where rounding leaves the matrix indefinite.
ROUNDING_SHARES = (1e-12, 1e-8, 1e-4)


class BlockTridiagonal:
    """Cholesky factor of a symmetric positive definite matrix of W x W blocks.

    Where an entry is not finite, solutions are NaN.

    Args:
        own: (W, n, n) blocks on the diagonal.
        below: (W - 1, n, n) blocks below it.

    Raises:
        numpy.linalg.LinAlgError: the matrix is not positive definite.
    """

    def __init__(self, own: Array, below: Array) -> None:
        self._inverse, self._below = np.full_like(own, np.nan), np.empty_like(below)
        if np.isfinite(own).all() and np.isfinite(below).all():
            _factor(own, below, self._inverse, self._below)

    def solve(self, right: Array) -> Array:
        """Solution (W, n, k) for right sides (W, n, k)."""
        solution = np.array(right, order="C")
        _solve(self._inverse, self._below, solution)
        return solution


@njit(cache=True, nogil=True)
def _factor(own, below, inverse, factors):  # type: ignore[no-untyped-def]
    """Write inverse Cholesky factors (W, n, n) and the blocks (W - 1, n, n) below them."""
    rest = own[0].copy()
    for w in range(len(own)):
        if w:
            factors[w - 1] = np.dot(below[w - 1], inverse[w - 1].T)
            rest = own[w] - np.dot(factors[w - 1], factors[w - 1].T)
        inverse[w] = np.linalg.inv(np.linalg.cholesky(rest))


@njit(cache=True, nogil=True)
def _solve(inverse, below, solution):  # type: ignore[no-untyped-def]
    """Solve in place for right sides (W, n, k), by blocks of ``_factor``."""
    for w in range(len(solution)):
        if w:
            solution[w] -= np.dot(below[w - 1], solution[w - 1])
        solution[w] = np.dot(inverse[w], solution[w])
    for w in range(len(solution) - 1, -1, -1):
        if w + 1 < len(solution):
            solution[w] -= np.dot(below[w].T, solution[w + 1])
        solution[w] = np.dot(inverse[w].T, solution[w])


class WindowJacobian:
    """Jacobian J of W windows by their scaled start states.

    Rows are the readings of all windows, then the ties between them.

    Args:
        readings: (W, m, n) derivatives of the readings of each window, over the noise.
        ends: (W - 1, n, n) derivatives of the end of each window but the last, over ``jump_sd``.
        start: derivative of a scaled start state by itself, 1, over ``Windows.jump_sd``.

    Attributes:
        own, below: blocks of J'J, see ``BlockTridiagonal``.
        of_readings: (W, n, n) part of ``own`` by the readings.
    """

    def __init__(self, readings: Array, ends: Array, start: float) -> None:
        self._readings, self._ends, self._start = readings, ends, start
        self.of_readings = readings.transpose(0, 2, 1) @ readings
        self.own = self.of_readings.copy()
        self.own[:-1] += ends.transpose(0, 2, 1) @ ends
        self.own[1:] += start**2 * np.eye(readings.shape[2])
        self.below = -start * ends

    def times(self, states: Array) -> Array:
        """J times k vectors of start states (W, n, k), as (rows, k)."""
        ties = self._ends @ states[:-1] - self._start * states[1:]
        k = states.shape[2]
        readings = (self._readings @ states).reshape(self._readings[..., 0].size, k)
        return np.concatenate([readings, ties.reshape(self._ends[..., 0].size, k)])

    def transposed_times(self, rows: Array) -> Array:
        """J' times k vectors (rows, k), as (W, n, k)."""
        (W, m, n), k = self._readings.shape, rows.shape[1]
        product = self._readings.transpose(0, 2, 1) @ rows[: W * m].reshape(W, m, k)
        ties = rows[W * m :].reshape(W - 1, n, k)
        product[:-1] += self._ends.transpose(0, 2, 1) @ ties
        product[1:] -= self._start * ties
        return np.asarray(product)


def factored(jacobian: WindowJacobian, flat: float) -> BlockTridiagonal:
    """Factor of J'J plus a prior of precision ``flat``, or the least that rounding allows.

    Where states diverge, entries differ so much in size that rounding leaves J'J indefinite. The
    precision is then raised to a fraction of the largest entry of the window.

    Raises:
        numpy.linalg.LinAlgError: no fraction suffices.
    """
    eye = np.eye(jacobian.own.shape[1])
    largest = np.abs(jacobian.own).max(axis=(1, 2))[:, None, None]
    for share in (0.0, *ROUNDING_SHARES):
        try:
            prior = np.maximum(flat, share * largest) * eye
            return BlockTridiagonal(jacobian.own + prior, jacobian.below)
        except np.linalg.LinAlgError:
            continue
    raise np.linalg.LinAlgError("states of windows can't be eliminated")


class StateElimination:
    """Elimination of start states and nuisance columns from vectors over the rows.

    Inner products of cleared vectors are those with states and columns marginalised.

    Args:
        jacobian: by the start states.
        columns: (rows, m) nuisance columns, over the noise.
        sizes: (m,) prior standard deviations of their coefficients.
        flat: prior precision of the start states, small.
    """

    def __init__(
        self, jacobian: WindowJacobian, columns: Array, sizes: Array, flat: float
    ) -> None:
        self._jacobian = jacobian
        self._factor = factored(jacobian, flat)
        self._columns = np.vstack([self._without_states(columns), np.diag(1.0 / sizes)])
        self._normal = self._columns.T @ self._columns

    def _without_states(self, rows: Array) -> Array:
        """Vectors (rows, k) minus their least-squares fit by the states."""
        return rows - self._jacobian.times(
            self._factor.solve(self._jacobian.transposed_times(rows))
        )

    def clear(self, rows: Array) -> Array:
        """Clear vectors (rows, k); return (rows + m, k), the last m rows by the columns' prior."""
        extra = np.zeros((len(self._normal), rows.shape[1]))
        cleared = np.vstack([self._without_states(rows), extra])
        if not len(extra):
            return cleared
        return np.asarray(
            cleared - self._columns @ np.linalg.solve(self._normal, self._columns.T @ cleared)
        )

    def leverage(self) -> float:
        """Effective number of readings that the states use up: trace of the hat matrix."""
        W, n, _ = self._jacobian.own.shape
        covariance = self._factor.solve(np.eye(W * n).reshape(W, n, W * n))
        own = covariance.reshape(W, n, W, n)[np.arange(W), :, np.arange(W)]
        return float(np.sum(self._jacobian.of_readings * own))
