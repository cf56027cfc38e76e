"""Inputs of the flexible regression (``diagnosis.flexible``) for the observations of a gear."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.signal import lfilter

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.flexible import RegressionInputs
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.gap.observations.basis import LOADS_M, Function
from herringbone_sim.gap.residuals.mesh_law import MeshMotion, law

# Time constants of low-passed inputs [mesh cycles], for causes with memory; chosen.
MEMORIES = (0.3, 3.0)

# Functions of the law whose responses at every mesh are inputs of the flexible regression; chosen.
GENERIC_FUNCTIONS = {
    *("kappa", "gamma", "gamma free", "b_plus", "b_minus"),
    *(f"kappa load {i}" for i in range(len(LOADS_M))),
    *(f"{q} {i} {trig}" for q in "ke" for i in (1, 2, 3) for trig in ("cos", "sin")),
    *(f"{q} 1 {trig}" for q in ("sun", "planet", "ring") for trig in ("cos", "sin")),
}
DRIFTING = ("kappa", "gamma", "b_plus", "b_minus")  # of these, those that may change within a run


def about_meshes(m: MeshMotion, cycles: Sequence[float], block: Block) -> RegressionInputs:
    """Inputs of the force law; factors: constant, spring force, damper force, contact stiffness.

    Args:
        cycles: periods [mesh cycles] whose angles are inputs.
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
        own: (n, R) each: signal of every row and its rate, at all samples.
    """
    return _about(m, own, cycles, np.ones((*block.residual.shape, 1)), block)


def about_windows(
    responses: Callable[[Sequence[Function], Sequence[str]], Array],
    functions: Sequence[Function],
    n_mesh: int,
    cycles: Array,
) -> Array:
    """Responses (rows, inputs) of windows to ``GENERIC_FUNCTIONS`` at every mesh.

    Those to ``DRIFTING`` follow once more, times the time since the middle of the run: windows are
    short against the run, so an amplitude that varies in time is nearly constant in each.

    Args:
        responses: (functions, names of columns) -> responses (rows, columns).
        functions: of the force law.
        cycles: mesh cycles since the start of the run, of all rows at least.
    """
    some = [f for f in functions if f.name in GENERIC_FUNCTIONS]
    wanted = [f"{f.name} of {j}" for f in some for j in range(n_mesh)]
    made = responses(some, wanted)
    since = cycles[: len(made)]
    drift = made[:, [name.split(" of ")[0] in DRIFTING for name in wanted]]
    return np.column_stack([made, drift * (since / since.max() - 0.5)[:, None]])


def _about(
    m: MeshMotion, own: Sequence[Array], cycles: Sequence[float], factors: Array, block: Block
) -> RegressionInputs:
    """Inputs: signals ``own``, operating point, time, low-passed signals; angles of ``cycles``."""
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
