"""Trajectories of few channels as an observation: what windows of the motion leave of rotations.

Where neither a force law nor a balance can be formed, the states of short windows are estimated
from the rotations of some bodies (``shooting``); what is left of the measured rotations, and the
jumps from window to window, is the residual. A function of the force law acts through the motion:
its column is the linear response of the windows to the force that it adds to a mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model, mean_stiffness
from herringbone_sim.diagnosis.flexible import Surroundings
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.effects.catalogue.tooth_friction import friction_arms
from herringbone_sim.gap.data.parts import part_of
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.data.waves import waves
from herringbone_sim.gap.observations import balance
from herringbone_sim.gap.observations.basis import Function, column
from herringbone_sim.gap.observations.force_law import GRATING_RAD, shafts
from herringbone_sim.gap.observations.law import Change, Law, Motion, law, waves_of
from herringbone_sim.gap.observations.rollout import STATES, Drive
from herringbone_sim.gap.observations.shooting import (
    JUMP,
    WINDOWS,
    Shot,
    Stretch,
    fitted,
    jacobian,
    loads,
    residual,
    samples_of,
    stretch,
    with_swing,
)
from herringbone_sim.gap.observations.window_starts import carried, started
from herringbone_sim.gap.residuals.balance import between

Array = NDArray[np.float64]

NAME = "trajectory"
FIRST, LATER = 8, 2  # rounds of a fit under a change: new, and near one that was tried before
# Shapes of forces that a cause of any kind may be made of, at the meshes.
ANY = {"kappa", "gamma", "gamma out", "b_plus", "b_minus", *(f"kappa load {i}" for i in range(6))}
ANY |= {f"{q} {i} {trig}" for q in "ke" for i in (1, 2, 3) for trig in ("cos", "sin")}
ANY |= {f"{q} 1 {trig}" for q in ("sun", "planet", "ring") for trig in ("cos", "sin")}
LEAD = 12  # windows; in nine the filter found the motion of all planets from any start tried
GOOD = 1.5  # squares a value: states that leave no more need no other start
LOOSE = 1e3  # prior of a state, in units of the motion: none


def trajectory(run: PreparedRun) -> Trajectory:
    """The windows of a run, with or without the swing of the whole gear, whichever fits better."""
    found = [Trajectory(run)]
    if run.model.packed.K != 0.0 and run.u.there.any():
        found.append(Trajectory(with_swing(run)))
    if len(found) == 1:
        return found[0]
    return min(found, key=lambda one: one.solved((), lambda m: Change(), {}).cost)


def function_names(
    model: Model, law_names: Sequence[str], gauges: Sequence[str]
) -> tuple[str, ...]:
    """Columns: masses, gauges' gains, friction by mesh, ripple, every law on every mesh."""
    meshes = range(model.layout.n_mesh)
    names = [*balance.MASSES, *(f"gain of {g}" for g in gauges)]
    names += [f"friction {g} of {j}" for j in meshes for g in balance.FRICTION]
    names += [f"ripple {q} {trig}" for q in balance.RIPPLES for trig in ("cos", "sin")]
    names += [f"{f} of {j}" for j in meshes for f in law_names]
    return tuple(names)


@dataclass(frozen=True)
class Push:
    """A force on bodies: ``direction`` (9,) times ``size`` (n,) [N]."""

    name: str
    direction: Array
    size: Array


