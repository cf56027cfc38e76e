"""What is measured about the rows of an observation: what an unknown law may depend on.

Functions of these are what the flexible regression tries on a residual (``diagnosis.flexible``).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from herringbone_sim.diagnosis.flexible import RegressionInputs
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.gap.observations.law import MeshMotion, law

Array = NDArray[np.float64]

# Mesh cycles that a state of a cause's own may remember: a third of one and a few.
MEMORIES = (0.3, 3.0)


def about_meshes(m: MeshMotion, cycles: Sequence[float], block: Block) -> RegressionInputs:
    """Of the force law: a force, a stiffness, a damping or a displacement may be a function."""
    now = law(m)
    acts = (
        np.ones_like(m.x),
        now.k * now.f,
        now.damper,
        now.k * (now.contact_drive + now.contact_back),
    )
    factors = np.stack([np.nan_to_num(a) / block.sigma for a in acts], axis=2)
    return _about(m, (m.x, m.v), cycles, factors, block)


def about_rows(
    m: MeshMotion, own: Sequence[Array], cycles: Sequence[float], block: Block
) -> RegressionInputs:
    """Of other rows: what is left of them may be a function.

    Args:
        own: (n, R) each, what goes on in every row and its rate.
    """
    return _about(m, own, cycles, np.ones((*block.residual.shape, 1)), block)


def _about(
    m: MeshMotion, own: Sequence[Array], cycles: Sequence[float], factors: Array, block: Block
) -> RegressionInputs:
    """With states that remember, what is held in the run, time, and turns of ``cycles`` each."""
    step = float(m.times[1] - m.times[0])
    known = [np.nan_to_num(q) for q in own]
    late = [_low_passed(q, c * 2.0 * np.pi / m.omega / step) for q in known for c in MEMORIES]
    held = (m.point["delta_T"], m.point["T_1"], m.times / m.times[-1])
    known += [np.broadcast_to(np.reshape(h, (-1, 1)), own[0].shape) for h in held]
    at = slice(None) if block.sample_index is None else block.sample_index
    angles = np.stack([m.phase / c for c in cycles], axis=1)
    return RegressionInputs(np.stack([*known, *late], axis=2)[at], angles[at], factors)


def _low_passed(values: Array, samples: float) -> Array:
    """Values (n, k) behind a low-pass of first order with a time constant in samples."""
    a = np.exp(-1.0 / samples)
    return np.asarray(lfilter([1.0 - a], [1.0, -a], values, axis=0, zi=a * values[:1])[0])
