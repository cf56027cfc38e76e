"""Inputs of the flexible regression (``diagnosis.flexible``) for the observations of a gear."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import lfilter

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.flexible import RegressionInputs
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.gap.observations.law import MeshMotion, law

# Time constants of low-passed inputs [mesh cycles], for causes with memory; chosen.
MEMORIES = (0.3, 3.0)


def about_meshes(m: MeshMotion, cycles: Sequence[float], block: Block) -> RegressionInputs:
    """Inputs of the force law; factors: force, spring force, damper force, displacement.

    Args:
        cycles: mesh cycles of the periods whose angles are inputs.
    """
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
    """Inputs of other observations; factor: a constant.

    Args:
        own: (n, R) each: signal of every row and its rate.
    """
    return _about(m, own, cycles, np.ones((*block.residual.shape, 1)), block)


def _about(
    m: MeshMotion, own: Sequence[Array], cycles: Sequence[float], factors: Array, block: Block
) -> RegressionInputs:
    """Add low-passed signals, operating point, time, and angles of periods of ``cycles``."""
    step = float(m.times[1] - m.times[0])
    known = [np.nan_to_num(q) for q in own]
    late = [_low_passed(q, c * 2.0 * np.pi / m.omega / step) for q in known for c in MEMORIES]
    held = (
        m.point["delta_T"],
        m.point["T_1"],
        (m.times - m.times[0]) / (m.times[-1] - m.times[0]),
    )
    known += [np.broadcast_to(np.reshape(h, (-1, 1)), own[0].shape) for h in held]
    at = slice(None) if block.sample_index is None else block.sample_index
    angles = np.stack([m.phase / c for c in cycles], axis=1)
    return RegressionInputs(np.stack([*known, *late], axis=2)[at], angles[at], factors)


def _low_passed(values: Array, samples: float) -> Array:
    """First-order low-pass of values (n, k), time constant in samples, from steady state."""
    a = np.exp(-1.0 / samples)
    return np.asarray(lfilter([1.0 - a], [1.0, -a], values, axis=0, zi=a * values[:1])[0])