class Trajectory:
    """The windows of a run, their states under any change of the law.

    Args:
        run: with rotations or accelerations of suns and carrier.
        lead: windows that are left out at the start, for the filter alone.
    """

    def __init__(self, run: PreparedRun, lead: int = LEAD, windows: int = WINDOWS) -> None:
        samples = samples_of(run)
        self.run, self.lead = run, max(0, min(lead, (len(run) - 1) // samples - windows))
        part = part_of(run, slice(self.lead * samples, None), run.name)
        self.recorded: Stretch = stretch(part, windows)
        self.stretch = self.recorded  # with gauges put right by the gains last tried
        self.model = run.model
        self._found: dict[tuple[str, ...], Shot] = {}
        self._share: float | None = None

    @cached_property
    def _nominal(self) -> tuple[Array, Array, Array]:
        """k, e and its rate at every half step."""
        s = self.stretch
        w = waves(s.run.model, s.phase - s.run.late_rad, s.run.omega_rad_per_s)
        return w.k, w.e, w.e_rate

    def drive(self, change: Change, masses: Array, pushes: Sequence[tuple[Push, float]]) -> Drive:
        """What drives the motion under a change (at every half step)."""
        s = self.stretch
        k, e, rate = self._nominal
        m = self.model
        one = np.ones_like(k)
        tau = loads(s)
        for push, a in pushes:
            tau = tau + a * push.size[:, None] * push.direction
        return Drive(
            s.G,
            s.inverse * masses,
            tau,
            k * (1.0 + change.kappa) + mean_stiffness(m.parameters) * change.mean_kappa,
            m.damping_n_s_per_m * (1.0 + change.gamma) * one,
            change.d - e,
            change.d_rate - rate,
            np.maximum(m.half_backlash_m + change.b_plus, 0.0) * one,
            np.maximum(m.half_backlash_m + change.b_minus, 0.0) * one,
            change.more * one,
        )

    def motion(self, states: Array, phase: Array) -> Motion:
        """Meshes of some states (n, 18) at phases (n,), as the force law needs them."""
        s, m = self.stretch, self.model
        w = waves(m, phase - s.run.late_rad, s.run.omega_rad_per_s)
        half = STATES // 2
        n, meshes = len(states), m.layout.n_mesh
        nothing = np.zeros(meshes)
        return Motion(
            s.run.name,
            phase,
            (phase - s.run.phase[0]) / s.run.omega_rad_per_s,
            s.run.omega_rad_per_s,
            dict(s.run.point),
            states[:, :half] @ s.G.T - w.e,
            states[:, half:] @ s.G.T - w.e_rate,
            np.full((n, meshes), np.nan),
            nothing,
            nothing,
            nothing,
            w.k,
            w.e,
            w.e_rate,
            waves_of(m, s.run.omega_rad_per_s, s.run.late_rad),
            mean_stiffness(m.parameters),
            m.damping_n_s_per_m,
            m.half_backlash_m,
        )

    def _half_steps(self, shot: Shot) -> Motion:
        """The motion at every half step, windows one after the other."""
        half, steps = STATES // 2, _in_line(shot)
        u, rate = between(steps[:, :half], steps[:, half:], self.stretch.h, 2)
        return self.motion(np.hstack([u, rate]), self.stretch.phase)

    def solved(
        self,
        key: tuple[str, ...],
        change_of: Callable[[Motion], Change],
        of_bodies: Mapping[str, float],
    ) -> Shot:
        """States under a change.

        Args:
            key: names of what is changed; the states are kept by it.
            change_of: what a motion makes of the law.
            of_bodies: amplitudes of masses, friction and ripple.
        """
        self.stretch = self._with_gains(of_bodies)
        masses = self._masses(of_bodies)
        if () not in self._found:
            whole = Trajectory(self.run, 0, self.lead + self.recorded.windows)
            nominal, of_whole = (
                one.drive(Change(), np.ones_like(masses), ()) for one in (self, whole)
            )
            self._found[()] = started(self.stretch, nominal, whole.stretch, of_whole)
        shot = self._found.get(key)
        if shot is None:
            shot = self._begun(self._found[()], change_of, of_bodies, masses)
        shot = self._again(shot, change_of, of_bodies, masses, LATER)
        self._found[key] = shot
        return shot

    def _with_gains(self, of_bodies: Mapping[str, float]) -> Stretch:
        """What was recorded, gauges without their gains."""
        s = self.recorded
        gain = np.array([1.0 + of_bodies.get(f"gain of {name}", 0.0) for name in s.channels.names])
        return replace(s, measured=s.measured / gain, weight=s.weight * gain)

    def _begun(
        self,
        nominal: Shot,
        change_of: Callable[[Motion], Change],
        of_bodies: Mapping[str, float],
        masses: Array,
    ) -> Shot:
        """States under a change that was not tried before: from those of the nominal gear, and
        from its first ones carried through all windows; the better."""
        s = self.stretch
        near = self._again(nominal, change_of, of_bodies, masses, FIRST)
        if near.cost < GOOD * np.count_nonzero(s.weight):
            return near
        drive = self._drive_at(near, change_of, of_bodies, masses)
        starts, _ = carried(s, drive, nominal.starts[:1])
        far = fitted(s, starts[0], drive, FIRST)
        return min(near, far, key=lambda shot: shot.cost)

    def _again(
        self,
        shot: Shot,
        change_of: Callable[[Motion], Change],
        of_bodies: Mapping[str, float],
        masses: Array,
        rounds: int,
    ) -> Shot:
        drive = self._drive_at(shot, change_of, of_bodies, masses)
        return fitted(self.stretch, shot.starts, drive, rounds)

    def _drive_at(
        self,
        shot: Shot,
        change_of: Callable[[Motion], Change],
        of_bodies: Mapping[str, float],
        masses: Array,
    ) -> Drive:
        """What drives the motion under a change that follows from the motion."""
        m = self._half_steps(shot)
        change = change_of(m)
        pushes = [(p, of_bodies[p.name]) for p in self._pushes(m, law(m, change), of_bodies)]
        return self.drive(change, masses, pushes)

    def _masses(self, of_bodies: Mapping[str, float]) -> Array:
        """(9,) factors on 1/M."""
        s, c, p = (1.0 + of_bodies.get(f"M_{body}", 0.0) for body in "scp")
        return np.array([s, s, c, *[p] * (STATES // 2 - 3)])

    def _pushes(
        self, m: Motion, now: Law, wanted: Mapping[str, object] | set[str]
    ) -> Iterator[Push]:
        """Forces on bodies of the functions wanted, at unit amplitude."""
        model = self.model
        arms: dict[str, Array] = {}
        shapes = balance.friction_shapes(m.phase)
        p = model.parameters
        turn = p.z_s * p.z_r / (p.z_s + p.z_r)
        drive = np.zeros(STATES // 2)
        drive[:2] = 0.5 / model.scales.r_bs
        for name in wanted:
            kind, *rest = name.split(" ")
            if kind == "friction":
                j, g = int(rest[-1]), " ".join(rest[:-2])
                if not arms:
                    arms["sign"], arms["lever"] = friction_arms(model, np.ones(m.x.shape[1]))
                of = arms["lever" if g == "lever" else "sign"]
                yield Push(name, of[j], np.abs(now.force[:, j]) * shapes[g])
            elif kind == "ripple":
                trig = np.cos if rest[1] == "cos" else np.sin
                yield Push(name, drive, trig(int(rest[0]) * m.phase / turn))

    def block(
        self,
        shot: Shot,
        change_of: Callable[[Motion], Change],
        functions: Sequence[Function],
        wanted: Sequence[str],
    ) -> Block:
        """Residual of the windows at some states, with columns of the functions wanted."""
        s = self.stretch
        m = self.motion(_in_line(shot), s.phase[::2])
        now = law(m, change_of(m))
        self._last = shot, now, m
        columns = self._columns(shot, m, now, functions, wanted)
        gratings, sizes = self._gratings()
        J = np.hstack([jacobian(s, shot), gratings])
        left = residual(shot)
        unknown = s.windows * STATES
        share = self._independent(J[:, :unknown])
        return Block(
            NAME,
            s.run.name,
            ("windows",),
            left[:, None],
            np.full((len(left), 1), np.sqrt(share)),
            tuple(wanted),
            columns[:, None, :],
            J[:, None, :],
            np.append(np.full(unknown, LOOSE), sizes)[None],
            np.zeros((0, 1, len(wanted))),
            np.zeros(0),
            independent=share,
        )

    def _independent(self, J: Array) -> float:
        """Share of the rows that noise is expected to leave squares in, one each.

        Ties have no noise of their own, they only hold the states; states take up what is left of
        a row in proportion to its leverage.
        """
        if self._share is None:
            read = np.flatnonzero(self.stretch.weight.ravel() > 0.0)
            normal = J.T @ J + np.eye(J.shape[1]) / LOOSE**2
            leverage = np.sum(J[read] * np.linalg.solve(normal, J[read].T).T)
            self._share = max(len(read) - float(leverage), 1.0) / len(J)
        return self._share

    def _gratings(self) -> tuple[Array, Array]:
        """Waves (rows, 2 k) once a turn of the body of each encoder, over its noise, and the size
        (2 k,) [m] that gratings off centre may give them."""
        s, sc = self.stretch, self.model.scales
        radius = {"s": sc.r_bs, "c": sc.r_bc, "p": sc.r_bp}
        W, samples, k = s.weight.shape
        phase = s.phase[:: 2 * s.each][: W * samples].reshape(W, samples)
        found, sizes = [], []
        for i, name in enumerate(s.channels.names):
            if name[0] == "u":
                for trig in (np.cos, np.sin):
                    wave = np.zeros((W, samples, k))
                    wave[:, :, i] = s.weight[:, :, i] * trig(phase / shafts(self.model)[name[2]])
                    found.append(np.pad(wave.ravel(), (0, (W - 1) * STATES)))
                    sizes.append(GRATING_RAD * radius[name[2]])
        if not found:
            return np.zeros((W * samples * k + (W - 1) * STATES, 0)), np.zeros(0)
        return np.stack(found, axis=1), np.array(sizes)

    def _columns(
        self, shot: Shot, m: Motion, now: Law, functions: Sequence[Function], wanted: Sequence[str]
    ) -> Array:
        """(rows, Q) responses, over noise and jump."""
        s = self.stretch
        inverse = s.inverse
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

        place = {name: i for i, name in enumerate(wanted)}
        for push in self._pushes(m, now, set(wanted)):
            add(place[push.name], inverse * push.direction, push.size)
        for f in functions:
            of = [j for j in range(m.x.shape[1]) if f"{f.name} of {j}" in place]
            if of:
                g = np.nan_to_num(column(f, m, now))
                for j in of:
                    i = place[f"{f.name} of {j}"]
                    add(i, -inverse * s.G[j], g[:, j], each_mesh[j])
        total = self._forces(m, now)
        for mass, bodies in (("M_s", (0, 1)), ("M_c", (2,)), ("M_p", range(3, len(inverse)))):
            if mass in place:
                for b in bodies:
                    add(place[mass], np.eye(len(inverse))[b] * inverse[b], total[:, b])
        Q = len(wanted)
        rows = shot.off.size + shot.jumps.size
        found = np.zeros((rows, Q))
        if at:
            size = np.stack(sizes)[:, s.first[:, None] // 2 + np.arange(s.steps + 1)]
            response = self._responses(shot, np.stack(directions), size, np.stack(on_meshes))
            np.add.at(found.T, np.array(at), response.T)
        for name in s.channels.gauges:
            if f"gain of {name}" in place:
                found[:, place[f"gain of {name}"]] = self._read(now, s.channels.names.index(name))
        return found

    def _read(self, now: Law, channel: int) -> Array:
        """(rows,) what a gauge shows, over its noise: a share of it is what a wrong gain adds."""
        s = self.stretch
        alone = np.zeros_like(s.weight)
        force = now.force[:: s.each][: s.windows * s.samples] @ s.channels.of_F[channel]
        alone[:, :, channel] = force.reshape(s.windows, s.samples) * s.weight[:, :, channel]
        return np.concatenate([alone.ravel(), np.zeros((s.windows - 1) * STATES)])

    def _forces(self, m: Motion, now: Law) -> Array:
        """(n, 9) forces on the bodies [N]."""
        s = self.stretch
        return np.asarray(loads(s)[::2] - now.force @ s.G)

    def _responses(self, shot: Shot, direction: Array, size: Array, on_meshes: Array) -> Array:
        """(rows, P) response to ``direction`` (P, 9) times ``size`` (P, W, steps + 1).

        Args:
            on_meshes: (P, n_mesh) 1 where it is a mesh force, which gauges see at once.
        """
        s = self.stretch
        each, half = s.each, STATES // 2
        col = np.zeros((s.windows, STATES, len(direction)))
        samples = size[:, :, :-1:each].transpose(1, 2, 0)[:, :, None, :]
        at_once = s.channels.of_a @ direction.T + s.channels.of_F @ on_meshes.T
        data = at_once * samples * s.weight[..., None]
        way = 0.5 * s.h * direction.T
        pushed = size.transpose(2, 1, 0)[:, :, None, :]
        for q in range(s.steps):
            col[:, half:] += way * pushed[q]
            col = shot.tangents[:, q] @ col
            col[:, half:] += way * pushed[q + 1]
            if (q + 1) % each == 0 and (q + 1) // each < s.samples:
                i = (q + 1) // each
                data[:, i] += shot.slope[:, i] @ col
        ties = col[:-1] / (s.scale[:, None] * JUMP)
        P = len(direction)
        return np.vstack([data.reshape(-1, P), ties.reshape(-1, P)])

    def surroundings(self, block: Block, functions: Sequence[Function]) -> Surroundings:
        """What forces of many shapes would add to the rows of the block made last."""
        s = self.stretch
        shot, now, m = self._last
        some = [f for f in functions if f.name in ANY]
        wanted = [f"{f.name} of {j}" for f in some for j in range(len(s.G))]
        made = self._columns(shot, m, now, some, wanted) / block.sigma
        J = block.nuisance[:, 0] / block.sigma
        prior = np.diag(block.nuisance_sd[0] ** -2.0)
        left = made - J @ np.linalg.solve(J.T @ J + prior, J.T @ made)
        nothing = np.zeros((len(left), 1, 1))
        return Surroundings(nothing, nothing[:, 0], nothing, left[:, None, :])

    def cycles(self) -> Array:
        """(rows,) mesh cycles since the start; jumps at that of their window."""
        s = self.stretch
        W, samples, k = s.measured.shape
        phase = (s.phase - s.phase[0]) / (2.0 * np.pi)
        data = np.repeat(phase[:: 2 * s.each][: W * samples], k)
        return np.concatenate([data, np.repeat(phase[s.first[1:]], STATES)])


def _in_line(shot: Shot) -> Array:
    """States (n, 18) at every step, of the window that begins where two meet."""
    return np.vstack([shot.states[:, :-1].reshape(-1, STATES), shot.states[-1, -1:]])
