"""Gain, bias and delay of the channels to which windows are fitted: columns and correction."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.effects.channels import between
from herringbone_sim.gap.observations.rollout import STATES
from herringbone_sim.gap.observations.shooting import Windows, WindowSolution

TINY = 1e-300  # avoids division by zero where there is no reading
SWAP_PREFIX = "swap of "  # prefix of ``A and B``; present or absent, its column is zero
ERRORS = ("gain", "bias", "delay")


def without_sensor_errors(s: Windows, amplitudes: Mapping[str, float]) -> Windows:
    """Windows with sensor errors removed from their readings.

    Args:
        amplitudes: by ``ERROR of CHANNEL``: gain as a share, bias in the unit of the channel,
            delay [s].
    """
    names = s.channels.names
    gain, bias, delay = (
        np.array([amplitudes.get(f"{error} of {name}", 0.0) for name in names]) for error in ERRORS
    )
    if not (np.any(gain) or np.any(bias) or np.any(delay)):
        return s
    values = s.channels.values.copy()
    for i in np.flatnonzero(delay):
        times = s.run.times
        values[:, i] = between(times, values[:, i], times + delay[i])
    share = 1.0 + gain
    return replace(s, measured=s.in_windows((values - bias) / share), weight=s.weight * share)


def error_columns(
    s: Windows, solution: WindowSolution, wanted: Container[str]
) -> dict[str, Array]:
    """Change (W samples k,) of all channels by a unit of each wanted error, over the noise."""
    found = {}
    for i, name in enumerate(s.channels.names):
        for error in ERRORS:
            if f"{error} of {name}" in wanted:
                alone = np.zeros_like(s.weight)
                alone[:, :, i] = s.weight[:, :, i] * _error_signal(s, solution, i, error)
                found[f"{error} of {name}"] = alone.ravel()
    return found


def _error_signal(s: Windows, solution: WindowSolution, i: int, error: str) -> Array | float:
    """Change (W, samples) of channel i by a unit of an error."""
    if error == "bias":
        return 1.0
    seen = s.measured[:, :, i] - solution.residuals[:, :, i] / np.maximum(s.weight[:, :, i], TINY)
    if error == "gain":
        return seen
    if s.channels.names[i][0] == "u":
        rates = solution.states[:, : -1 : s.steps_per_sample, STATES // 2 :]
        return -np.asarray(rates @ s.channels.of_u[i])
    return -np.gradient(seen.ravel(), s.run.step_s).reshape(seen.shape)
