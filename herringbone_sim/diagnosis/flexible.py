"""How much of a residual anything measured could predict: a flexible regression, held out.

Random Fourier features (Rahimi and Recht 2007) of all that is measured, ridge regression row by
row, trained on every other block of mesh cycles of all runs and scored on the rest. Noise can't be
predicted; what repeats can, whatever law it follows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FEATURES = 100
RIDGES = (1e1, 1e3, 1e5)


@dataclass(frozen=True)
class Predictable:
    """What a flexible regression explains of rows it was not trained on.

    Attributes:
        energy: (R,) whitened squares of the rows.
        left: (R,) after the regression's prediction; larger than ``energy`` where nothing repeats.
        count: (R,) values.
    """

    energy: Array
    left: Array
    count: Array


def predictable(
    residuals: Sequence[Array], inputs: Sequence[Array], blocks: Sequence[NDArray[np.int64]]
) -> Predictable:
    """Cross-validated squares of whitened residuals.

    Args:
        residuals: (n, R) per run, whitened.
        inputs: (n, R, D) per run: all that is measured, of order one.
        blocks: (n,) number of the block of cycles of each sample, per run.
    """
    R, D = inputs[0].shape[1:]
    rng = np.random.default_rng(D)
    scale = rng.choice([0.5, 1.5, 4.0], FEATURES)
    W = rng.normal(size=(D, FEATURES)) * scale / np.sqrt(D)
    phase = rng.uniform(0.0, 2.0 * np.pi, FEATURES)
    energy, left, count = np.zeros(R), np.zeros(R), np.zeros(R)
    for row in range(R):
        Z = np.concatenate([x[:, row] for x in inputs])
        y = np.concatenate([r[:, row] for r in residuals])
        fold = np.concatenate([b % 2 for b in blocks])
        if not np.any(y):
            continue
        P = np.cos(Z @ W + phase)
        energy[row], count[row] = float(y @ y), len(y)
        left[row] = _held_out(P, y, fold)
    return Predictable(energy, left, count)


def _held_out(P: Array, y: Array, fold: NDArray[np.int64]) -> float:
    """Squares left of each half predicted by the other, at the best of a few ridges."""
    halves = [(P[fold == h], y[fold == h]) for h in (0, 1)]
    A = [p.T @ p for p, _ in halves]
    b = [p.T @ q for p, q in halves]
    best = np.inf
    for ridge in RIDGES:
        left = 0.0
        for own, other in ((0, 1), (1, 0)):
            w = np.linalg.solve(A[other] + ridge * np.eye(len(b[0])), b[other])
            left += float(np.sum((halves[own][1] - halves[own][0] @ w) ** 2))
        best = min(best, left)
    return best
