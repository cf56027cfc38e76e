"""Newton's method for a system of equations, with step halving."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.errors import DivergenceError, ParameterError

Equations = Callable[[Array], tuple[Array, Array]]

TOLERANCE = 1e-10  # largest absolute residual of a solution
MAX_ITERATIONS = 40
SHORTEST = 2.0**-8  # smallest fraction of a Newton step that is tried


@dataclass(frozen=True)
class Solution:
    """Result of Newton's method.

    Attributes:
        z: (k,) last iterate.
        iterations: number of Newton iterations.
        reason: why it did not converge; empty if it did.
    """

    z: Array
    iterations: int
    reason: str = ""


def newton(equations: Equations, z: Array) -> Solution:
    """Solve a system by Newton's method, each step halved until the largest residual falls.

    Args:
        equations: returns residual (k,) and Jacobian (k, k) at z; may raise DivergenceError or
            ParameterError, which counts as a failed step.
        z: (k,) first guess.
    """
    try:
        residual, jacobian = equations(z)
    except (DivergenceError, ParameterError) as error:
        return Solution(z, 0, str(error))
    for iteration in range(MAX_ITERATIONS):
        size = float(np.abs(residual).max())
        if size <= TOLERANCE:
            return Solution(z, iteration)
        try:
            step = np.linalg.solve(jacobian, -residual)
        except np.linalg.LinAlgError:
            return Solution(z, iteration, "the Jacobian is singular")
        share = 1.0
        while (attempt := _attempt(equations, z + share * step, size)) is None:
            share *= 0.5
            if share < SHORTEST:
                return Solution(z, iteration, "no step along Newton's direction helps")
        z, (residual, jacobian) = z + share * step, attempt
    reason = (
        "" if np.abs(residual).max() <= TOLERANCE else f"no convergence in {MAX_ITERATIONS} steps"
    )
    return Solution(z, MAX_ITERATIONS, reason)


def _attempt(equations: Equations, z: Array, size: float) -> tuple[Array, Array] | None:
    """Residual and Jacobian at z if the largest residual is below ``size``, else None."""
    try:
        residual, jacobian = equations(z)
    except (DivergenceError, ParameterError):
        return None
    return (residual, jacobian) if np.abs(residual).max() < size else None
