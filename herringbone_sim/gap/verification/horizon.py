"""Prediction over a horizon that is short against the Lyapunov time, from measured states.

A recording is a few thousand measured states. From many of them the model runs on for a mesh
cycle, or for half a Lyapunov time where that is shorter, and is held against what was measured
there. What the noise of start and end gives is found with the same model: started from states that
are off by a realisation of the noise, it ends where it would not have.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.effects.gear import gear_table, pointers_allowed, scratch
from herringbone_sim.effects.instant import recorded
from herringbone_sim.gap.data.geometry import coordinates_to_meshes
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.residuals.fusion import Fused
from herringbone_sim.gap.residuals.recalibrate import force_law
from herringbone_sim.gap.verification.simulator import GearSimulator, phase_step

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LONGEST = 1.0  # mesh cycles
LYAPUNOV_TIMES = 0.5
STARTS = 80  # a run
SETTLED = 5.0  # mesh cycles that an effect's own states are given
SUBSTEPS = 4
CLOSE = 1e-6  # of a second run beside the first, in units of b_c


@dataclass(frozen=True)
class Horizon:
    """Where predictions start, and how far they reach.

    Attributes:
        starts: (s,) samples.
        samples: from a start to the last predicted sample.
        cycles: the same in mesh cycles.
    """

    starts: Index
    samples: int
    cycles: float


def horizon_of(run: PreparedRun, exponent: float) -> Horizon:
    """Starts spread over a run, and a horizon by its largest exponent [1 / mesh cycle]."""
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
    run: PreparedRun, fused: Fused, machine: GearSimulator, ahead: Horizon
) -> float:
    """RMS error of the predicted mesh displacements [m], over starts, samples and meshes."""
    found = _run_on(
        run, fused.z, fused.z_rate, machine, ahead, own_states(run, fused, machine, ahead.starts)
    )
    return _rms(found - _measured(fused.z, ahead), run)


def prediction_floor(
    run: PreparedRun, fused: Fused, noise: Fused, machine: GearSimulator, ahead: Horizon
) -> float:
    """What the noise of start and end would give if the model were right [m].

    Args:
        noise: a realisation of the noise of ``fused``, see ``motion.fused_noise``.
    """
    own = own_states(run, fused, machine, ahead.starts)
    right = _run_on(run, fused.z, fused.z_rate, machine, ahead, own)
    off = _run_on(run, fused.z + noise.z, fused.z_rate + noise.z_rate, machine, ahead, own)
    return _rms(off - right - _measured(noise.z, ahead), run)


def largest_exponent(
    run: PreparedRun, fused: Fused, machine: GearSimulator, rng: np.random.Generator
) -> tuple[float, float]:
    """Largest Lyapunov exponent of the model at a run's operating point, and its error.

    Two runs from the first measured state on, brought back to their distance each mesh cycle
    (Benettin et al. 1980), over as many cycles as were recorded; the first fifth is left out.

    Returns:
        Value and standard error of the mean, per mesh cycle; NaN where the motion diverges.
    """
    s = machine.model.scales
    m = machine.model.layout.n_coordinate
    unit = np.repeat([s.b_c, s.velocity_m_per_s], m)
    cycles = max(int((run.phase[-1] - run.phase[0]) / (2.0 * np.pi)), 10)
    state = np.concatenate([fused.z[0], fused.z_rate[0]])
    own = np.zeros((2, machine.laws.n_own))
    tangent = rng.normal(size=2 * m)
    growth = np.empty(cycles)
    tangent *= CLOSE / np.linalg.norm(tangent)
    for cycle in range(cycles):
        pair = np.stack([state, state + tangent * unit])
        phase = np.full(2, run.phase[0] + 2.0 * np.pi * cycle)
        found = machine.run(pair[:, :m], pair[:, m:], phase, 2.0 * np.pi, 2, own)
        ends = np.hstack([found.z[:, 1], found.z_rate[:, 1]])
        state, own = ends[0], found.own[:1, 1].repeat(2, axis=0)
        tangent = (ends[1] - ends[0]) / unit
        length = float(np.linalg.norm(tangent))
        if not np.isfinite(length) or length == 0.0:
            return float("nan"), float("nan")
        growth[cycle] = np.log(length / CLOSE)
        tangent *= CLOSE / length
    kept = growth[cycles // 5 :]
    batches = np.array([part.mean() for part in np.array_split(kept, min(10, len(kept)))])
    return float(kept.mean()), float(batches.std(ddof=1) / np.sqrt(len(batches)))


def own_states(run: PreparedRun, fused: Fused, machine: GearSimulator, starts: Index) -> Array:
    """Effects' own states (s, n_own) at some samples, driven by the forces of the run until there.

    Measured forces, or those of the nominal law where they are not measured.
    """
    n_own = machine.laws.n_own
    found = np.zeros((len(starts), n_own))
    if not n_own:
        return found
    law = force_law(run, fused, np.ones(6)).modelled_n
    force = np.where(np.isfinite(run.F.values), run.F.values, law)
    p = run.model.parameters
    columns = (run.phase, run.omega_rad_per_s, p.delta_T, p.T_1, p.K)
    now = np.stack([np.broadcast_to(one, run.phase.shape) for one in columns], axis=1)
    own, before = np.zeros(n_own), 0
    work, gear = scratch(machine.model, n_own), gear_table(machine.model)
    with pointers_allowed():
        for i, start in enumerate(starts):
            rows = slice(before, start + 1)
            count = start + 1 - before
            recorded(
                machine.laws.kernel,
                machine.laws.site,
                machine.laws.theta,
                gear,
                run.times[rows],
                np.ascontiguousarray(now[rows], dtype=float),
                fused.x[rows],
                fused.v[rows],
                force[rows],
                own,
                work,
                SUBSTEPS,
                np.empty((count, force.shape[1])),
                np.empty((count, len(machine.model.layout.bodies))),
            )
            found[i], before = own, start
    return found


def _run_on(
    run: PreparedRun, z: Array, z_rate: Array, machine: GearSimulator, ahead: Horizon, own: Array
) -> Array:
    at = ahead.starts
    found = machine.run(z[at], z_rate[at], run.phase[at], phase_step(run), ahead.samples + 1, own)
    return found.z[:, 1:]


def _measured(z: Array, ahead: Horizon) -> Array:
    """(s, samples, n_coordinate) after each start."""
    after: Array = z[ahead.starts[:, None] + np.arange(1, ahead.samples + 1)]
    return after


def _rms(error: Array, run: PreparedRun) -> float:
    x = error @ coordinates_to_meshes(run.model.layout).T
    return float(np.sqrt(np.mean(x**2)))
