"""Lyapunov spectrum from the tangent flow, with QR orthonormalisation.

After Benettin, Galgani, Giorgilli and Strelcyn, Meccanica 15 (1980) 9-30, and Shimada and
Nagashima, Prog. Theor. Phys. 61 (1979) 1605: the mean logarithms of the diagonal of R are the
exponents.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.dynamics.flow import Flow
from herringbone_sim.dynamics.growth import Growth, descending
from herringbone_sim.errors import AnalysisError


def lyapunov_spectrum(
    flow: Flow,
    y: Array,
    periods: int = 1000,
    transient: int = 200,
    k: int | None = None,
    at: int = 0,
) -> Growth:
    """Compute the k largest Lyapunov exponents of the motion from y on; all n by default.

    Args:
        flow: see ``Flow``.
        y: (n,) state on the attractor; see ``flow.settle`` to drop a transient.
        periods: number of periods averaged over.
        transient: periods discarded first, in which the tangent vectors align.
        k: number of exponents, 1 .. n.
        at: periods elapsed before y, see ``Flow``.

    Raises:
        AnalysisError: k out of range.
        DivergenceError: the motion left the range of the flow.
    """
    k = flow.n if k is None else k
    if not 1 <= k <= flow.n:
        raise AnalysisError(f"k must lie in 1 .. {flow.n}, the number of states, got {k}")
    frame, _ = orthonormalised(np.random.default_rng(0).normal(size=(k, flow.n)))
    logarithms = np.empty((periods, k))
    for i in range(-transient, periods):
        y, tangents = flow.advance(y, frame, at + transient + i)
        frame, lengths = orthonormalised(tangents)
        if i >= 0:
            with np.errstate(divide="ignore"):
                logarithms[i] = np.log(lengths)
    return descending(logarithms, flow.period, y)


def orthonormalised(tangents: Array) -> tuple[Array, Array]:
    """Orthonormalise tangent vectors (k, n) by a QR decomposition, in their order.

    Returns:
        Orthonormal rows (k, n), and the length (k,) of each vector's component orthogonal to the
        vectors before it.
    """
    q, r = np.linalg.qr(tangents.T)
    return q.T.copy(), np.abs(np.diag(r))


def kaplan_yorke(exponents: Array) -> float:
    """Kaplan-Yorke dimension of the stroboscopic section, from exponents (n,) in descending order.

    The motion in continuous time has one dimension more, the phase of the forcing.
    """
    sums = np.cumsum(exponents)
    j = int(np.sum(np.logical_and.accumulate(sums >= 0.0)))
    if j == 0 or j == len(exponents):
        return float(j)
    return float(j + sums[j - 1] / abs(exponents[j]))
