"""Lyapunov exponents within a symmetric motion and transverse to it.

A flow that commutes with an exchange of its states (left and right of the gear) keeps symmetric
states symmetric. Perturbations of such a motion split into symmetric and antisymmetric ones, which
do not mix; the largest exponent of the antisymmetric ones is the transverse exponent (Pikovsky and
Grassberger, J. Phys. A 24 (1991) 4587; Ashwin, Buescu and Stewart, Nonlinearity 9 (1996) 703). If
it is positive, no real gear stays symmetric.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.dynamics.flow import Flow
from herringbone_sim.dynamics.growth import Growth, descending
from herringbone_sim.dynamics.spectrum import orthonormalised
from herringbone_sim.errors import AnalysisError


@dataclass(frozen=True)
class SymmetryExponents:
    """The k largest Lyapunov exponents of a symmetric motion within the symmetry and across it.

    Attributes:
        within: exponents (k,) of symmetric perturbations, per unit of the flow's time.
        transverse: exponents (k,) of antisymmetric perturbations.
    """

    within: Growth
    transverse: Growth


def symmetric_exponents(
    flow: Flow,
    y: Array,
    exchange: Indices,
    periods: int = 1000,
    transient: int = 200,
    k: int = 1,
    at: int = 0,
) -> SymmetryExponents:
    """Compute the k largest exponents within the symmetry and the k largest transverse to it.

    Args:
        flow: one that commutes with the exchange bit for bit, see ``Flow``.
        y: (n,) symmetric state, ``y == y[exchange]``.
        exchange: (n,) indices that swap left and right, see ``flow.symmetry`` for a gear.
        periods: number of periods averaged over.
        transient: periods discarded first, in which the perturbations align.
        k: number of exponents of each kind.
        at: periods elapsed before y, see ``Flow``.

    Raises:
        AnalysisError: the state is not symmetric, or the flow does not keep it so.
        DivergenceError: the motion left the range of the flow.
    """
    frames = np.random.default_rng(0).normal(size=(2 * k, flow.n))
    frames, _ = _split(frames, exchange)
    logarithms = np.empty((periods, 2 * k))
    for i in range(-transient, periods):
        _check(y, exchange)
        y, tangents = flow.advance(y, frames, at + transient + i)
        frames, lengths = _split(tangents, exchange)
        if i >= 0:
            with np.errstate(divide="ignore"):
                logarithms[i] = np.log(lengths)
    within, transverse = (
        descending(part, flow.period, y) for part in np.split(logarithms, 2, axis=1)
    )
    return SymmetryExponents(within, transverse)


def _split(tangents: Array, exchange: Indices) -> tuple[Array, Array]:
    """Project tangent vectors on their symmetry, and orthonormalise each of the two kinds.

    Projecting again in each period keeps rounding errors from feeding the faster-growing kind into
    the slower one.

    Args:
        tangents: (2 k, n) rows; the first k become symmetric, the others antisymmetric.
        exchange: (n,) indices that swap left and right.

    Returns:
        Orthonormal rows (2 k, n), and the length (2 k,) of each projected vector's component
        orthogonal to the rows before it of the same kind.
    """
    even, odd = np.split(tangents, 2)
    parts = (even + even[:, exchange], odd - odd[:, exchange])
    frames, lengths = zip(*(orthonormalised(0.5 * part) for part in parts), strict=True)
    return np.concatenate(frames), np.concatenate(lengths)


def _check(y: Array, exchange: Indices) -> None:
    """Raise AnalysisError unless the state is exactly symmetric."""
    gap = float(np.abs(y - y[exchange]).max())
    if gap > 0.0:
        raise AnalysisError(
            f"transverse exponents need a symmetric motion, got one whose sides differ by "
            f"{gap:.3g}: start from equal sides, in a model whose sides are alike"
        )
