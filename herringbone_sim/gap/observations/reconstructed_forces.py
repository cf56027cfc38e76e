"""Forces of all meshes from the fitted windows of a run with few channels, with a 90 % band.

Forces are those of the law at the fitted states. The band contains, linearised about the fit, the
error of the states by the noise of the channels, and the error of the explanation's coefficients,
which moves the states too. The continuity of windows, which allows for an error of the law, is no
reading: it constrains the states but adds no noise. A residual larger than noise counts as noise,
but the band contains neither the error of a wrong law nor that of another minimum of the fit, such
as planets in another order.
C. D. Rodgers, Inverse Methods for Atmospheric Sounding (World Scientific, 2000), ch. 3: errors of
a retrieval by noise and by parameters of its model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.coefficients import Coefficient, amplitudes, functions_used
from herringbone_sim.diagnosis.fits import FittedExplanation
from herringbone_sim.diagnosis.judge import HALF_90
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.gap.attribution.effect_forces import fused_run
from herringbone_sim.gap.attribution.undecidable_by_channels import planets_indistinguishable
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations import force_law
from herringbone_sim.gap.observations.basis import Function, force_column
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.observations.windows import trajectory
from herringbone_sim.gap.observations.windows.channels import WindowChannels, window_channels
from herringbone_sim.gap.observations.windows.columns import nuisance_columns, window_columns
from herringbone_sim.gap.observations.windows.integrator import STATES
from herringbone_sim.gap.observations.windows.shooting import (
    WindowSolution,
    propagators,
    stacked_residual,
    window_jacobian,
)
from herringbone_sim.gap.observations.windows.trajectory import STATE_PRECISION, Trajectory
from herringbone_sim.gap.observations.windows.windows import Windows
from herringbone_sim.gap.residuals.mesh_law import Law, MeshMotion, law

# Prior deviation of the first window's start state over the RMS of the motion, as in the filter of
# ``windows.starts``.
FIRST_SD = 1.0


@dataclass(frozen=True)
class ReconstructedForces:
    """Forces of all meshes at the n samples of the fitted windows of a run.

    Attributes:
        run, role: name and role of the run.
        effects: ids of the effects of the explanation; empty for the calibrated gear.
        meshes: names.
        planets_alike: whether neither model nor channels distinguish the planets, so that the
            forces of two planets may be exchanged.
        times: (n,) [s] since the first sample of the recording.
        phase: (n,) mesh phase [rad].
        force: (n, n_mesh) [N], expectation of the law over the states.
        half: (n, n_mesh) half-width of the 90 % band [N].
        contact: (n, n_mesh) probability that the teeth touch.
    """

    run: str
    role: str
    effects: tuple[str, ...]
    meshes: tuple[str, ...]
    planets_alike: bool
    times: Array
    phase: Array
    force: Array
    half: Array
    contact: Array


def reconstructed_forces(
    machine: GearMachine, run: PreparedRun, fit: FittedExplanation, noise: float = 1.0
) -> ReconstructedForces:
    """Reconstruct the forces of all meshes of a run under an explanation.

    Args:
        machine: whose gear uses windows.
        run: of the same rig, with the same channels.
        fit: explanation fitted to the fit runs.
        noise: actual over assumed noise of the channels; that of the residual of the run is used
            if it is larger.
    """
    there, hypotheses = machine.for_runs([run]).transferred(fit.hypotheses)
    every = (*there.base, *(c for h in hypotheses for c in h.coefficients))
    made = amplitudes(every, fit.score.mean, there.runs, there.rows)
    gear, own = there.gear, there.gear.trajectory_under(0, made)
    with own.to_the_end():
        block = there.blocks(made, functions_used(every), (trajectory.NAME,))[0][trajectory.NAME]
    s, m = own.windows, own.last_linearisation[2]
    weights, root = _weights(every, block.functions), _root(fit.score.covariance_with_jackknife())
    left = float(np.sum(block.residual**2)) / (block.independent_share * len(block.residual))
    errors = _state_errors(own, gear, block, weights @ root, max(noise, left**0.5))

    each, of_u, of_v = s.steps_per_sample, slice(0, STATES // 2), slice(STATES // 2, STATES)
    whole = errors.by_noise + errors.by_coefficients @ errors.by_coefficients.transpose(0, 2, 1)
    var_x = np.maximum(np.einsum("ja,nab,jb->nj", s.G, whole[:, of_u, of_u], s.G), 0.0)
    of_law = {f: a[0] for f, a in made.get(force_law.NAME, {}).items()}
    change = gear.change_of(m, of_law, [f.name for f in gear.law_functions])
    m = replace(
        m,
        x=m.x + _at_steps(errors.shift[:, of_u] @ s.G.T, each),
        v=m.v + _at_steps(errors.shift[:, of_v] @ s.G.T, each),
        sigma_x=_at_steps(np.sqrt(var_x), each),
    )
    now, at = law(m, change), slice(0, -1, each)
    touch = now.contact_drive + now.contact_back
    stiff, damping = (now.k * touch)[at], now.c[at]
    slope = np.concatenate([stiff[:, :, None] * s.G, damping[:, :, None] * s.G], axis=2)
    direct = _direct(gear.law_functions, m, now, block.functions)[at] @ (weights @ root)
    # The variance of the force of a gap that may be closed, beyond its linear part, see ``law``.
    variance = np.maximum(now.sigma[at] ** 2 - stiff**2 * var_x, 0.0)
    variance += np.einsum("nja,nab,njb->nj", slope, errors.by_noise, slope)
    variance += np.sum((slope @ errors.by_coefficients + direct) ** 2, axis=2)
    first = own.lead_windows * s.samples_per_window
    return ReconstructedForces(
        run.name,
        run.role,
        tuple(h.effect for h in fit.hypotheses),
        run.model.layout.meshes,
        planets_indistinguishable([fused_run(run, gear.runs[0].fused)]),
        run.times[first : first + len(whole)],
        m.phase[at] + run.delay_rad,
        now.force[at],
        HALF_90 * np.sqrt(variance),
        touch[at],
    )


def forces_of_run(
    machine: GearMachine,
    runs: Sequence[PreparedRun],
    fit: FittedExplanation,
    noise: Array | float,
) -> ReconstructedForces | None:
    """Mesh forces in one run: the first suitable held-out run, else the first suitable other one.

    A run is suitable if windows are fitted to it, of the same channels as in the fit runs.

    Args:
        machine: of any runs of the rig; windows that it has fitted are reused.
        runs: to choose from.
        fit: explanation fitted to the fit runs.
        noise: (fit runs, 1) or one number, actual over assumed noise of the channels; the RMS is
            used.

    Returns:
        Forces with their 90 % band; None if no run is suitable.
    """
    size = float(np.sqrt(np.mean(np.square(noise))))
    for run in sorted(runs, key=lambda run: run.role != "held_out"):
        gear = machine.for_runs([run]).gear
        names = gear.followed_channels if gear.has_windows_of(0) else ()
        if names and window_channels(run).names == names:
            return reconstructed_forces(machine, run, fit, size)
    return None


class StateErrors(NamedTuple):
    """Errors of the states (n, 18) at samples [m], [m/s].

    Attributes:
        by_noise: (n, 18, 18) covariance by the noise of the channels.
        by_coefficients: (n, 18, q) by a unit of each independent error of the coefficients.
        shift: (n, 18) correction of the states for the estimated drift, gratings and trends.
    """

    by_noise: Array
    by_coefficients: Array
    shift: Array


def _state_errors(
    own: Trajectory, gear: GearObservations, block: Block, coefficients: Array, noise: float
) -> StateErrors:
    """Errors of the fitted states, with those of the sensors estimated together.

    Args:
        block: of the windows.
        coefficients: (Q, q) amplitudes of its functions by independent errors of the coefficients.
        noise: actual over assumed noise of the channels.
    """
    s, (solution, now, m) = own.windows, own.last_linearisation
    W, n = s.n_windows, s.n_windows * STATES
    waves, sizes = nuisance_columns(s)
    by_states = window_jacobian(s, solution).times(np.eye(n).reshape(W, STATES, n))
    J = np.hstack([by_states, waves])
    prior = np.append(np.full(n, STATE_PRECISION), sizes**-2.0)
    prior[:STATES] = FIRST_SD**-2.0
    normal = J.T @ J + np.diag(prior)
    inverse = np.linalg.inv(normal)
    read = noise * J[: s.measured.size]
    covariance = inverse @ (read.T @ read + np.diag(prior)) @ inverse
    step = inverse @ (J.T @ stacked_residual(solution))
    by_sensors = -np.linalg.solve(normal[:n, :n], normal[:n, n:] @ step[n:])
    functions = (*gear.law_functions, *gear.body_functions)
    responses = window_columns(s, solution, m, now, functions, block.functions)
    moved = -(inverse @ (J.T @ (responses @ coefficients)))[:n]
    each = np.arange(W)
    own_blocks = covariance[:n, :n].reshape(W, STATES, W, STATES)[each, :, each]
    T = propagators(s, solution.integrator, solution.starts)[:, :-1]
    pushed = _responses_of_states(s, solution, (m, now), functions, block.functions)
    return StateErrors(
        (T @ own_blocks[:, None] @ T.transpose(0, 1, 3, 2)).reshape(-1, STATES, STATES),
        (pushed @ coefficients + T @ moved.reshape(W, 1, STATES, -1)).reshape(
            W * s.samples_per_window, STATES, -1
        ),
        (T @ by_sensors.reshape(W, 1, STATES, 1)).reshape(-1, STATES),
    )


def _weights(coefficients: Sequence[Coefficient], functions: Sequence[str]) -> Array:
    """Amplitudes (Q, p) of the functions of the windows by a unit of each coefficient."""
    place = {name: i for i, name in enumerate(functions)}
    weights = np.zeros((len(functions), len(coefficients)))
    for i, c in enumerate(coefficients):
        if trajectory.NAME in c.placements:
            for _, name, w in c.placements[trajectory.NAME].entries:
                weights[place[name], i] += w[0]
    return weights


def _responses_of_states(
    s: Windows,
    solution: WindowSolution,
    at: tuple[MeshMotion, Law],
    functions: Sequence[Function],
    names: Sequence[str],
) -> Array:
    """Response (W, samples, 18, Q) of the states to functions, from given start states.

    Computed as the response of windows whose channels are the states.

    Args:
        at: motion of the meshes at every step, and the force law there.
        names: of the Q columns.
    """
    shape = (s.n_windows, s.samples_per_window, STATES)
    nothing = np.zeros((STATES, STATES // 2))
    states = WindowChannels(
        tuple(f"state {i}" for i in range(STATES)),
        nothing,
        np.zeros((STATES, len(s.G))),
        nothing,
        np.zeros((0, STATES)),
        np.ones(STATES),
    )
    seen = replace(s, channels=states, measured=np.zeros(shape), weight=np.ones(shape))
    unit = np.broadcast_to(np.eye(STATES), (*shape, STATES))
    shot = replace(solution, slope=unit, residuals=np.zeros(shape))
    responses = window_columns(seen, shot, *at, functions, names)
    return responses[: shot.residuals.size].reshape(*shape, -1)


def _direct(functions: Sequence[Function], m: MeshMotion, now: Law, names: Sequence[str]) -> Array:
    """Change (n, n_mesh, Q) of the mesh forces by unit amplitudes of functions, states fixed."""
    place = {name: i for i, name in enumerate(names)}
    changes = np.zeros((*m.x.shape, len(names)))
    for f in functions:
        at = [j for j in range(m.x.shape[1]) if f"{f.name} of {j}" in place]
        if at:
            g = np.nan_to_num(force_column(f, m, now))
            for j in at:
                changes[:, j, place[f"{f.name} of {j}"]] = g[:, j]
    return changes


def _at_steps(values: Array, each: int) -> Array:
    """Repeat values (n, k) of samples for their ``each`` steps, and the last: (n each + 1, k)."""
    return np.vstack([np.repeat(values, each, axis=0), values[-1:]])


def _root(covariance: Array) -> Array:
    """Root R of a covariance RR', which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
