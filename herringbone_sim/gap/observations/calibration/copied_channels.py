"""Drop channels that were computed from other channels, so that each measurement counts once.

Displacements that agree with rotations more closely than independent noise allows are copies; so
are rates that agree with the derivative of displacements. Displacements worked out of a second set
of encoders are no copies of the first, but their noise is that of few encoders in all of them:
where the sets agree, they are dropped too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh

from herringbone_sim.arrays import Flags, rms
from herringbone_sim.gap.data.kinematics import (
    bodies_to_coordinates,
    bodies_to_meshes,
    coordinates_to_meshes,
)
from herringbone_sim.gap.data.prepared import PreparedRun, deciding
from herringbone_sim.gap.residuals.foreign_runs import once_a_turn
from herringbone_sim.gap.residuals.fusion import (
    QUADRATURE,
    displacement,
    increments,
    mesh_sigma,
    to_meshes,
)
from herringbone_sim.gap.sensors.correction import without_channels

# RMS disagreement over that of independent noise below which a channel is a copy; chosen.
COPY_SHARE = 0.5
# Disagreement of two sets of encoders, power in the lower over that in the upper half of the band,
# above which one of them has an error: twice the noise in amplitude; chosen.
DISAGREE = 4.0
# Variance of the slope of a cubic spline through white noise of variance 1 at unit spacing.
SPLINE_SLOPE_NOISE = float(
    np.sum(CubicSpline(np.arange(33.0), np.eye(33)[16]).derivative()(np.arange(33.0)) ** 2)
)


def drop_common_copies(runs: Sequence[PreparedRun]) -> tuple[PreparedRun, ...]:
    """Return the runs with copied x and v marked as not recorded, the same channels in all runs.

    A recorder computes channels alike in every run, but a single run may not show it. So, if in
    most fit runs most recorded channels of a quantity are copies, its channels are dropped, except
    those that are recorded and no copy in one of these runs. Rates that remain are those, with the
    noise, that ``without_computed`` gives.
    """
    gone: list[str] = []
    reduced_runs = [without_computed(run) for run in runs]
    layout, fit, of_fit = runs[0].model.layout, deciding(runs), deciding(reduced_runs)
    for q in ("x", "v"):
        was, now = (
            np.array([getattr(run, q).recorded for run in group]) for group in (fit, of_fit)
        )
        lost = was & ~now
        shows = 2 * lost.sum(axis=1) > was.sum(axis=1)
        if 2 * shows.sum() > was.any(axis=1).sum():
            dropped = (lost | ~was)[shows].all(axis=0) & lost[shows].any(axis=0)
            gone += [name for name, out in zip(layout.channels_of(q), dropped, strict=True) if out]
    return tuple(
        without_channels(_with_rates(run, reduced), tuple(gone))
        for run, reduced in zip(runs, reduced_runs, strict=True)
    )


def without_computed(run: PreparedRun) -> PreparedRun:
    """Return a run with x and v that were computed from its other channels as not recorded.

    x that repeats u is dropped mesh by mesh, if all u are recorded and most x repeat them; all x
    together, if they come from a second set of encoders that agrees with u. v is dropped mesh by
    mesh. Where most v repeat x or u, the others get at least the noise of a differentiated
    displacement.
    """
    x = run.model.layout.channels_of("x")
    second_set = _has_second_encoders(run)
    run = _without_repeats(run)
    return without_channels(run, x) if second_set else run


def _has_second_encoders(run: PreparedRun) -> bool:
    """Whether x comes from a second set of encoders, which agrees with u.

    Then x obeys the geometry exactly, without u, and differs from u by white noise and by
    oscillations once a revolution. All x and u must be recorded.
    """
    if not (run.x.complete and run.u.complete):
        return False
    D = coordinates_to_meshes(run.model.layout)
    x = run.x.values + run.waves.e
    z = x @ np.linalg.pinv(D).T
    of_noise = np.sqrt(1.0 - np.linalg.matrix_rank(D) / len(D))  # what independent sensors leave
    by_mesh = np.sqrt(np.mean((x - z @ D.T) ** 2, axis=0)) / run.x.sigma
    if not by_mesh.max() < COPY_SHARE * of_noise:
        return False
    off = z - run.u.values @ bodies_to_coordinates(run.model).T
    lines = once_a_turn(run)
    off = (off - lines @ (lines.T @ off)) * np.hanning(len(off))[:, None]
    spectrum = np.fft.rfft(off, axis=0)[1:-1]
    lower, upper = (
        np.real(half.conj().T @ half) / len(half)
        for half in np.split(spectrum, [len(spectrum) // 2])
    )
    if np.linalg.eigvalsh(upper)[0] <= 1e-9 * np.trace(upper):  # x repeats u, or a part of it
        return False
    return float(eigh(lower, upper, eigvals_only=True)[-1]) < DISAGREE


def _without_repeats(run: PreparedRun) -> PreparedRun:
    """Return a run with x that repeats u, and v that repeats x or u, as not recorded."""
    layout = run.model.layout
    by_mesh, by_body = layout.channels_of("x"), layout.channels_of("u")
    run = without_channels(run, _repeating_rotations(run))
    # Rates may come from displacements, of one mesh or fused, from rotations, or from both.
    D = coordinates_to_meshes(layout)
    estimates = [
        displacement(variant)
        for variant in (run, without_channels(run, by_mesh), without_channels(run, by_body))
    ]
    sources = [(run.x.values + run.waves.e, run.x.sigma**2)]
    sources += [(to_meshes(D, z), mesh_sigma(D, P) ** 2) for z, P in estimates]
    disagreements = [(_disagreement(run, x, of_x), x, of_x) for x, of_x in sources]
    if not run.v.recorded.any():
        return run
    share, x, of_x = min(disagreements, key=lambda found: _median(run, found[0]))
    if _median(run, share) < COPY_SHARE:
        # A rate that disagrees although the others are copies has an error: it stays recorded,
        # with the noise of a slope.
        run = _without_difference_errors(run, x, share < COPY_SHARE)
        shares = zip(layout.channels_of("v"), share, strict=True)
        run = without_channels(run, tuple(name for name, off in shares if off < COPY_SHARE))
        of_slope = np.sqrt(SPLINE_SLOPE_NOISE * of_x) / run.step_s
        run = with_rate_noise(run, np.fmax(run.v.sigma, of_slope))
    return run


def _repeating_rotations(run: PreparedRun) -> tuple[str, ...]:
    """Names of the x that repeat u; none unless all u are recorded and most x repeat them.

    A displacement that differs although the others are copies has an error, and is no copy.
    """
    if not (run.u.complete and run.x.recorded.any()):
        return ()
    G = bodies_to_meshes(run.model)
    noise = np.sqrt(run.x.sigma**2 + G**2 @ run.u.sigma**2)
    off = run.x.values + run.waves.e - run.u.values @ G.T
    share = np.sqrt(np.mean(off**2, axis=0)) / noise
    if not np.median(share[run.x.recorded]) < COPY_SHARE:
        return ()
    shares = zip(run.model.layout.channels_of("x"), share, strict=True)
    return tuple(name for name, of_mesh in shares if of_mesh < COPY_SHARE)


def _without_difference_errors(
    run: PreparedRun, x: NDArray[np.float64], copies: Flags
) -> PreparedRun:
    """Return a run with rates by a spline through ``x``, if ``copies`` are central differences.

    The error of a rate stays: the difference of the two slopes is added to what was recorded.

    Args:
        x: (n, n_mesh) displacements that the rates were worked out of [m].
        copies: (n_mesh,) rates known to be worked out.
    """
    times = np.arange(len(x)) * run.step_s
    central = np.gradient(x, run.step_s, axis=0)
    known = np.isfinite(x).all(axis=0) & run.v.recorded
    spline = np.full_like(x, np.nan)
    spline[:, known] = CubicSpline(times, x[:, known]).derivative()(times)
    rate = run.v.values + run.waves.e_rate
    by_central, by_spline = (rms((slope - rate)[8:-8, copies]) for slope in (central, spline))
    if not by_central < by_spline:
        return run
    values = np.where(known, run.v.values + spline - central, run.v.values)
    return replace(run, v=replace(run.v, values=values))


def _with_rates(run: PreparedRun, reduced: PreparedRun) -> PreparedRun:
    """Copy of a run with the rates and their noise that ``without_computed`` left recorded."""
    values = np.where(reduced.v.recorded, reduced.v.values, run.v.values)
    run = replace(run, v=replace(run.v, values=values))
    return with_rate_noise(run, reduced.v.sigma)


def with_rate_noise(run: PreparedRun, sigma: NDArray[np.float64]) -> PreparedRun:
    """Copy of a run with the noise ``sigma`` (n_mesh,) [m/s] of recorded rates, where finite."""
    known = run.v.recorded & np.isfinite(sigma)
    return replace(run, v=replace(run.v, sigma=np.where(known, sigma, run.v.sigma)))


def _median(run: PreparedRun, share: NDArray[np.float64]) -> float:
    """Median of ``share`` (n_mesh,) over the meshes whose rate is recorded."""
    return float(np.median(share[run.v.recorded]))


def _disagreement(
    run: PreparedRun, x: NDArray[np.float64], of_x: NDArray[np.float64]
) -> NDArray[np.float64]:
    """RMS disagreement (n_mesh,) of rates with displacements, over that of independent noise.

    The least of three comparisons: integral of rates, central differences, spline. Infinite where
    rate or displacement is not known.

    Args:
        x: (n, n_mesh) displacements [m].
        of_x: (n_mesh,) their variance.
    """
    h = run.step_s
    known = run.v.recorded & np.isfinite(x).all(axis=0)
    disagreement = np.full(len(known), np.inf)
    if not known.any():
        return disagreement
    x, rate = x[:, known], (run.v.values + run.waves.e_rate)[:, known]
    of_x, of_v = of_x[known], run.v.sigma[known] ** 2
    integral = (np.diff(x, axis=0) - increments(rate, h))[2:-2]
    slope = (np.gradient(x, h, axis=0) - rate)[1:-1]
    times = np.arange(len(x)) * h
    spline = (CubicSpline(times, x).derivative()(times) - rate)[8:-8]
    shares = [
        np.mean(off**2, axis=0) / expected
        for off, expected in (
            (integral, 2.0 * of_x + h**2 * float(np.sum(QUADRATURE**2)) * of_v),
            (slope, 0.5 * of_x / h**2 + of_v),
            (spline, SPLINE_SLOPE_NOISE * of_x / h**2 + of_v),
        )
    ]
    disagreement[known] = np.sqrt(np.min(shares, axis=0))
    return disagreement
