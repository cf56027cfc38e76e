"""Whether an effect is the same at all times and loads.

The parameters of an effect hold for a whole campaign. Something else that looks like it may grow
during a run, or come with the load in another way. So each parameter is let vary by the time in a
run, then by the load on the mesh, and what that adds to the prediction of runs left out counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.gap.attribution.fit import Fit, Linear, linear
from herringbone_sim.gap.attribution.hypothesis import Case
from herringbone_sim.gap.residuals.recalibrate import BOUNDS, force_law

Array = NDArray[np.float64]

N_FACTOR = 6
CHANCE = 10.0  # squares that some more parameters may win by chance, over chi2
DEPTHS = (0.1, 0.3, 1.0)  # of the median deflection, up to which a load counts as light
RIDGE = 1e-6


@dataclass(frozen=True)
class Varying:
    """What a fit wins where its effects may vary: mean square over the floor, of runs left out.

    Attributes:
        by_time: over a run, linearly.
        by_load: between lightly and heavily loaded flanks.
    """

    by_time: float
    by_load: float


def varying(cases: Sequence[Case], one: Fit) -> Varying:
    """What a fit with effects wins where these may vary with time or load."""
    values = np.concatenate([one.factors, *(np.array(a.theta) for a in one.actives)])
    parts = [linear(c, values, one.actives) for c in cases]
    count = sum(float(c.usable.sum() * len(c.run)) for c in cases)
    chance = CHANCE * max(one.chi2, 1.0)
    by_time = _won(parts, _centred([_time(c) for c in cases]))
    depths = [_depth(c) for c in cases]
    closed = np.concatenate([depth[depth > 0.0] for depth in depths])
    middle = float(np.median(closed)) if closed.size else 1.0
    by_load = max(
        _won(parts, _centred([np.exp(-depth / (scale * middle)) for depth in depths]))
        for scale in DEPTHS
    )
    return Varying(*(max(gain - chance, 0.0) / count for gain in (by_time, by_load)))


def _centred(courses: Sequence[Array]) -> list[Array]:
    """Courses (n, n_mesh) of all runs, their mean taken off."""
    middle = float(np.mean([one.mean() for one in courses]))
    return [one - middle for one in courses]


def _time(c: Case) -> Array:
    course: Array = np.broadcast_to(np.linspace(-1.0, 1.0, len(c.run))[:, None], c.floor.shape)
    return course


def _depth(c: Case) -> Array:
    """Deflection (n, n_mesh) of the flanks [m], 0 where they are apart."""
    law = force_law(c.run, c.fused, np.ones(N_FACTOR))
    depth: Array = np.nan_to_num(np.abs(law.f_m)) * law.contact
    return depth


def _won(parts: Sequence[Linear], courses: Sequence[Array]) -> float:
    """Squares of runs left out that columns times a course predict, beyond the columns alone."""
    normal, right = [], []
    for part, course in zip(parts, courses, strict=True):
        varied = part.jacobian[:, :, N_FACTOR:] * course[:, :, None]
        J = np.concatenate([part.jacobian, varied], axis=2)
        J = J.reshape(-1, J.shape[2])
        normal.append(J.T @ J)
        right.append(J.T @ part.residual.ravel())
    A, b = np.stack(normal), np.stack(right)
    own = parts[0].jacobian.shape[2]
    return _predicted(A, b) - _predicted(A[:, :own, :own], b[:, :own])


def _predicted(A: Array, b: Array) -> float:
    """Fall of the squares of each run by what all others say (runs, q, q), (runs, q)."""
    prior = np.zeros(b.shape[1])
    prior[:N_FACTOR] = 3.0 / BOUNDS**2
    fall = 0.0
    for run in range(len(A)):
        whole = A.sum(0) - A[run] + np.diag(prior)
        scale = 1.0 / np.sqrt(np.maximum(np.diag(whole), 1e-300))
        scaled = whole * np.outer(scale, scale) + RIDGE * np.eye(len(prior))
        beta = scale * np.linalg.solve(scaled, scale * (b.sum(0) - b[run]))
        fall += float(2.0 * beta @ b[run] - beta @ A[run] @ beta)
    return fall
