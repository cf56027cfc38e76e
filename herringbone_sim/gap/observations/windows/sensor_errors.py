"""Gain, bias, delay, clock and swap of the channels to which windows are fitted."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.gap.observations.consistency import ERROR_KINDS
from herringbone_sim.gap.observations.windows.shooting import WindowSolution
from herringbone_sim.gap.observations.windows.windows import Windows

TINY = 1e-300  # avoids division by zero where there is no reading
SWAP_PREFIX = "swap of "  # followed by ``A and B``; amplitude 0 or 1


def exchangeable(names: Sequence[str]) -> list[tuple[str, str]]:
    """All pairs of channels of one kind, whose cables may be exchanged."""

    def kind(name: str) -> str:
        return "pin" if name.startswith("F_pin") else name[0]

    return [
        (first, second) for first, second in combinations(names, 2) if kind(first) == kind(second)
    ]


def with_sensor_errors(s: Windows, amplitudes: Mapping[str, float]) -> Windows:
    """Copy of windows that allows for gain, bias, delay and clock errors of their channels.

    A channel reads (1 + gain) y(t - delay - clock t) + bias. Gain and bias are removed from the
    readings, and the weight is scaled by 1 + gain; delay and clock replace those of the windows,
    which delay the predicted channels. If all amplitudes are 0, ``s`` itself is returned.

    Args:
        s: windows with the readings as recorded.
        amplitudes: by ``gain of u_c`` and the like, with one of ``ERROR_KINDS`` and a channel of
            ``s``: gain minus 1, bias in the unit of the channel, delay [s], relative error of the
            clock; 0 where there is no such name. Other names are ignored.
    """
    names = s.channels.names
    gain, bias, delay, clock = (
        np.array([amplitudes.get(f"{error} of {name}", 0.0) for name in names])
        for error in ERROR_KINDS
    )
    if not any(np.any(errors) for errors in (gain, bias, delay, clock)):
        return s
    share = 1.0 + gain
    return replace(
        s,
        measured=s.in_windows((s.channels.values - bias) / share),
        weight=s.weight * share,
        delay=delay,
        clock=clock,
        share=share,
    )


def error_columns(
    s: Windows, solution: WindowSolution, exact: Array, names: Container[str]
) -> dict[str, Array]:
    """Change (W samples k,) of all readings by a unit of each wanted error, over the noise.

    Args:
        exact: (n, k) channels without errors, predicted at every step.
        names: ``ERROR of CHANNEL`` or ``swap of A and B``.
    """
    columns = {}
    for i, name in enumerate(s.channels.names):
        for error in ERROR_KINDS:
            if f"{error} of {name}" in names:
                alone = np.zeros_like(s.weight)
                weight = s.weight / s.share if error in ("gain", "bias") else s.weight
                alone[:, :, i] = weight[:, :, i] * _error_signal(s, solution, exact, i, error)
                columns[f"{error} of {name}"] = alone.ravel()
    for pair in exchangeable(s.channels.names):
        swap = f"{SWAP_PREFIX}{' and '.join(pair)}"
        if swap in names:
            i, j = (s.channels.names.index(name) for name in pair)
            both = np.zeros_like(s.weight)
            read = s.weight[:, :, (i, j)].all(axis=2)
            apart = np.where(read, s.measured[:, :, i] - s.measured[:, :, j], 0.0)
            both[:, :, i], both[:, :, j] = s.weight[:, :, i] * apart, -s.weight[:, :, j] * apart
            columns[swap] = both.ravel()
    return columns


def _error_signal(
    s: Windows, solution: WindowSolution, exact: Array, i: int, error: str
) -> Array | float:
    """Change (W, samples) of readings of channel i, in its unit, by a unit of an error."""
    if error == "bias":
        return 1.0
    if error == "gain":
        off = solution.residuals[:, :, i] / np.maximum(s.weight[:, :, i], TINY)
        return s.measured[:, :, i] - off
    at = s.late_steps(i, s.first_half_step)
    by_delay = sum(
        w * exact[at.middle + q, i] for q, w in zip((-1, 0, 1), at.by_delay, strict=True)
    )
    return np.asarray(by_delay * (at.since if error == "clock" else 1.0))
