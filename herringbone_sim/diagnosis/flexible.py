"""Chi2 of a residual that measured quantities predict: cross-validated nonparametric regression.

Model: a sum of factors (constant, spring force, damper force) times smooth functions of one to
three measured quantities, as random Fourier features (Rahimi and Recht, NIPS 2007). Each row is
regressed on every other block of mesh cycles of all runs and scored on the remaining blocks, and
the reverse. Where causes act through the motion, the features are responses to forces of many
shapes instead. Noise can't be predicted; anything that repeats can, whatever its law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array, Indices

# Chosen, not fitted:
N_FEATURES = 200
MAX_INPUTS = 3  # measured quantities that one feature depends on
MAX_HARMONIC = 4  # of an angle
RIDGES = (1e1, 1e3)  # penalties of the regressions on all features, for features of unit RMS
SPARSE_SIZES = (10, 40)  # features of the sparse regressions
MAX_SAMPLES = 30 * N_FEATURES  # of a row


@dataclass(frozen=True)
class RegressionInputs:
    """Inputs of the regression for one observation of one run: n samples, R rows.

    Attributes:
        values: (n, R, D) measured quantities, of any unit.
        angles: (n, A) [rad]; functions depend on integer multiples of them.
        factors: (n, R, M) factors of the functions, in units of the residual's noise.
        responses: (n, R, P) whitened linear responses to forces of many shapes, used instead of
            the above where causes act through the motion; None: not used.
    """

    values: Array
    angles: Array
    factors: Array
    responses: Array | None = None

    def at(self, samples: Indices) -> RegressionInputs:
        """Copy restricted to the given indices of samples."""
        responses = None if self.responses is None else self.responses[samples]
        return RegressionInputs(
            self.values[samples], self.angles[samples], self.factors[samples], responses
        )


@dataclass(frozen=True)
class Predictable:
    """Part of a residual that the regression predicts out of sample.

    Attributes:
        chi2: (runs, R) chi2 of the rows.
        left: (runs, R) chi2 after subtracting the prediction; may exceed ``chi2``.
        count: (runs, R) number of values used; 0 where a row is not recorded.
        weight: number of independent values that each value used stands for.
    """

    chi2: Array
    left: Array
    count: Array
    weight: float = 1.0

    @property
    def predicted(self) -> float:
        """Predicted chi2 of all rows and all independent values, at least 0."""
        return self.weight * max(0.0, float((self.chi2 - self.left).sum()))

    def with_noise_scaled(self, noise: Array) -> Predictable:
        """Copy for a noise larger by the factor ``noise`` (runs, R)."""
        return Predictable(self.chi2 / noise**2, self.left / noise**2, self.count, self.weight)


@dataclass(frozen=True)
class _Features:
    """Random Fourier features: cosines of weighted sums of values and angles, times a factor."""

    of_values: Array
    of_angles: Array
    phase: Array
    factor: Indices

    @classmethod
    def drawn(cls, D: int, A: int, M: int) -> _Features:
        """Draw features for D values, A angles and M factors; (D, A, M) is the random seed."""
        rng = np.random.default_rng([D, A, M])
        of_values, of_angles = np.zeros((D, N_FEATURES)), np.zeros((A, N_FEATURES))
        for f in range(N_FEATURES):
            some = rng.choice(
                D + A, min(D + A, int(rng.integers(1, MAX_INPUTS + 1))), replace=False
            )
            for i in some:
                if i < D:
                    of_values[i, f] = rng.normal() * 2.0 ** rng.uniform(-2.0, 1.0)
                else:
                    sign = rng.choice([-1.0, 1.0])
                    of_angles[i - D, f] = sign * rng.integers(1, MAX_HARMONIC + 1)
        phase = rng.uniform(0.0, 2.0 * np.pi, N_FEATURES)
        return cls(of_values, of_angles, phase, np.arange(N_FEATURES) % M)

    def evaluated(self, values: Array, angles: Array, factors: Array) -> Array:
        """(n, N_FEATURES) features at (n, D) values, (n, A) angles and (n, M) factors of a row."""
        inputs = np.concatenate([values, angles % (2.0 * np.pi)], axis=1).astype(np.float32)
        weights = np.concatenate([self.of_values, self.of_angles]).astype(np.float32)
        made = np.cos(inputs @ weights + self.phase.astype(np.float32))
        return np.asarray(made * factors[:, self.factor])


def predict_residuals(
    residuals: Sequence[Array],
    inputs: Sequence[RegressionInputs],
    blocks: Sequence[Indices],
    independent_share: float = 1.0,
) -> Predictable:
    """Predict whitened residuals by cross-validated regression.

    Args:
        residuals: (n, R) for each run, whitened; a row of zeros is not recorded.
        inputs: for each run.
        blocks: (n,) number of the block of cycles of each sample, for each run. Even and odd
            blocks predict each other.
        independent_share: number of independent values over the number of samples.
    """
    first = inputs[0]
    features = _Features.drawn(
        first.values.shape[2], first.angles.shape[1], first.factors.shape[2]
    )
    runs, R = len(residuals), residuals[0].shape[1]
    thin = max(1, sum(len(r) for r in residuals) // MAX_SAMPLES)
    if thin > 1:
        used = [_thinned(len(r), thin) for r in residuals]
        residuals = [r[i] for r, i in zip(residuals, used, strict=True)]
        blocks = [b[i] for b, i in zip(blocks, used, strict=True)]
        inputs = [s.at(i) for s, i in zip(inputs, used, strict=True)]
    chi2, left = np.zeros((runs, R)), np.zeros((runs, R))
    of_run = np.repeat(np.arange(runs), [len(r) for r in residuals])
    fold = np.concatenate(blocks) % 2
    angles = np.concatenate([s.angles for s in inputs])
    for row in range(R):
        y = np.concatenate([r[:, row] for r in residuals])
        if not np.any(y):
            continue
        responses = [s.responses[:, row] for s in inputs if s.responses is not None]
        if responses:
            P = _unit_rms(np.concatenate(responses))
        else:
            values = _unit_rms(np.concatenate([s.values[:, row] for s in inputs]))
            factors = _unit_rms(np.concatenate([s.factors[:, row] for s in inputs]))
            P = features.evaluated(values, angles, factors)
        off = _cross_predict(P, y, fold, of_run)
        chi2[:, row] = np.bincount(of_run, y**2, runs)
        left[:, row] = np.bincount(of_run, off**2, runs) * (chi2[:, row] > 0.0)
    count = np.bincount(of_run, minlength=runs)[:, None] * (chi2 > 0.0)
    return Predictable(chi2, left, count.astype(float), thin * independent_share)


def _thinned(n: int, thin: int) -> Indices:
    """Indices of one out of every ``thin`` of n samples, evenly spread over the mesh phase.

    Its position among the ``thin`` samples follows multiples of the golden ratio.
    """
    i = np.arange(-(-n // thin))
    shift = np.floor(thin * (i * 0.5 * (5.0**0.5 - 1.0) % 1.0)).astype(int)
    return np.asarray(np.minimum(thin * i + shift, n - 1))


def _unit_rms(values: Array) -> Array:
    """Return the columns of ``values`` scaled to unit RMS; columns of zeros stay zero."""
    size = np.sqrt(np.mean(values**2, axis=0))
    return np.asarray(values / np.where(size > 0.0, size, 1.0))


@dataclass(frozen=True)
class _HalfPair:
    """Two halves of the samples that predict each other.

    Attributes:
        at: indices of the samples, for each half.
        P, A, b: features, their Gram matrix and their products with the residual, for each half.
    """

    at: tuple[Indices, ...]
    P: tuple[Array, ...]
    A: tuple[Array, ...]
    b: tuple[Array, ...]

    @classmethod
    def build(cls, P: Array, y: Array, halves: Sequence[Indices]) -> _HalfPair:
        """Split features (n, F) and residual (n,) into two halves given by their samples."""
        parts = tuple(P[at] for at in halves)
        A = tuple(p.T @ p for p in parts)
        return cls(
            tuple(halves), parts, A, tuple(p.T @ y[h] for p, h in zip(parts, halves, strict=True))
        )

    def predict(self, y: Array, max_features: int, ridge: float, off: Array) -> None:
        """Write the error of the residual y (n,), predicted across the halves, to ``off`` (n,).

        Args:
            max_features: number of features used, those most correlated with the residual.
            ridge: penalty of the regression.
        """
        for own, other in ((0, 1), (1, 0)):
            A, b = self.A[other], self.b[other]
            if max_features < len(b):
                use = np.argsort(-(b**2) / np.maximum(np.diag(A), 1e-12))[:max_features]
                A, b, P = A[np.ix_(use, use)], b[use], self.P[own][:, use]
            else:
                P = self.P[own]
            w = np.linalg.solve(A + ridge * np.eye(len(b)), b)
            off[self.at[own]] = y[self.at[own]] - P @ w


def _cross_predict(P: Array, y: Array, fold: Indices, run: Indices) -> Array:
    """(n,) error of y predicted across the halves, by the best of a few regressions, or none.

    Args:
        P: (n, F) features.
        fold, run: (n,) half (0 or 1) and run of each sample.
    """
    all_runs = _HalfPair.build(P, y, [np.flatnonzero(fold == h) for h in (0, 1)])
    # Also run by run: dependence on quantities constant within a run need not be smooth.
    alone = [
        _HalfPair.build(P, y, [np.flatnonzero((fold == h) & (run == r)) for h in (0, 1)])
        for r in np.unique(run)
    ]
    tried = [([all_runs], P.shape[1], ridge) for ridge in RIDGES]
    tried += [([all_runs], max_features, 1.0) for max_features in SPARSE_SIZES]
    tried += [(alone, SPARSE_SIZES[0], 1.0)]
    best = y
    for folds, max_features, ridge in tried:
        off = y.copy()
        for halves in folds:
            halves.predict(y, max_features, ridge, off)
        best = off if float(off @ off) < float(best @ best) else best
    return best
