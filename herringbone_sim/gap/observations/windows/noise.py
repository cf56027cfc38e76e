"""Noise of the channels to which windows are fitted, where the campaign does not give it.

An estimate from the top of a channel's spectrum is bad there: too low where rounding by an encoder
repeats with the motion, as its error lies in a few lines; too high for forces and accelerations of
a gear that loses contact, which have motion up to the top. The residual of windows under the
nominal law bounds both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.parallel import forked_map
from herringbone_sim.gap.data.noise import at_least_quantisation
from herringbone_sim.gap.data.prepared import Measured, PreparedRun, deciding
from herringbone_sim.gap.observations.windows.integrator import STATES
from herringbone_sim.gap.observations.windows.trajectory import Trajectory


def with_noise_of_windows(runs: Sequence[PreparedRun], known: bool) -> tuple[PreparedRun, ...]:
    """Runs with noise corrected by the residual of windows under the nominal law.

    Noise of rotations is raised to the RMS residual, at most to that of the noisiest fit run, as
    an effect raises the residual too; noise of forces and accelerations is lowered to it.
    Unchanged are noise that the campaign gives, and that of accelerations where a window has no
    more readings than states, which then absorb nearly all of it.

    Args:
        runs: all runs of a campaign, to which windows are fitted.
        known: whether the campaign gives the noise of all channels but detrended rotations.
    """
    largest = np.fmax.reduce([run.u.sigma for run in deciding(runs)])

    def learned(run: PreparedRun) -> PreparedRun:
        rotations = run.model.layout.channels_of("u")
        given = np.array([known and name not in run.detrended for name in rotations])
        sought = bool(np.any(run.u.recorded & ~given))
        if not known:
            measured = (run.F, run.pin, run.a)
            sought |= any(bool(quantity.recorded.any()) for quantity in measured)
        if not (sought and run.shafts_known):
            return run
        trajectory = Trajectory(run)
        residual_rms = trajectory.noise_left()
        raised = np.fmax(run.u.sigma, np.minimum(_of(rotations, residual_rms), largest))
        run = replace(run, u=run.u.with_noise(np.where(given, run.u.sigma, raised)))
        if known:
            return run
        _, samples, k = trajectory.recorded.measured.shape
        for quantity in ("F", "pin", "a") if samples * k > STATES else ("F", "pin"):
            run = _lowered(run, quantity, residual_rms)
        return run

    return tuple(forked_map(learned, runs))


def _lowered(run: PreparedRun, quantity: str, residual_rms: Mapping[str, float]) -> PreparedRun:
    """Run with the noise of a quantity lowered to ``residual_rms``, not below quantisation."""
    channels: Measured = getattr(run, quantity)
    names = run.model.layout.channels_of(quantity)
    lowered = np.fmin(channels.sigma, _of(names, residual_rms))
    noise = at_least_quantisation(lowered, channels.values)
    return run.with_measured(quantity, channels.with_noise(noise))


def _of(names: Sequence[str], residual_rms: Mapping[str, float]) -> Array:
    """RMS residuals ``residual_rms`` of channels (k,), NaN where missing or 0."""
    return np.array([residual_rms.get(name) or np.nan for name in names])
