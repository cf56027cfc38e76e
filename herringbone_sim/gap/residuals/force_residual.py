"""Residual of the force law: algebraic at each sample, so that chaos doesn't affect it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.mesh import backlash
from herringbone_sim.core.model import Model
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.data.mesh_excitation import waves


@dataclass(frozen=True)
class ForceResidual:
    """Measured minus modelled force of each mesh that has x, v and F.

    Attributes:
        meshes: names of the k meshes.
        residual_n: (n, k) [N]; NaN where a reading is missing.
        force_n: (n, k) measured [N].
    """

    meshes: tuple[str, ...]
    residual_n: Array
    force_n: Array

    @property
    def rms_n(self) -> Array:
        """RMS residual (k,) of each mesh [N]."""
        rms: Array = np.sqrt(np.nanmean(self.residual_n**2, axis=0))
        return rms

    @property
    def shares(self) -> Array:
        """Fraction (k,) of the sum of squared residuals at each mesh; the sum is 1."""
        energy = self.rms_n**2
        shares: Array = energy / max(energy.sum(), np.finfo(float).tiny)
        return shares


def force_residual(model: Model, series: TimeSeries) -> ForceResidual:
    """Return F - (k(t) f(x) + c v) with the stiffness, backlash and damping of the model.

    Args:
        model: built for the operating point of the recording (delta_T sets the backlash).
        series: with ``phase`` and, for at least one mesh, ``x_``, ``v_`` and ``F_``.

    Raises:
        AnalysisError: no phase, or no mesh of the model with a sample of all three channels.
    """
    meshes = tuple(
        m
        for m in model.layout.meshes
        if all(f"{prefix}_{m}" in series for prefix in "xvF")
        and np.isfinite(sum(series[f"{prefix}_{m}"] for prefix in "xvF")).any()
    )
    if "phase" not in series or not meshes:
        raise AnalysisError(
            f"the force law needs phase and x, v, F of a mesh of the {model.parameters.model} "
            f"model ({model.layout.meshes[0]}, ...), got {', '.join(series.names)}"
        )
    at = [model.layout.meshes.index(m) for m in meshes]
    x, v, force = (series.columns(tuple(f"{prefix}_{m}" for m in meshes)) for prefix in "xvF")
    k = waves(model, series["phase"], 0.0).k[:, at]
    spring = k * backlash(x, model.half_backlash_m[at])
    return ForceResidual(meshes, force - spring - model.damping_n_s_per_m[at] * v, force)
