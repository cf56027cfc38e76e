"""Measuring chain of a campaign: filter and encoders, then gauges, noise and converters.

The filter input is the motion sampled ``Sampling.finer`` times as finely as it is recorded,
interpolated by a cubic spline to a grid ``FINER`` times finer again, and linear between these
points; the response to that is exact. Gains of gauges and eccentricities of gratings are
calibration errors, not noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.random import Generator
from scipy.interpolate import CubicSpline
from scipy.signal import cont2discrete, lfilter, lfilter_zi

from herringbone_sim.arrays import Array, rms
from herringbone_sim.practice.channels import channels_of
from herringbone_sim.practice.noise import Noise
from herringbone_sim.practice.record import COS_BETA, FINER, Motion, geometry, without_trend
from herringbone_sim.practice.rig_model import BODIES, MESHES, NOMINAL, omega_n, radii

Channels = dict[str, Array]
Part = Mapping[str, Any]
MAINS = 50.0  # frequency of the mains [Hz]


def deterministic(noise: Noise, motion: Motion, fine: Motion | None) -> tuple[Channels, Channels]:
    """Return the channels after filter and encoders, without and with rounding to encoder counts.

    Args:
        fine: motion sampled more finely, for a filter; None: no filter.
    """
    part = noise.parts.get("encoders")
    seen = channels_of(motion)
    if fine is not None:
        finer = round((motion.times[1] - motion.times[0]) / (fine.times[1] - fine.times[0]))
        seen = filtered(fine, len(motion.times), noise.parts["filter"], finer)
    if part is None:
        return seen, seen
    return encoded(seen, motion, part, counted=False), encoded(seen, motion, part, counted=True)


def filtered(fine: Motion, count: int, part: Part, finer: int) -> Channels:
    """Return all channels after the low-pass, at the last ``count`` recorded times.

    Args:
        fine: motion at ``finer`` samples per recorded sample.
        part: parameters of the filter, see ``low_pass``.
    """
    channels = channels_of(fine)
    values = np.stack(list(channels.values()), axis=1)
    step = (fine.times[1] - fine.times[0]) / FINER
    closer = fine.times[0] + step * np.arange((len(fine.times) - 1) * FINER + 1)
    passed = low_pass(CubicSpline(fine.times, values)(closer), step, part)
    recorded = passed[:: FINER * finer][-count:]
    return {name: recorded[:, i] for i, name in enumerate(channels)}


def low_pass(values: Array, step: float, part: Part) -> Array:
    """Return the filter response (n, k) to inputs (n, k) that are linear between samples.

    It begins in the steady state of the first input.

    Args:
        step: time between samples [s].
        part: ``order`` 1 or 2, ``corner`` frequency over omega_n, damping ``ratio`` for order 2.
    """
    corner = float(part["corner"]) * omega_n()
    poles = [1.0 / corner, 1.0]
    if part["order"] == 2:
        poles = [1.0 / corner**2, 2.0 * float(part["ratio"]) / corner, 1.0]
    numerator, denominator, _ = cont2discrete(([1.0], poles), step, method="foh")
    b, a = numerator.ravel(), denominator.ravel()
    start = lfilter_zi(b, a)[:, None] * values[:1]
    return np.asarray(lfilter(b, a, values, axis=0, zi=start)[0])


def turns() -> Array:
    """Return revolutions (9,) of each body per mesh cycle in the inertial frame (planets < 0)."""
    carrier = 1.0 / 77.0
    planet = carrier * (1.0 - 77.0 / 25.0)
    return np.array([carrier * (1.0 + 77.0 / 27.0)] * 2 + [carrier] + [planet] * 6)


def encoded(seen: Channels, motion: Motion, part: Part, counted: bool) -> Channels:
    """Return the channels with u read by encoders, and x and v computed from encoder readings.

    If there is a second set of gratings, x and v are computed from its readings.

    Args:
        part: ``encoders`` of ``Noise.parts``.
        counted: round angles to whole counts; else gratings are infinitely fine.
    """
    exact = np.stack([seen[f"u_{b}"] for b in BODIES], axis=1)
    step = 2.0 * np.pi / int(part["counts"]) if counted else 0.0
    sets = [
        _by_grating(exact, motion, np.array(off), np.array(angle), step)
        for off, angle in zip(part["off"], part["angle"], strict=True)
    ]
    u, of_mesh = sets[0], sets[-1]
    if part["rate"] == "spline":
        rate = CubicSpline(motion.times, of_mesh)(motion.times, 1)
    else:
        rate = np.gradient(of_mesh, motion.times, axis=0)
    omega = float(motion.phase[-1] - motion.phase[0]) / float(motion.times[-1])
    wave = NOMINAL.e_sp * np.exp(1j * motion.phase)[:, None]
    x = geometry(of_mesh) * COS_BETA - wave.imag
    v = geometry(rate) * COS_BETA - omega * wave.real
    own = {f"u_{b}": u[:, i] for i, b in enumerate(BODIES)}
    own |= {f"x_{m}": x[:, j] for j, m in enumerate(MESHES)}
    return {**seen, **own, **{f"v_{m}": v[:, j] for j, m in enumerate(MESHES)}}


def _by_grating(u: Array, motion: Motion, off: Array, angle: Array, step: float) -> Array:
    """Return u (n, 9) [m] read by one set of gratings, without the trend of the rotation.

    ``off``, ``angle``: eccentricity and its direction [rad]; ``step``: a count [rad], 0 for exact.
    """
    r_s, r_p, _, r_c = radii()
    radius = np.array([r_s, r_s, r_c, *[r_p] * 6])
    steady = motion.phase[:, None] * turns()
    shown = steady + u / radius + off * np.cos(steady + angle)
    if step > 0.0:
        shown = np.round(shown / step) * step
    return without_trend((shown - steady) * radius, motion.times)


def by_encoder(noise: Noise, name: str) -> bool:
    """Return whether a channel is computed from encoder counts, and so gets no other noise."""
    return "encoders" in noise.parts and name[0] in "uxv"


def gauged(noise: Noise, channels: Mapping[str, Array]) -> Channels:
    """Return the channels multiplied by the gains of their force gauges."""
    gains = noise.parts.get("gains", {}).get("of", {})
    return {name: values * gains.get(name, 1.0) for name, values in channels.items()}


def measured(
    noise: Noise,
    channels: Mapping[str, Array],
    times: Array,
    rng: Generator,
    peaks: Mapping[str, float],
) -> Channels:
    """Add random noise to each channel and round it to the steps of its converter.

    Channels computed from encoder counts are unchanged.

    Args:
        noise: measuring chain; its ``share`` is the RMS of the noise over that of the channel.
        times: (n,) [s].
        peaks: largest value of each quantity over the campaign, which sets the converter range.
    """
    start = rng.uniform(0.0, 2.0 * np.pi)
    shown = {}
    for name, values in channels.items():
        if by_encoder(noise, name):
            shown[name] = values
            continue
        sigma = noise.share * rms(values)
        drawn = values + sigma * random_part(noise, times, rng, start)
        step = _step(noise, sigma, peaks[name[0]])
        shown[name] = np.round(drawn / step) * step if step > 0.0 else drawn
    return shown


def random_part(noise: Noise, times: Array, rng: Generator, mains: float) -> Array:
    """Return noise (n,) of RMS 1: white noise, drift and hum by their fractions of its power.

    Args:
        mains: phase [rad] of the mains at time 0, equal for all channels.
    """
    drift, hum = noise.parts.get("drift", {}), noise.parts.get("hum", {})
    rest = 1.0 - float(drift.get("power", 0.0)) - float(hum.get("power", 0.0))
    total: Array = np.sqrt(rest) * rng.normal(size=len(times))
    if drift:
        total += np.sqrt(float(drift["power"])) * _drift(str(drift["law"]), len(times), rng)
    if hum:
        turn = 2.0 * np.pi * MAINS * times + mains
        sign = rng.choice([-1.0, 1.0])
        waves = [a * np.sin((k + 1) * (turn + 0.3 * k)) for k, a in enumerate(hum["lines"])]
        total += sign * np.sqrt(2.0 * float(hum["power"])) * np.sum(waves, axis=0)
    return total


def _drift(law: str, n: int, rng: Generator) -> Array:
    """Return slow noise (n,) of RMS 1, mean included, with spectrum 1/f^2 (law ``walk``) or 1/f.

    It changes over four times the run, so that most of it may be an offset of the run.
    """
    spectrum = np.fft.rfft(rng.normal(size=4 * n))
    order = np.maximum(np.arange(len(spectrum)), 1.0)
    slow = np.fft.irfft(spectrum / (order if law == "walk" else np.sqrt(order)))[:n]
    return np.asarray(slow / rms(slow))


def _step(noise: Noise, sigma: float, peak: float) -> float:
    """Return the step of the converter; if none is drawn, a power of two <= sigma / 8, or 0."""
    part = noise.parts.get("converter")
    if part is not None:
        return 2.0 * float(part["room"]) * peak / 2.0 ** int(part["bits"])
    return float(2.0 ** np.floor(np.log2(sigma / 8.0))) if sigma > 0.0 else 0.0
