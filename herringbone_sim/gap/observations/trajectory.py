"""Trajectories of few channels as an observation: what windows of the motion leave of rotations.

Where neither a force law nor a balance can be formed, the states of short windows are estimated
from the rotations of some bodies (``shooting``); what is left of the measured rotations, and the
jumps from window to window, is the residual. A function of the force law acts through the motion:
its column is the linear response of the windows to the force that it adds to a mesh.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model, mean_stiffness
from herringbone_sim.diagnosis.flexible import Surroundings
from herringbone_sim.diagnosis.products import Block, clearing
from herringbone_sim.diagnosis.search import LIKELIER
from herringbone_sim.gap.data.folds import slice_run
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.data.waves import waves
from herringbone_sim.gap.observations import balance
from herringbone_sim.gap.observations.basis import Function
from herringbone_sim.gap.observations.law import Change, Motion, law, waves_of
from herringbone_sim.gap.observations.rollout import STATES, Drive
from herringbone_sim.gap.observations.shooting import (
    WINDOWS,
    Shot,
    Stretch,
    fitted,
    jacobian,
    loads,
    residual,
    samples_of,
    shoot,
    stretch,
    symmetric,
    with_swing,
)
from herringbone_sim.gap.observations.window_columns import (
    Push,
    body_pushes,
    columns,
    gratings,
)
from herringbone_sim.gap.observations.window_sensors import ERRORS, SWAP, put_right
from herringbone_sim.gap.observations.window_starts import carried, first_states, started
from herringbone_sim.gap.residuals.balance import hermite_interpolation

Array = NDArray[np.float64]

NAME = "trajectory"
FIRST, LATER = 8, 2  # rounds of a fit under a change: new, and near one that was tried before
# Shapes of forces that a cause of any kind may be made of, at the meshes.
ANY = {"kappa", "gamma", "gamma out", "b_plus", "b_minus", *(f"kappa load {i}" for i in range(6))}
ANY |= {f"{q} {i} {trig}" for q in "ke" for i in (1, 2, 3) for trig in ("cos", "sin")}
ANY |= {f"{q} 1 {trig}" for q in ("sun", "planet", "ring") for trig in ("cos", "sin")}
LEAD = 12  # windows; in nine the filter found the motion of all planets from any start tried
SQUARES_OF_A_FIT = 1.5  # a value: states that leave no more need no other start
ANOTHER = 0.75  # of the squares at the last start: a change that takes off so much moves otherwise
LOOSE = 1e3  # prior of a state, in units of the motion: none


def trajectory(run: PreparedRun) -> Trajectory:
    """The windows of a run, with or without the swing of the whole gear, whichever fits better."""
    if run.model.packed.K == 0.0 or not run.u.there.any():
        return Trajectory(run)
    found = Trajectory(run), Trajectory(with_swing(run))
    return min(found, key=lambda one: one.nominal.cost)


def function_names(
    model: Model, laws: Sequence[Function], channels: Sequence[str]
) -> tuple[str, ...]:
    """Columns: masses, channels' errors, friction by mesh, ripple, every law on its meshes.

    Args:
        laws: functions of the force law, and those that push the carrier.
    """
    meshes = range(model.layout.n_mesh)
    names = [*balance.MASSES, *(f"{e} of {c}" for c in channels for e in ERRORS)]
    turning = [c for c in channels if c.startswith("u_")]
    names += [f"{SWAP}{one} and {other}" for one, other in combinations(turning, 2)]
    names += [f"friction {g} of {j}" for j in meshes for g in balance.FRICTION]
    names += [f"ripple {q} {trig}" for q in balance.RIPPLES for trig in ("cos", "sin")]
    of_meshes = [f for f in laws if f.slot != "body"]
    names += [f"{f.name} of {j}" for j in meshes for f in of_meshes if f.acts_on(j)]
    return (*names, *(f.name for f in laws if f.slot == "body"))


class Trajectory:
    """The windows of a run, their states under any change of the law.

    Args:
        run: with rotations or accelerations of suns and carrier.
        lead: windows that are left out at the start, for the filter alone.
    """

    def __init__(self, run: PreparedRun, lead: int = LEAD, windows: int = WINDOWS) -> None:
        samples = samples_of(run)
        self.run, self.lead = run, max(0, min(lead, (len(run) - 1) // samples - windows))
        part = slice_run(run, slice(self.lead * samples, None), run.name)
        self.recorded: Stretch = stretch(part, windows)
        self.stretch = self.recorded  # without the errors of sensors last tried
        self.model = run.model
        self._found: dict[tuple[str, ...], Shot] = {}
        self._started: dict[tuple[str, ...], float] = {}
        self._costs: dict[tuple[str, ...], float] = {}
        self._rested: set[tuple[str, ...]] = set()  # changes whose settled fit was begun anew
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
        tau = loads(m, s.phase - s.run.late_rad)
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
        u, rate = hermite_interpolation(steps[:, :half], steps[:, half:], self.stretch.h, 2)
        return self.motion(np.hstack([u, rate]), self.stretch.phase)

    def solved(
        self,
        key: tuple[str, ...],
        change_of: Callable[[Motion], Change],
        of_bodies: Mapping[str, float],
        on_carrier: Sequence[Function] = (),
    ) -> Shot:
        """States under a change.

        Args:
            key: names of what is changed; the states are kept by it.
            change_of: what a motion makes of the law.
            of_bodies: amplitudes of masses, errors of sensors, friction and ripple, and of what
                pushes the carrier.
            on_carrier: functions that push it.
        """
        drive_at = self._drive_at(change_of, of_bodies, on_carrier)
        new = key not in self._found
        shot = self._found.get(key, self.nominal)
        shot = fitted(self.stretch, shot.starts, drive_at(shot), FIRST if new else LATER)
        before = self._started.get(key, self.nominal.cost)
        far_off = shot.cost > SQUARES_OF_A_FIT * np.count_nonzero(self.stretch.weight)
        settled = abs(self._costs.get(key, np.inf) - shot.cost) < LIKELIER
        at_rest = far_off and settled and key not in self._rested
        if at_rest:
            self._rested.add(key)
        another = at_rest or shot.cost < ANOTHER * before or (new and shot.cost > before)
        if another and far_off:
            near = shot
            anew = self._anew(drive_at(near), self._whole.driven(change_of, of_bodies, on_carrier))
            shot = anew if anew is not None and anew.cost < near.cost else near
            self._started[key] = shot.cost
        self._found[key], self._costs[key] = shot, shot.cost
        return shot

    def cost_near(
        self,
        near: Shot,
        change_of: Callable[[Motion], Change],
        of_bodies: Mapping[str, float],
        on_carrier: Sequence[Function],
        rounds: int,
    ) -> float:
        """Squares that a few rounds leave under a change, from states without it.

        Several threads may ask at once.
        """
        own = copy.copy(self)
        drive_at = own._drive_at(change_of, of_bodies, on_carrier)
        return fitted(own.stretch, near.starts, drive_at(near), rounds).cost

    def driven(
        self,
        change_of: Callable[[Motion], Change],
        of_bodies: Mapping[str, float],
        on_carrier: Sequence[Function],
    ) -> Drive:
        """What drives the motion under a change, where none but a motion in step is known."""
        drive_at = self._drive_at(change_of, of_bodies, on_carrier)
        s = self.stretch
        return drive_at(shoot(s, symmetric(s), self.drive(Change(), self._masses({}), ())))

    def _drive_at(
        self,
        change_of: Callable[[Motion], Change],
        of_bodies: Mapping[str, float],
        on_carrier: Sequence[Function],
    ) -> Callable[[Shot], Drive]:
        """What drives the motion under a change, which may follow from the motion."""
        self.stretch = put_right(self.recorded, of_bodies)
        masses = self._masses(of_bodies)

        def drive_at(shot: Shot) -> Drive:
            m = self._half_steps(shot)
            change = change_of(m)
            pushes = [
                (push, of_bodies[push.name])
                for push in body_pushes(self.model, m, law(m, change), of_bodies, on_carrier)
            ]
            return self.drive(change, masses, pushes)

        return drive_at

    @cached_property
    def _whole(self) -> Trajectory:
        """The same with the windows before those that count."""
        return Trajectory(self.run, 0, self.lead + self.recorded.windows)

    @cached_property
    def nominal(self) -> Shot:
        """States under no change, from planets in step or out of it."""
        mine, of_whole = (one.drive(Change(), self._masses({}), ()) for one in (self, self._whole))
        return started(self.recorded, mine, self._whole.recorded, of_whole)

    def _anew(self, drive: Drive, of_whole: Drive) -> Shot | None:
        """States found under a change itself: its pattern of contact may be another one.

        None where no motion of a gear follows what was measured under the change.
        """
        whole = self._whole.stretch
        try:
            starts, cost = carried(whole, of_whole, first_states(whole))
        except np.linalg.LinAlgError:
            return None
        best = starts[int(np.argmin(np.nan_to_num(cost, nan=np.inf))), self.lead :]
        return fitted(self.stretch, best, drive, FIRST)

    def _masses(self, of_bodies: Mapping[str, float]) -> Array:
        """(9,) factors on 1/M."""
        s, c, p = (1.0 + of_bodies.get(f"M_{body}", 0.0) for body in "scp")
        return np.array([s, s, c, *[p] * (STATES // 2 - 3)])

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
        self.last = shot, now, m
        added = columns(s, shot, m, now, functions, wanted)
        waves_of_encoders, sizes = gratings(s)
        J = np.hstack([jacobian(s, shot), waves_of_encoders])
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
            added[:, None, :],
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

    def surroundings(self, block: Block, functions: Sequence[Function]) -> Surroundings:
        """What forces of many shapes would add to the rows of the block made last."""
        s = self.stretch
        shot, now, m = self.last
        some = [f for f in functions if f.name in ANY]
        wanted = [f"{f.name} of {j}" for f in some for j in range(len(s.G))]
        made = columns(s, shot, m, now, some, wanted) / block.sigma
        left = clearing(block, 0)(made)
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
