"""Steps of a fit: those of Gauss-Newton, damped after refused ones (Levenberg and Marquardt).

D. W. Marquardt, J. Soc. Indust. Appl. Math. 11, 431 (1963).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.coefficients import Coefficient
from herringbone_sim.diagnosis.regression import within
from herringbone_sim.diagnosis.score import trust_region

# Damping relative to the diagonal, chosen: after a refused step at least the first, then a factor
# more; so much less after an accepted one, and none below the first over the factor.
FIRST_DAMPING, DAMPING_FACTOR = 1.0, 10.0


class DampedSteps:
    """Points that a fit tries one after the other, within the bounds of its coefficients.

    Args:
        coefficients: all p of the fit.
    """

    def __init__(self, coefficients: Sequence[Coefficient]) -> None:
        # Bounds of departures follow the size of their effect, see ``compute_score``.
        bound = np.array([np.inf if c.departs_from else c.bound for c in coefficients])
        center = np.array([c.center for c in coefficients])
        self._lowest, self._highest = center - bound, center + bound
        self._reach = trust_region(coefficients)
        self._damping = 0.0

    def onwards(self, mean: Array, step: Array, A: Array) -> Array:
        """Next point (p,) after an accepted one.

        Args:
            mean: (p,) the accepted point.
            step: (p,) step of Gauss-Newton from there.
            A: (p, p) matrix of its normal equations, with the prior.
        """
        self._mean, self._step, self._A = mean, step, A
        self._damping /= DAMPING_FACTOR
        if self._damping < FIRST_DAMPING / DAMPING_FACTOR:
            self._damping = 0.0
        return self._point()

    def shorter(self) -> Array:
        """Point (p,) to try in place of one that was refused: nearer to the last accepted one."""
        self._damping = max(FIRST_DAMPING, DAMPING_FACTOR * self._damping)
        return self._point()

    def _point(self) -> Array:
        step = within(damped(self._A, self._damping, self._step), self._reach)
        return np.asarray(np.clip(self._mean + step, self._lowest, self._highest))


def damped(A: Array, damping: float, step: Array) -> Array:
    """Step (p,) of Gauss-Newton, shortened where A is flat.

    Args:
        A: (p, p) matrix of the normal equations, with the prior.
        damping: factor on its diagonal that is added to it; 0: the step as it is.
    """
    if not damping:
        return step
    scale = 1.0 / np.sqrt(np.diag(A))
    scaled = A * np.outer(scale, scale)
    stiffer = scaled + damping * np.eye(len(A))
    return np.asarray(scale * np.linalg.solve(stiffer, scaled @ (step / scale)))
