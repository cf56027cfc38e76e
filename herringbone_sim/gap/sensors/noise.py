"""Estimate channel noise from consistency and the force law; check what campaign.yaml gives.

The spectrum of a channel contains motion up to its highest frequencies, but misses quantisation
errors that lie in spectral lines. The residuals of x, u and v about the geometry contain no
motion, and that of F about the force law contains little.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.layout import QUANTITIES
from herringbone_sim.gap.data.kinematics import bodies_to_coordinates, coordinates_to_meshes
from herringbone_sim.gap.data.noise import at_least_quantisation, spectral_floor
from herringbone_sim.gap.data.prepared import Measured, PreparedCampaign, PreparedRun, deciding
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.residuals.recalibrate import force_law
from herringbone_sim.gap.sensors.consistency import geometric_residuals

COPY = 1e-3  # residual over noise below which channels were computed from one another
WORKED_OUT = 0.1  # the same, below which channels were rounded after they were computed; chosen
LEAST = 0.3  # least noise of a force over that from its spectrum
DRIFT_SHARE = 0.5  # RMS of drift and hum over that of the noise, data sheet
# White noise over the given one, of which drift and hum are a part, or on top of which they come.
WHITE_SHARES = np.sqrt(1.0 - DRIFT_SHARE**2), np.sqrt(1.0 + DRIFT_SHARE**2)


def without_wrong_noise(campaign: PreparedCampaign) -> tuple[PreparedCampaign, float]:
    """Campaign whose noise is unknown, if recordings contradict the noise that it gives.

    Returns:
        The campaign, and the actual noise over the given one; 1 where they agree.
    """
    if not (campaign.noise_known and campaign.runs):
        return campaign, 1.0
    ratio = float(np.median([_actual_over_given(run) for run in deciding(campaign.runs)]))
    if WHITE_SHARES[0] <= ratio <= WHITE_SHARES[1]:
        return campaign, 1.0
    runs = tuple(map(_with_noise_of_spectra, campaign.runs))
    return replace(campaign, runs=runs, noise_known=False), ratio


def _actual_over_given(run: PreparedRun) -> float:
    """White noise of a run over the noise assumed; where only spectra show it, at most 1.

    Of displacements and rates those count that agree better, as an error of all displacements, or
    rates worked out of them, contradict it alone. Those that may be worked out of rotations don't
    count.
    """
    (motion, _), (rate, _) = geometric_residuals(run)
    of_motion, of_rate = _noise_ratio(motion), _noise_ratio(rate)
    if of_motion > WORKED_OUT and of_motion != 1.0:
        known = [ratio for ratio in (of_motion, of_rate) if ratio != 1.0]
        return min(known, key=lambda ratio: abs(np.log(ratio)))
    if of_rate != 1.0 and not (run.x.recorded.any() or run.u.recorded.any()):
        return of_rate
    shares = [
        (at_least_quantisation(spectral_floor(m.values), m.values) / m.sigma)[m.recorded]
        for q in QUANTITIES
        for m in [getattr(run, q)]
        if m.recorded.any() and not (q in ("x", "v") and run.u.recorded.any())
    ]
    known = [share for of_quantity in shares for share in of_quantity if np.isfinite(share)]
    return min(1.0, float(np.median(known))) if known else 1.0


def _with_noise_of_spectra(run: PreparedRun) -> PreparedRun:
    """Run with the noise of every channel as its spectrum shows it.

    What is given for single channels stays but for x, v and u, which the geometry contradicts.
    """
    for q in QUANTITIES:
        m: Measured = getattr(run, q)
        if m.recorded.any():
            sigma = at_least_quantisation(spectral_floor(m.values), m.values)
            if q in ("x", "v", "u"):
                m = replace(m, sigma_given=None)
            run = run.with_measured(q, m.with_noise(np.where(m.recorded, sigma, np.nan)))
    return run


def with_estimated_noise(run: PreparedRun) -> PreparedRun:
    """Lower the noise of x, u, v and F to what their residuals show; that of x may also be raised.

    The noise of u is not raised: it is at least the quantisation noise, which x computed from
    rotations has too. Noise that campaign.yaml gives for a channel stays, and no noise falls below
    the quantisation noise.
    """
    motion, rate = (_noise_ratio(residual) for residual, _ in geometric_residuals(run))
    if motion > 1.0:
        run = replace(run, x=_scaled(run.x, _ratio_of_x(run, motion)))
    lower = min(motion, 1.0)
    run = replace(run, x=_scaled(run.x, lower), u=_scaled(run.u, lower))
    run = replace(run, v=_scaled(run.v, min(rate, 1.0)))
    fused = fuse(run)
    law = force_law(run, fused, np.ones(6))
    known = np.isfinite(law.residual_n).all(axis=0)
    if not known.any():
        return run
    sigma = run.F.sigma.copy()
    total = spectral_floor(law.residual_n[:, known]) ** 2
    of_motion = np.mean(law.sigma_n[:, known] ** 2, axis=0) - sigma[known] ** 2
    of_force = np.sqrt(np.maximum(total - of_motion, (LEAST * sigma[known]) ** 2))
    sigma[known] = np.minimum(sigma[known], of_force)
    return replace(run, F=run.F.with_noise(at_least_quantisation(sigma, run.F.values)))


def _noise_ratio(residual: Array) -> float:
    """Return the actual over the assumed noise of whitened residuals (n, d); 1 where unknown.

    The median over the principal components of the upper half of the band, as a wrong sensor shows
    in a few. Errors of encoder gratings lie below that band. Components near 0 are left out: they
    occur where channels were computed from others, or quantisation errors lie in spectral lines.
    """
    if not residual.size or not np.isfinite(residual).all():
        return 1.0
    window = np.hanning(len(residual))[:, None]
    spectrum = np.fft.rfft(residual * window, axis=0)
    upper = spectrum[len(spectrum) // 2 : -1]
    power = np.real(upper.conj().T @ upper) / (len(upper) * np.sum(window**2))
    of_combinations = np.linalg.eigvalsh(power)
    noisy = of_combinations[of_combinations > COPY**2]
    return float(np.sqrt(np.median(noisy))) if len(noisy) else 1.0


def _ratio_of_x(run: PreparedRun, ratio: float) -> float:
    """Return the factor on the noise of x that makes that of x - G u ``ratio`` times as large."""
    both = run.x.recorded.any() and run.u.recorded.any()
    if not both:
        return ratio
    rows = coordinates_to_meshes(run.model.layout) @ bodies_to_coordinates(run.model)
    there = run.x.recorded
    of_x = float(np.mean(run.x.sigma[there] ** 2))
    of_u = float(np.mean((rows[there] ** 2) @ np.nan_to_num(run.u.sigma) ** 2))
    return float(np.sqrt(1.0 + (ratio**2 - 1.0) * (1.0 + of_u / of_x)))


def _scaled(measured: Measured, scale: float) -> Measured:
    """Return channels with their noise scaled, but not below the quantisation noise."""
    return measured.with_noise(at_least_quantisation(scale * measured.sigma, measured.values))
