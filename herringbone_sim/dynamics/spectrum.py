"""Lyapunov exponents from the tangent flow: vectors run along and are orthonormalised by QR.

After Benettin, Galgani, Giorgilli and Strelcyn, Meccanica 15 (1980) 9-30, and Shimada and
Nagashima, Prog. Theor. Phys. 61 (1979) 1605: the logarithms of the diagonal of R add up to the
growth of volumes, the one of the first vector to the largest exponent.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.dynamics.flow import Flow
from herringbone_sim.dynamics.growth import Growth, descending
from herringbone_sim.errors import AnalysisError

Array = NDArray[np.float64]


def lyapunov_spectrum(
    flow: Flow,
    y: Array,
    periods: int = 1000,
    transient: int = 200,
    k: int | None = None,
    at: int = 0,
) -> Growth:
    """The k largest exponents of the motion from y on; all n by default.

    Args:
        flow: see ``Flow``.
        y: (n,) state; drop the transient of the motion before, see ``flow.settle``.
        periods: averaged over.
        transient: periods in which the vectors turn into their directions, left out.
        k: exponents wanted, 1 .. n.
        at: periods that have passed before y, see ``Flow``.

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
        y, frame, growth = grow(flow, y, frame, at + transient + i)
        if i >= 0:
            logarithms[i] = growth
    return descending(logarithms, flow.period, y)


def grow(flow: Flow, y: Array, frame: Array, at: int = 0) -> tuple[Array, Array, Array]:
    """State (n,), orthonormal frame (k, n) and logarithms of its growth (k,) a period later."""
    y, tangents = flow.advance(y, frame, at)
    frame, lengths = orthonormalised(tangents)
    with np.errstate(divide="ignore"):
        return y, frame, np.log(lengths)


def orthonormalised(tangents: Array) -> tuple[Array, Array]:
    """Orthonormal rows (k, n) that span the same nested spaces, and the lengths (k,) taken off."""
    q, r = np.linalg.qr(tangents.T)
    return q.T.copy(), np.abs(np.diag(r))


def kaplan_yorke(exponents: Array) -> float:
    """Kaplan-Yorke dimension of descending exponents; a period of forcing adds none.

    Of a stroboscopic section, that is; the motion in continuous time has one more.
    """
    sums = np.cumsum(exponents)
    j = int(np.sum(np.logical_and.accumulate(sums >= 0.0)))
    if j == 0 or j == len(exponents):
        return float(j)
    return float(j + sums[j - 1] / abs(exponents[j]))
