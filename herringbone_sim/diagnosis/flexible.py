"""How much of a residual anything measured could predict: a flexible regression, held out.

A residual may be any factor that acts on it (a constant, a spring, a damper) times any smooth
function of one to three of what is measured. Random Fourier features (Rahimi and Recht 2007) of
such functions, regressed row by row on every other block of mesh cycles of all runs and scored on
the rest. Where causes act through a motion, the features are the responses to forces of many
shapes. Noise can't be predicted; what repeats can, whatever law it follows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FEATURES = 200
INPUTS = 3  # most that a function has
HARMONICS = 4  # of an angle
RIDGES = (1e1, 1e3)
STRONGEST = (10, 40)  # features that a sparse regression has
SAMPLES = 6000  # of a row, thirty a feature


@dataclass(frozen=True)
class Surroundings:
    """What is measured about the rows of an observation of one run.

    Attributes:
        values: (n, R, D) of any unit.
        angles: (n, A) [rad]; functions have whole multiples of them.
        factors: (n, R, M) what a function may be a factor of, in units of the residual.
        responses: (n, R, P) what causes of many shapes add to the whitened residual, where they
            act through a motion and no factor of the rows themselves will do; None: none.
    """

    values: Array
    angles: Array
    factors: Array
    responses: Array | None = None


@dataclass(frozen=True)
class Predictable:
    """What a flexible regression explains of rows it was not trained on.

    Attributes:
        energy: (runs, R) whitened squares of the rows.
        left: (runs, R) after the regression's prediction; larger than ``energy`` where nothing
            repeats.
        count: (runs, R) values.
        weight: independent values that one looked at stands for.
    """

    energy: Array
    left: Array
    count: Array
    weight: float = 1.0

    @property
    def predicted(self) -> float:
        """Squares that the regression takes off all values of the rows."""
        return self.weight * max(0.0, float((self.energy - self.left).sum()))

    def for_noise(self, noise: Array) -> Predictable:
        """The same for noise (runs, R) times as large."""
        return Predictable(self.energy / noise**2, self.left / noise**2, self.count, self.weight)


@dataclass(frozen=True)
class _Features:
    """Cosines of weighted sums of values and angles, each times a factor."""

    of_values: Array
    of_angles: Array
    phase: Array
    factor: NDArray[np.int64]

    @classmethod
    def drawn(cls, D: int, A: int, M: int) -> _Features:
        rng = np.random.default_rng([D, A, M])
        of_values, of_angles = np.zeros((D, FEATURES)), np.zeros((A, FEATURES))
        for f in range(FEATURES):
            some = rng.choice(D + A, min(D + A, int(rng.integers(1, INPUTS + 1))), replace=False)
            for i in some:
                if i < D:
                    of_values[i, f] = rng.normal() * 2.0 ** rng.uniform(-2.0, 1.0)
                else:
                    sign = rng.choice([-1.0, 1.0])
                    of_angles[i - D, f] = sign * rng.integers(1, HARMONICS + 1)
        phase = rng.uniform(0.0, 2.0 * np.pi, FEATURES)
        return cls(of_values, of_angles, phase, np.arange(FEATURES) % M)

    def of(self, values: Array, angles: Array, factors: Array) -> Array:
        """(n, FEATURES) of one row."""
        inputs = np.concatenate([values, angles % (2.0 * np.pi)], axis=1).astype(np.float32)
        weights = np.concatenate([self.of_values, self.of_angles]).astype(np.float32)
        made = np.cos(inputs @ weights + self.phase.astype(np.float32))
        return np.asarray(made * factors[:, self.factor])


def predictable(
    residuals: Sequence[Array],
    surroundings: Sequence[Surroundings],
    blocks: Sequence[NDArray[np.int64]],
    independent: float = 1.0,
) -> Predictable:
    """Cross-validated squares of whitened residuals.

    Args:
        residuals: (n, R) per run, whitened.
        surroundings: per run.
        blocks: (n,) number of the block of cycles of each sample, per run.
        independent: share of the samples that are independent of each other.
    """
    first = surroundings[0]
    features = _Features.drawn(
        first.values.shape[2], first.angles.shape[1], first.factors.shape[2]
    )
    runs, R = len(residuals), residuals[0].shape[1]
    thin = max(1, sum(len(r) for r in residuals) // SAMPLES)
    residuals = [r[::thin] for r in residuals]
    energy, left = np.zeros((runs, R)), np.zeros((runs, R))
    of_run = np.repeat(np.arange(runs), [len(r) for r in residuals])
    fold = np.concatenate([b[::thin] % 2 for b in blocks])
    angles = np.concatenate([s.angles[::thin] for s in surroundings])
    for row in range(R):
        y = np.concatenate([r[:, row] for r in residuals])
        if not np.any(y):
            continue
        responses = [s.responses[::thin, row] for s in surroundings if s.responses is not None]
        if responses:
            P = _scaled(np.concatenate(responses))
        else:
            values = _scaled(np.concatenate([s.values[::thin, row] for s in surroundings]))
            factors = _scaled(np.concatenate([s.factors[::thin, row] for s in surroundings]))
            P = features.of(values, angles, factors)
        off = _held_out(P, y, fold, of_run)
        energy[:, row] = np.bincount(of_run, y**2, runs)
        left[:, row] = np.bincount(of_run, off**2, runs)
    count = np.bincount(of_run, minlength=runs)[:, None] * (energy > 0.0)
    return Predictable(energy, left, count.astype(float), thin * independent)


def _scaled(values: Array) -> Array:
    """Columns over their RMS."""
    size = np.sqrt(np.mean(values**2, axis=0))
    return np.asarray(values / np.where(size > 0.0, size, 1.0))


@dataclass(frozen=True)
class _Fold:
    """Two halves that predict each other: features, residuals and their products."""

    at: tuple[NDArray[np.int64], ...]
    P: tuple[Array, ...]
    A: tuple[Array, ...]
    b: tuple[Array, ...]

    @classmethod
    def of(cls, P: Array, y: Array, halves: Sequence[NDArray[np.int64]]) -> _Fold:
        parts = tuple(P[at] for at in halves)
        A = tuple(p.T @ p for p in parts)
        return cls(
            tuple(halves), parts, A, tuple(p.T @ y[h] for p, h in zip(parts, halves, strict=True))
        )

    def left(self, y: Array, most: int, ridge: float, off: Array) -> None:
        """Write what is left of each half predicted by the ``most`` features of the other."""
        for own, other in ((0, 1), (1, 0)):
            A, b = self.A[other], self.b[other]
            if most < len(b):
                use = np.argsort(-(b**2) / np.maximum(np.diag(A), 1e-12))[:most]
                A, b, P = A[np.ix_(use, use)], b[use], self.P[own][:, use]
            else:
                P = self.P[own]
            w = np.linalg.solve(A + ridge * np.eye(len(b)), b)
            off[self.at[own]] = y[self.at[own]] - P @ w


def _held_out(P: Array, y: Array, fold: NDArray[np.int64], run: NDArray[np.int64]) -> Array:
    """What is left of each half predicted by the other, by the best of a few regressions."""
    whole = _Fold.of(P, y, [np.flatnonzero(fold == h) for h in (0, 1)])
    # Each run on its own: what a law makes of what is held in a run need not be smooth.
    alone = [
        _Fold.of(P, y, [np.flatnonzero((fold == h) & (run == r)) for h in (0, 1)])
        for r in np.unique(run)
    ]
    tried = [([whole], P.shape[1], ridge) for ridge in RIDGES]
    tried += [([whole], most, 1.0) for most in STRONGEST]
    tried += [(alone, STRONGEST[0], 1.0)]
    best = y
    for folds, most, ridge in tried:
        off = y.copy()
        for one in folds:
            one.left(y, most, ridge, off)
        best = off if float(off @ off) < float(best @ best) else best
    return best
