"""Comparison of attractors: statistics of long motions, which chaos does not affect.

A model is simulated from the first measured state over the length of the recording. Its contact
states, load sharing, spectra and Poincare sections are compared with those of the rig. The
distance between the two halves of the recording is the floor of these comparisons.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.distance import cdist

from herringbone_sim.arrays import Array, rms
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.channels import distort, on_channels
from herringbone_sim.effects.effect import Active
from herringbone_sim.gap.data.kinematics import coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.residuals.fusion import Fused
from herringbone_sim.gap.verification.simulator import GearSimulator, phase_step

SETTLE = 20  # mesh cycles of transient before the compared motion
BANDS = 12  # frequency bands, each half a mesh order wide
SECTIONS = 4  # Poincare sections, at equidistant mesh phases
UNITS = {"contact": "share of time", "load_sharing": "-", "spectrum": "dB", "section": "sigma"}


@dataclass(frozen=True)
class SampledMotion:
    """Motion at the samples of a recording: as measured, or simulated with the sensors' errors.

    Attributes:
        z, z_rate: (n, n_coordinate) coordinates (q, r) [m] and rates [m/s]; fused if measured.
        force_n: (n, n_mesh) mesh forces [N]; NaN where the recording has none.
    """

    z: Array
    z_rate: Array
    force_n: Array


@dataclass(frozen=True)
class Statistics:
    """Statistics of a motion.

    Attributes:
        contact: (n_mesh, 3) fraction of time on the driving flank, apart, on the back flank, by
            the displacement relative to the nominal e(t) and the nominal backlash.
        sharing: (n_mesh,) mean force over the sum of mean forces of all meshes of the same kind.
        bands: (BANDS, n_mesh) spectral power of the displacements in bands around multiples of
            half the mesh frequency [dB].
        points: (SECTIONS, m, 2 n_coordinate) Poincare sections at m mesh cycles: z and dz/dt over
            the standard deviations of the measured motion.
    """

    contact: Array
    sharing: Array
    bands: Array
    points: Array


def measured_motion(run: PreparedRun, fused: Fused) -> SampledMotion:
    """Return fused coordinates and measured forces of a run."""
    return SampledMotion(fused.z, fused.z_rate, run.F.values)


def model_motion(
    run: PreparedRun,
    fused: Fused,
    noise: Fused,
    simulator: GearSimulator,
    actives: Sequence[Active],
) -> SampledMotion:
    """Simulate the motion of a model from the first measured state, as sensors would record it.

    A transient of ``SETTLE`` mesh cycles is cut off; noise of the motion and errors of the force
    sensors are added. Forces are NaN where the run has none.

    Args:
        run, fused: the run and its fused motion.
        noise: a realisation of the noise of ``fused``, see ``motion.fused_noise``.
        simulator: of the model.
        actives: effects of the model; those on force sensors distort the forces.
    """
    turn = phase_step(run)
    before = round(SETTLE * 2.0 * np.pi / turn)
    start = run.phase[:1] - run.delay_rad - before * turn
    simulated = simulator.run(fused.z[:1], fused.z_rate[:1], start, turn, before + len(run))
    force = simulated.force_n[0, before:]
    names = run.model.layout.channels_of("F")
    sensors = on_channels(names, actives)
    if sensors:
        force = distort(TimeSeries(run.times, force, names), sensors).columns(names)
    return SampledMotion(
        simulated.z[0, before:] + noise.z,
        simulated.z_rate[0, before:] + noise.z_rate,
        np.where(np.isfinite(run.F.values), force, np.nan),
    )


def statistics(run: PreparedRun, motion: SampledMotion, rows: slice, scale: Array) -> Statistics:
    """Compute the statistics of some samples of a motion.

    Args:
        run: whose mesh phase, backlash and nominal e(t) are used.
        motion: at all samples of the run.
        rows: the samples.
        scale: (2 n_coordinate,) standard deviations of the measured motion.
    """
    z, rate, force = motion.z[rows], motion.z_rate[rows], motion.force_n[rows]
    x = z @ coordinates_to_meshes(run.model.layout).T - run.waves.e[rows]
    b = run.model.half_backlash_m
    drive, back = np.mean(x > b, axis=0), np.mean(x < -b, axis=0)
    mean = force.mean(axis=0).reshape(2, -1)
    return Statistics(
        contact=np.stack([drive, 1.0 - drive - back, back], axis=1),
        sharing=(mean / mean.sum(axis=1, keepdims=True)).ravel(),
        bands=_bands(x, phase_step(run)),
        points=_sections(np.hstack([z, rate]) / scale, run.phase[rows]),
    )


def distances(stats: Statistics, other: Statistics) -> dict[str, float]:
    """Return the distance of two motions in each statistic of ``UNITS``; NaN if not measured."""
    contact = 0.5 * np.abs(stats.contact - other.contact).sum(axis=1)
    return {
        "contact": float(contact.mean()),
        "load_sharing": rms(stats.sharing - other.sharing),
        "spectrum": rms(stats.bands - other.bands),
        "section": _energy_distance(stats.points, other.points),
    }


def half_statistics(
    run: PreparedRun, motion: SampledMotion, scale: Array
) -> tuple[Statistics, Statistics]:
    """Compute the statistics of the first and of the second half of a motion over a whole run."""
    m = len(motion.z) // 2
    first, second = (statistics(run, motion, slice(i * m, (i + 1) * m), scale) for i in (0, 1))
    return first, second


def mean_distances(
    halves: tuple[Statistics, Statistics], other_halves: tuple[Statistics, Statistics]
) -> dict[str, float]:
    """Return the distance of two motions in each of ``UNITS``, mean over all pairs of halves.

    Args:
        halves, other_halves: statistics of the first and the second half of each motion.
    """
    by_pair = [distances(a, b) for a in halves for b in other_halves]
    return {name: float(np.mean([d[name] for d in by_pair])) for name in UNITS}


def scale_of(fused: Fused) -> Array:
    """Return the standard deviations (2 n_coordinate,) of z and dz/dt; 1 for a constant."""
    spread: Array = np.hstack([fused.z, fused.z_rate]).std(axis=0)
    return np.where(spread > 0.0, spread, 1.0)


def statistics_to_dict(stats: Statistics, meshes: Sequence[str]) -> dict[str, object]:
    """Return contact and load sharing of each mesh as plain data for the report."""
    names = ("driving_flank", "apart", "back_flank")
    return {
        "contact": {
            mesh: dict(zip(names, (float(v) for v in row), strict=True))
            for mesh, row in zip(meshes, stats.contact, strict=True)
        },
        "load_share": {m: float(v) for m, v in zip(meshes, stats.sharing, strict=True)},
    }


def _bands(x: Array, turn: float) -> Array:
    """Return the power (BANDS, n_mesh) [dB] of x (n, n_mesh) about mesh orders 0.5, 1, 1.5, ...

    With a Hann window, not normalised: levels compare at equal n only. ``turn``: mesh phase per
    sample [rad].
    """
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(len(x)) / len(x))
    lines = np.abs(np.fft.rfft((x - x.mean(axis=0)) * window[:, None], axis=0)) ** 2
    order = np.arange(len(lines)) * 2.0 * np.pi / turn / len(x)
    edges = np.searchsorted(order, (np.arange(BANDS + 1) + 0.5) / 2.0)
    edges = np.minimum(edges, len(lines) - 1)
    power = np.stack([lines[a : max(b, a + 1)].sum(axis=0) for a, b in pairwise(edges)])
    bands: Array = 10.0 * np.log10(np.maximum(power, 1e-300))
    return bands


def _sections(states: Array, phase: Array) -> Array:
    """Interpolate states (n, d) at ``SECTIONS`` phases of each whole mesh cycle, linearly.

    Args:
        phase: (n,) mesh phase [rad], unwrapped, increasing.

    Returns:
        (SECTIONS, m, d) for the m whole cycles from the first phase 0 on.
    """
    turns = phase / (2.0 * np.pi)
    cuts = []
    for part in range(SECTIONS):
        at = np.arange(np.ceil(turns[0]), np.floor(turns[-1])) + part / SECTIONS
        right = np.clip(np.searchsorted(turns, at), 1, len(turns) - 1)
        share = ((at - turns[right - 1]) / (turns[right] - turns[right - 1]))[:, None]
        cuts.append(states[right - 1] + share * (states[right] - states[right - 1]))
    return np.stack(cuts)


def _energy_distance(points: Array, other: Array) -> float:
    """Return the root of the mean energy distance (Szekely and Rizzo 2013) over the sections."""
    squares = [
        2.0 * cdist(a, b).mean() - cdist(a, a).mean() - cdist(b, b).mean()
        for a, b in zip(points, other, strict=True)
    ]
    return float(np.sqrt(max(np.mean(squares), 0.0)))
