"""Prediction error over a horizon that is short against the Lyapunov time.

From many measured states of a recording the model is simulated over one mesh cycle, or half a
Lyapunov time where that is shorter, and compared with the measurement. The error by noise alone is
estimated with the same model, from initial states changed by a realisation of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array, Indices, rms
from herringbone_sim.effects.gear import gear_table, pointers_allowed, scratch
from herringbone_sim.effects.instant import recorded
from herringbone_sim.gap.attribution.effect_forces import instants
from herringbone_sim.gap.data.kinematics import coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.residuals.fusion import Fused
from herringbone_sim.gap.residuals.recalibrate import force_law
from herringbone_sim.gap.verification.simulator import GearSimulator, phase_step

LONGEST = 1.0  # largest horizon, mesh cycles
LYAPUNOV_TIMES = 0.5  # largest horizon over the Lyapunov time
STARTS = 80  # predictions per run
SETTLED = 5.0  # mesh cycles before the first prediction, for states of effects to settle
SUBSTEPS = 4  # integration steps per sample, for states of effects
SEPARATION = 1e-6  # initial distance of two neighbouring simulations, dimensionless


@dataclass(frozen=True)
class Horizon:
    """Start samples and length of the predictions in a run.

    Attributes:
        starts: (s,) indices of the samples at which predictions start.
        samples: length of a prediction in samples.
        cycles: the same in mesh cycles.
    """

    starts: Indices
    samples: int
    cycles: float


def horizon_of(run: PreparedRun, exponent: float) -> Horizon:
    """Return equidistant start samples in a run, and the length of predictions.

    ``exponent``: largest Lyapunov exponent of the run [1 / mesh cycle]; not positive or NaN: the
    horizon is ``LONGEST``.
    """
    turn = phase_step(run)
    longest = min(LONGEST, LYAPUNOV_TIMES / exponent) if exponent > 0.0 else LONGEST
    samples = max(int(longest * 2.0 * np.pi / turn + 1e-6), 1)
    first = int(SETTLED * 2.0 * np.pi / turn)
    last = len(run) - 1 - samples
    first = first if first < last else 0
    count = min(STARTS, max(last - first, 1))
    starts = np.linspace(first, max(last, first), count).astype(np.int64)
    return Horizon(starts, samples, samples * turn / (2.0 * np.pi))


def prediction_error(
    run: PreparedRun, fused: Fused, simulator: GearSimulator, horizon: Horizon
) -> float:
    """Return the RMS error of predicted mesh displacements [m] over starts, samples and meshes."""
    added_states = states_of_effects(run, fused, simulator, horizon.starts)
    predicted = _predict(run, fused.z, fused.z_rate, simulator, horizon, added_states)
    return _rms(predicted - _after_starts(fused.z, horizon), run)


def prediction_floor(
    run: PreparedRun, fused: Fused, noise: Fused, simulator: GearSimulator, horizon: Horizon
) -> float:
    """Return the prediction error [m] of a perfect model by the noise of start and end states.

    Args:
        run, fused: the run and its fused motion.
        noise: a realisation of the noise of ``fused``, see ``motion.fused_noise``.
        simulator: of the model.
        horizon: of the predictions.
    """
    added_states = states_of_effects(run, fused, simulator, horizon.starts)
    plain = _predict(run, fused.z, fused.z_rate, simulator, horizon, added_states)
    noisy = _predict(
        run, fused.z + noise.z, fused.z_rate + noise.z_rate, simulator, horizon, added_states
    )
    return _rms(noisy - plain - _after_starts(noise.z, horizon), run)


def largest_exponent(
    run: PreparedRun, fused: Fused, simulator: GearSimulator, rng: np.random.Generator
) -> tuple[float, float]:
    """Compute the largest Lyapunov exponent of the model at the operating point of a run.

    It is the growth of the distance of two simulations from the first measured state, rescaled
    each mesh cycle (Benettin et al. 1980), over the length of the run without its first fifth.
    States of effects are reset to those of the first simulation at each rescaling.

    Returns:
        Value and standard error of the mean, per mesh cycle; both NaN if the motion diverges.
    """
    s = simulator.model.scales
    m = simulator.model.layout.n_coordinate
    unit = np.repeat([s.b_c, s.velocity_m_per_s], m)
    cycles = max(int(run.cycles), 10)
    state = np.concatenate([fused.z[0], fused.z_rate[0]])
    added_states = np.zeros((2, simulator.laws.n_added_states))
    tangent = rng.normal(size=2 * m)
    growth = np.empty(cycles)
    tangent *= SEPARATION / np.linalg.norm(tangent)
    for cycle in range(cycles):
        pair = np.stack([state, state + tangent * unit])
        phase = np.full(2, run.phase[0] - run.delay_rad + 2.0 * np.pi * cycle)
        simulated = simulator.run(pair[:, :m], pair[:, m:], phase, 2.0 * np.pi, 2, added_states)
        ends = np.hstack([simulated.z[:, 1], simulated.z_rate[:, 1]])
        state, added_states = ends[0], simulated.added_states[:1, 1].repeat(2, axis=0)
        tangent = (ends[1] - ends[0]) / unit
        length = float(np.linalg.norm(tangent))
        if not np.isfinite(length) or length == 0.0:
            return float("nan"), float("nan")
        growth[cycle] = np.log(length / SEPARATION)
        tangent *= SEPARATION / length
    settled = growth[cycles // 5 :]
    batches = np.array([part.mean() for part in np.array_split(settled, min(10, len(settled)))])
    return float(settled.mean()), float(batches.std(ddof=1) / np.sqrt(len(batches)))


def states_of_effects(
    run: PreparedRun, fused: Fused, simulator: GearSimulator, starts: Indices
) -> Array:
    """Integrate the states of effects along a run; return them at ``starts``, (s, n_added_states).

    They are driven by the measured forces, or those of the nominal law where none are measured.
    """
    n_added_states = simulator.laws.n_added_states
    result = np.zeros((len(starts), n_added_states))
    if not n_added_states:
        return result
    law = force_law(run, fused, np.ones(6)).modelled_n
    force = np.where(np.isfinite(run.F.values), run.F.values, law)
    now = instants(run)
    added_states, before = np.zeros(n_added_states), 0
    work, gear = scratch(simulator.model, n_added_states), gear_table(simulator.model)
    with pointers_allowed():
        for i, start in enumerate(starts):
            rows = slice(before, start + 1)
            count = start + 1 - before
            recorded(
                *simulator.laws,
                gear,
                run.times[rows],
                now[rows],
                fused.x[rows],
                fused.v[rows],
                force[rows],
                added_states,
                work,
                SUBSTEPS,
                np.empty((count, force.shape[1])),
                np.empty((count, len(simulator.model.layout.bodies))),
            )
            result[i], before = added_states, start
    return result


def _predict(
    run: PreparedRun,
    z: Array,
    z_rate: Array,
    simulator: GearSimulator,
    horizon: Horizon,
    added_states: Array,
) -> Array:
    """Simulate from each start; return coordinates (s, samples, n_coordinate) [m] after the start.

    Args:
        run: whose mesh phase at the starts is used.
        z, z_rate: (n, n_coordinate) measured motion [m], [m/s], which holds the initial states.
        simulator: of the model.
        horizon: start samples and length.
        added_states: (s, n_added_states) at the starts.
    """
    at = horizon.starts
    phase = run.phase[at] - run.delay_rad  # of the motion that the channels show then
    simulated = simulator.run(
        z[at], z_rate[at], phase, phase_step(run), horizon.samples + 1, added_states
    )
    return simulated.z[:, 1:]


def _after_starts(z: Array, horizon: Horizon) -> Array:
    """Select the samples (s, samples, n_coordinate) of z (n, n_coordinate) after each start."""
    after: Array = z[horizon.starts[:, None] + np.arange(1, horizon.samples + 1)]
    return after


def _rms(error: Array, run: PreparedRun) -> float:
    """Return the RMS error of mesh displacements, from errors (..., n_coordinate) of z."""
    x = error @ coordinates_to_meshes(run.model.layout).T
    return rms(x)
