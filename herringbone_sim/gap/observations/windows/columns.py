"""Columns of the trajectory observation: linear response of windows to functions.

A force acts through the motion; gauges and accelerometers also measure it directly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model
from herringbone_sim.gap.data.kinematics import cycles_per_shaft_turn
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations import torque_balance
from herringbone_sim.gap.observations.basis import Function, force_column
from herringbone_sim.gap.observations.body_motion import body_loads, control_force
from herringbone_sim.gap.observations.consistency import ERROR_KINDS
from herringbone_sim.gap.observations.force_law import (
    ENCODER_ERROR_RAD,
    drift_spread,
    slow_waves,
)
from herringbone_sim.gap.observations.friction import (
    FRICTION,
    friction_directions,
    friction_of_mesh,
    friction_shapes,
)
from herringbone_sim.gap.observations.windows.integrator import STATES
from herringbone_sim.gap.observations.windows.sensor_errors import (
    SWAP_PREFIX,
    error_columns,
    exchangeable,
)
from herringbone_sim.gap.observations.windows.shooting import WindowSolution
from herringbone_sim.gap.observations.windows.windows import STEP_RAD, Windows
from herringbone_sim.gap.residuals.mesh_law import Law, MeshMotion
from herringbone_sim.gap.sensors.noise import DRIFT_SHARE


def function_names(
    model: Model, laws: Sequence[Function], channels: Sequence[str]
) -> tuple[str, ...]:
    """Names of all columns: masses, control, channels, swaps, friction, ripple, law, carrier.

    Args:
        laws: functions of the force law, and those on the carrier.
        channels: names of the channels to which windows are fitted.
    """
    meshes = range(model.layout.n_mesh)
    names = [*torque_balance.MASSES, *torque_balance.CONTROL]
    names += [f"{e} of {c}" for c in channels for e in ERROR_KINDS]
    names += [f"{SWAP_PREFIX}{' and '.join(pair)}" for pair in exchangeable(channels)]
    names += [f"friction {g} of {j}" for j in meshes for g in FRICTION]
    names += [f"ripple {q} {trig}" for q in torque_balance.RIPPLES for trig in ("cos", "sin")]
    of_meshes = [f for f in laws if f.slot != "body"]
    names += [f"{f.name} of {j}" for j in meshes for f in of_meshes if f.acts_on(j)]
    return (*names, *(f.name for f in laws if f.slot == "body"))


@dataclass(frozen=True)
class BodyForce:
    """Force on the bodies by a function: ``direction`` (9,) times ``size`` (n,) [N]."""

    name: str
    direction: Array
    size: Array


def body_forces(
    run: PreparedRun,
    m: MeshMotion,
    now: Callable[[], Law],
    names: Iterable[str],
    on_carrier: Sequence[Function] = (),
) -> Iterator[BodyForce]:
    """Yield the forces on bodies by a unit amplitude of each named function, in this order.

    Args:
        run: whose gear and control they are.
        m: motion of the meshes.
        now: gives the force law there, where a function depends on it.
        names: ``friction SHAPE of MESH``: by a coefficient of friction of 1; ``ripple ORDER cos``
            or ``sin``: by 1 N m of input torque; ``CONTROL``: the nominal control; names of
            ``on_carrier``. Others are skipped.
        on_carrier: functions that are forces [N] on the carrier.
    """
    model = run.model
    of_carrier = {f.name: f for f in on_carrier}
    arms: dict[str, Array] = {}
    shapes: dict[str, Array] = {}
    turn = cycles_per_shaft_turn(model)["s"]
    drive = np.zeros(STATES // 2)
    drive[:2] = 0.5 / model.scales.r_bs
    carrier = np.eye(STATES // 2)[2]
    for name in names:
        kind, *words = name.split(" ")
        if kind == "friction":
            j, g = int(words[-1]), " ".join(words[:-2])
            if not arms:
                arms = friction_directions(model, np.ones(m.x.shape[1]))
                step_rad = STEP_RAD * m.omega / model.scales.omega_n
                shapes = friction_shapes(m.phase, step_rad)
            there = now()
            spring = there.k[:, j] * there.f[:, j]
            size = friction_of_mesh(g, shapes, there.force[:, j], spring)
            yield BodyForce(name, arms.get(g, arms["sign"])[j], size)
        elif kind == "ripple":
            trig = np.cos if words[1] == "cos" else np.sin
            yield BodyForce(name, drive, trig(int(words[0]) * m.phase / turn))
        elif name in torque_balance.CONTROL:
            late_rad = 0.5 * np.pi * torque_balance.CONTROL.index(name)
            yield BodyForce(name, carrier, control_force(model, m.phase, late_rad))
        elif name in of_carrier:
            yield BodyForce(name, carrier, of_carrier[name].values(m, now()))


def window_columns(
    s: Windows,
    solution: WindowSolution,
    m: MeshMotion,
    now: Law,
    functions: Sequence[Function],
    names: Sequence[str],
) -> Array:
    """Response (rows, Q) of channels and jumps to unit amplitudes of functions, over the noise.

    Args:
        solution: states about which the motion is linearised.
        m, now: motion of the meshes at every step, and the force law there.
        functions: of the force law, wanted as ``FUNCTION of MESH``, and those on the carrier.
        names: of the Q columns, see ``function_names``.
    """
    inverse = s.inverse_masses
    directions: list[Array] = []
    on_meshes: list[Array] = []
    sizes: list[Array] = []
    at: list[int] = []
    nowhere, each_mesh = np.zeros(len(s.G)), np.eye(len(s.G))

    def add(i: int, direction: Array, size: Array, on: Array = nowhere) -> None:
        directions.append(direction)
        on_meshes.append(on)
        sizes.append(size)
        at.append(i)

    place = {name: i for i, name in enumerate(names)}
    on_carrier = [f for f in functions if f.slot == "body"]
    for push in body_forces(s.run, m, lambda: now, names, on_carrier):
        add(place[push.name], inverse * push.direction, push.size)
    for f in functions:
        meshes = [j for j in range(m.x.shape[1]) if f"{f.name} of {j}" in place]
        if meshes:
            g = np.nan_to_num(force_column(f, m, now))
            for j in meshes:
                i = place[f"{f.name} of {j}"]
                add(i, -inverse * s.G[j], g[:, j], each_mesh[j])
    total = body_loads(s.run.model, s.phase - s.run.delay_rad)[::2] - now.force @ s.G
    for mass, bodies in (("M_s", (0, 1)), ("M_c", (2,)), ("M_p", range(3, len(inverse)))):
        if mass in place:
            for b in bodies:
                add(place[mass], np.eye(len(inverse))[b] * inverse[b], total[:, b])
    Q = len(names)
    rows = solution.residuals.size + solution.jumps.size
    columns = np.zeros((rows, Q))
    if at:
        steps = s.first_half_step[:, None] // 2 + np.arange(s.steps_per_window + 1)
        size = np.stack(sizes, axis=1)[steps]
        response = responses(s, solution, np.stack(directions), size, np.stack(on_meshes))
        own, first = np.unique(at, return_index=True)
        columns[:, own] = response[:, first]
        for p in sorted(set(range(len(at))) - set(first.tolist())):  # further bodies of a mass
            columns[:, at[p]] += response[:, p]
    c, u = s.channels, solution.states_of_all[:, : STATES // 2]
    exact = u @ c.of_u.T + now.force @ c.of_F.T + (total * inverse) @ c.of_a.T
    for name, value in error_columns(s, solution, exact, place).items():
        columns[: solution.residuals.size, place[name]] = value
    return columns


def responses(
    s: Windows, solution: WindowSolution, direction: Array, size: Array, on_meshes: Array
) -> Array:
    """Linear response (rows, P) of channels and jumps to P forces, over the noise.

    Args:
        solution: states about which the motion is linearised.
        direction: (P, 9) accelerations of the bodies per unit of ``size``.
        size: (W, steps + 1, P) force [N] at every step.
        on_meshes: (P, n_mesh) 1 on the mesh whose force it is, as gauges measure it; else 0.
    """
    each, P = s.steps_per_sample, len(direction)
    at_once = s.channels.of_a @ direction.T + s.channels.of_F @ on_meshes.T
    data = at_once * size[:, :-1:each, None, :] * s.weight[..., None]
    end = np.empty((s.n_windows, STATES, P))
    way = np.ascontiguousarray(0.5 * s.h * direction.T)
    slope = np.ascontiguousarray(solution.slope)
    pushed = np.ascontiguousarray(size)
    _respond(solution.step_tangents, way, pushed, slope, each, data, end)
    ties = end[:-1] / (s.scale[:, None] * s.jump_sd)
    return np.vstack([data.reshape(-1, P), ties.reshape(-1, P)])


@njit(cache=True, nogil=True)
def _respond(tangents, way, pushed, slope, each, data, end):  # type: ignore[no-untyped-def]
    """Add responses to ``data`` (W, samples, C, P), write those of the last state to ``end``.

    Args:
        tangents: (W, steps, n, n) of single steps.
        way: (n / 2, P) change of the rates by half a step of unit forces.
        pushed: (W, steps + 1, P) size of the forces.
        slope: (W, samples, C, n) derivatives of channels by states.
        each: steps per sample.
    """
    n, P = tangents.shape[2], way.shape[1]
    half = n // 2
    for w in range(tangents.shape[0]):
        now = np.zeros((n, P))
        for q in range(tangents.shape[1]):
            for b in range(half):
                for p in range(P):
                    now[half + b, p] += way[b, p] * pushed[w, q, p]
            now = np.dot(tangents[w, q], now)
            for b in range(half):
                for p in range(P):
                    now[half + b, p] += way[b, p] * pushed[w, q + 1, p]
            i = (q + 1) // each
            if (q + 1) % each == 0 and i < data.shape[1]:
                data[w, i] += np.dot(slope[w, i], now)
        end[w] = now


def nuisance_columns(s: Windows) -> tuple[Array, Array]:
    """Columns of encoder eccentricities, of drift and of trends, and their prior deviations.

    Returns:
        Columns (rows, m), over the noise: for each channel, in its rows alone, a constant,
        ``slow_waves`` and, of an encoder, cos and sin of the shaft angle; then
        ``Windows.trend_rows``. Prior standard deviations (m,) of their amplitudes, in the unit of
        the channel.
    """
    model = s.run.model
    W, samples, k = s.weight.shape
    phase = s.phase[:: 2 * s.steps_per_sample][: W * samples]
    waves = slow_waves(s.run.times[: W * samples])
    slow = np.column_stack([np.ones(W * samples), waves])
    # Drift slower than the windows is a constant in them, at most of its whole RMS.
    spread = np.append(DRIFT_SHARE, np.full(waves.shape[1], drift_spread(waves.shape[1])))
    by_channel: list[Array] = []
    sizes: list[float] = []
    for i, name in enumerate(s.channels.names):
        own = [slow]
        sizes += (spread * s.channels.sigma[i]).tolist()
        if name[0] == "u":
            turn = phase / cycles_per_shaft_turn(model)[name[2]]
            own.append(np.column_stack([np.cos(turn), np.sin(turn)]))
            sizes += [ENCODER_ERROR_RAD * model.scales.base_radius(name[2:])] * 2
        by_channel.append(np.hstack(own) * s.weight[:, :, i].reshape(-1, 1))
    trends = s.trend_rows()
    every = np.zeros((len(trends), len(sizes) + trends.shape[1]))
    every[:, len(sizes) :] = trends
    of_channels, at = every[: s.weight.size].reshape(W * samples, k, -1), 0
    for i, columns in enumerate(by_channel):
        of_channels[:, i, at : at + columns.shape[1]] = columns
        at += columns.shape[1]
    return every, np.append(sizes, s.trends.size)
