"""Noise of every channel for the report: RMS, colour, mains lines, resolution, delay.

Colour and mains lines are those of the residual of fusion (x, v) and of the force law (F), which
is noise unless something is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.layout import PREFIX_UNITS, QUANTITIES
from herringbone_sim.gap.data.noise import resolution
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.observations.force_law import SLOW_HZ
from herringbone_sim.gap.observations.runs import GearRun
from herringbone_sim.gap.residuals.mesh_law import law

MAINS_HZ = (50.0, 100.0, 150.0)
EXCESS = 4.0  # power of a line over that of white noise, which exceeds it at 1 of 50 lines


@dataclass(frozen=True)
class ChannelNoise:
    """Noise of a channel, by the keys of ``report.json``.

    Attributes:
        rms: in the unit of the channel.
        unit: of the channel.
        colour: ``white`` or ``1/f``.
        lines_hz: mains lines that stand out [Hz].
        step: resolution in the unit of the channel.
        delay_s: common delay of the runs [s].
        told: RMS if the campaign gives it; None if it is estimated.
    """

    rms: float
    unit: str
    colour: str
    lines_hz: tuple[float, ...]
    step: float
    delay_s: float
    told: float | None


def recorded_noise(runs: Sequence[GearRun], noise_known: bool) -> dict[str, ChannelNoise]:
    """Return the noise of every recorded channel, by channel name.

    Args:
        runs: fit runs.
        noise_known: whether the campaign gives the noise.
    """
    return {
        name: _channel_noise(there, quantity, j, noise_known)
        for quantity in QUANTITIES
        for j, name in enumerate(runs[0].run.model.layout.channels_of(quantity))
        if (there := [g for g in runs if getattr(g.run, quantity).recorded[j]])
    }


def _channel_noise(
    runs: Sequence[GearRun], quantity: str, j: int, noise_known: bool
) -> ChannelNoise:
    measured = [getattr(g.run, quantity) for g in runs]
    sigma = float(np.sqrt(np.mean([m.sigma[j] ** 2 for m in measured])))
    left = [_residual(g, quantity, j) for g in runs]
    colour, lines = "white", []
    if all(values is not None for values in left):
        spectra = [
            _spectral_excess(v, g.run) for v, g in zip(left, runs, strict=True) if v is not None
        ]
        colour = "1/f" if float(np.median([s[0] for s in spectra])) > EXCESS else "white"
        lines = [
            f for i, f in enumerate(MAINS_HZ) if np.median([s[1][i] for s in spectra]) > EXCESS
        ]
    step = float(np.median([resolution(m.values[:, [j]])[0] for m in measured]))
    return ChannelNoise(
        rms=sigma,
        unit=PREFIX_UNITS["F" if quantity == "pin" else quantity],
        colour=colour,
        lines_hz=tuple(lines),
        step=step,
        delay_s=float(np.mean([g.run.delay_rad / g.run.omega_rad_per_s for g in runs])),
        told=sigma if noise_known or all(_given(m, j) for m in measured) else None,
    )


def _given(measured: Measured, j: int) -> bool:
    """Whether the campaign gives the noise of channel j by itself."""
    return measured.sigma_given is not None and bool(measured.sigma_given[j])


def _residual(g: GearRun, quantity: str, j: int) -> Array | None:
    """Residual of a channel: x or v less the fused one, F less the nominal force law.

    The channel itself takes part in the fused motion.

    Args:
        g: the run.
        quantity: ``x``, ``v``, ``F``, ``u``, ``a`` or ``pin``.
        j: index of the mesh, body or pin.

    Returns:
        (n,) in the unit of the channel. None for ``u``, ``a`` and ``pin``, where a value is not
        known, and where all are exactly 0, as where the fused motion is the channel itself.
    """
    run = g.run
    if quantity == "x":
        values = run.x.values[:, j] - g.fused.x[:, j]
    elif quantity == "v":
        values = run.v.values[:, j] - g.fused.v[:, j]
    elif quantity == "F":
        values = run.F.values[:, j] - law(g.motion).force[:, j]
    else:
        return None
    return values if np.isfinite(values).all() and np.any(values) else None


def _spectral_excess(values: Array, run: PreparedRun) -> tuple[float, list[float]]:
    """Power of drift, and at ``MAINS_HZ``, over that of noise; 1 and 0 if not resolved."""
    centred = (values - values.mean()) * np.hanning(len(values))
    power = np.abs(np.fft.rfft(centred)) ** 2
    hz = np.fft.rfftfreq(len(values), run.step_s)
    mean = float(np.median(power[1:]) / np.log(2.0))
    slow = float(power[(hz > 0.0) & (hz < SLOW_HZ)].mean()) / mean if hz[1] < SLOW_HZ else 1.0
    lines = []
    for f in MAINS_HZ:
        near = int(np.argmin(np.abs(hz - f)))
        beside = np.r_[power[max(1, near - 4) : max(1, near - 1)], power[near + 2 : near + 5]]
        alone = beside.size and hz[1] < 0.2 * f
        lines.append(float(power[near] / max(beside.mean(), mean)) if alone else 0.0)
    return slow, lines
