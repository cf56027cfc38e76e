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
from herringbone_sim.diagnosis.flexible import RegressionInputs
from herringbone_sim.diagnosis.products import Block, nuisance_remover
from herringbone_sim.diagnosis.search import CHANCE_CHI2
from herringbone_sim.gap.data.parts import part_of
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.data.waves import waves
from herringbone_sim.gap.observations import balance
from herringbone_sim.gap.observations.basis import Function
from herringbone_sim.gap.observations.body_motion import body_loads, with_rigid_swing
from herringbone_sim.gap.observations.law import LawChange, MeshMotion, law, waves_of
from herringbone_sim.gap.observations.rollout import STATES, Forcing
from herringbone_sim.gap.observations.shooting import (
    N_WINDOWS,
    Windows,
    WindowSolution,
    evaluated,
    fitted_windows,
    jacobian,
    stacked_residual,
    symmetric_starts,
    window_samples,
    windows_of_run,
)
from herringbone_sim.gap.observations.window_columns import (
    BodyForce,
    body_forces,
    encoder_columns,
    window_columns,
)
from herringbone_sim.gap.observations.window_sensors import (
    ERRORS,
    SWAP_PREFIX,
    without_sensor_errors,
)
from herringbone_sim.gap.observations.window_starts import (
    filter_and_fit,
    filtered_starts,
    first_states,
)
from herringbone_sim.gap.residuals.balance import between

Array = NDArray[np.float64]

NAME = "trajectory"
ROUNDS_NEW, ROUNDS_AGAIN = (
    8,
    2,
)  # rounds of a fit under a change: new, and near one that was tried before
# Shapes of forces that a cause of any kind may be made of, at the meshes.
GENERIC_FUNCTIONS = {
    "kappa",
    "gamma",
    "gamma out",
    "b_plus",
    "b_minus",
    *(f"kappa load {i}" for i in range(6)),
}
GENERIC_FUNCTIONS |= {
    f"{q} {i} {trig}" for q in "ke" for i in (1, 2, 3) for trig in ("cos", "sin")
}
GENERIC_FUNCTIONS |= {
    f"{q} 1 {trig}" for q in ("sun", "planet", "ring") for trig in ("cos", "sin")
}
LEAD_WINDOWS = (
    12  # windows; in nine the filter found the motion of all planets from any start tried
)
MAX_FIT_CHI2 = 1.5  # a value: states that leave no more need no other start
RESTART_SHARE = (
    0.75  # of the squares at the last start: a change that takes off so much moves otherwise
)
STATE_PRIOR_SD = 1e3  # prior of a state, in units of the motion: none


def trajectory(run: PreparedRun) -> Trajectory:
    """The windows of a run, with or without the swing of the whole gear, whichever fits better."""
    if run.model.packed.K == 0.0 or not run.u.there.any():
        return Trajectory(run)
    found = Trajectory(run), Trajectory(with_rigid_swing(run))
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
    names += [f"{SWAP_PREFIX}{one} and {other}" for one, other in combinations(turning, 2)]
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

    def __init__(
        self, run: PreparedRun, lead: int = LEAD_WINDOWS, windows: int = N_WINDOWS
    ) -> None:
        samples = window_samples(run)
        self.run, self.lead_windows = run, max(0, min(lead, (len(run) - 1) // samples - windows))
        part = part_of(run, slice(self.lead_windows * samples, None), run.name)
        self.recorded: Windows = windows_of_run(part, windows)
        self.windows = self.recorded  # without the errors of sensors last tried
        self.model = run.model
        self._solutions: dict[tuple[str, ...], WindowSolution] = {}
        self._restart_energies: dict[tuple[str, ...], float] = {}
        self._energies: dict[tuple[str, ...], float] = {}
        self._restarted_when_settled: set[tuple[str, ...]] = (
            set()
        )  # changes whose settled fit was begun anew
        self._share: float | None = None

    @cached_property
    def _nominal(self) -> tuple[Array, Array, Array]:
        """k, e and its rate at every half step."""
        s = self.windows
        w = waves(s.run.model, s.phase - s.run.late_rad, s.run.omega_rad_per_s)
        return w.k, w.e, w.e_rate

    def forcing(
        self, change: LawChange, masses: Array, pushes: Sequence[tuple[BodyForce, float]]
    ) -> Forcing:
        """What drives the motion under a change (at every half step)."""
        s = self.windows
        k, e, rate = self._nominal
        m = self.model
        one = np.ones_like(k)
        tau = body_loads(m, s.phase - s.run.late_rad)
        for push, a in pushes:
            tau = tau + a * push.size[:, None] * push.direction
        return Forcing(
            s.G,
            s.inverse * masses,
            tau,
            k * (1.0 + change.kappa) + mean_stiffness(m.parameters) * change.mean_kappa,
            m.damping_n_s_per_m * (1.0 + change.gamma) * one,
            change.d - e,
            change.d_rate - rate,
            np.maximum(m.half_backlash_m + change.b_plus, 0.0) * one,
            np.maximum(m.half_backlash_m + change.b_minus, 0.0) * one,
            change.extra_force * one,
        )

    def motion(self, states: Array, phase: Array) -> MeshMotion:
        """Meshes of some states (n, 18) at phases (n,), as the force law needs them."""
        s, m = self.windows, self.model
        w = waves(m, phase - s.run.late_rad, s.run.omega_rad_per_s)
        half = STATES // 2
        n, meshes = len(states), m.layout.n_mesh
        nothing = np.zeros(meshes)
        return MeshMotion(
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

    def _motion_at_half_steps(self, solution: WindowSolution) -> MeshMotion:
        """The motion at every half step, windows one after the other."""
        half, steps = STATES // 2, _concatenated(solution)
        u, rate = between(steps[:, :half], steps[:, half:], self.windows.h, 2)
        return self.motion(np.hstack([u, rate]), self.windows.phase)

    def fitted_states(
        self,
        key: tuple[str, ...],
        change_of: Callable[[MeshMotion], LawChange],
        of_bodies: Mapping[str, float],
        on_carrier: Sequence[Function] = (),
    ) -> WindowSolution:
        """States under a change.

        Args:
            key: names of what is changed; the states are kept by it.
            change_of: what a motion makes of the law.
            of_bodies: amplitudes of masses, errors of sensors, friction and ripple, and of what
                pushes the carrier.
            on_carrier: functions that push it.
        """
        forcing_at = self._forcing_under(change_of, of_bodies, on_carrier)
        new = key not in self._solutions
        solution = self._solutions.get(key, self.nominal)
        solution = fitted_windows(
            self.windows,
            solution.starts,
            forcing_at(solution),
            ROUNDS_NEW if new else ROUNDS_AGAIN,
        )
        before = self._restart_energies.get(key, self.nominal.cost)
        far_off = solution.cost > MAX_FIT_CHI2 * np.count_nonzero(self.windows.weight)
        settled = abs(self._energies.get(key, np.inf) - solution.cost) < CHANCE_CHI2
        at_rest = far_off and settled and key not in self._restarted_when_settled
        if at_rest:
            self._restarted_when_settled.add(key)
        another = (
            at_rest or solution.cost < RESTART_SHARE * before or (new and solution.cost > before)
        )
        if another and far_off:
            near = solution
            anew = self._restarted(
                forcing_at(near), self._with_lead.in_step_forcing(change_of, of_bodies, on_carrier)
            )
            solution = anew if anew is not None and anew.cost < near.cost else near
            self._restart_energies[key] = solution.cost
        self._solutions[key], self._energies[key] = solution, solution.cost
        return solution

    def cost_near(
        self,
        near: WindowSolution,
        change_of: Callable[[MeshMotion], LawChange],
        of_bodies: Mapping[str, float],
        on_carrier: Sequence[Function],
        rounds: int,
    ) -> float:
        """Squares that a few rounds leave under a change, from states without it.

        Several threads may ask at once.
        """
        own = copy.copy(self)
        forcing_at = own._forcing_under(change_of, of_bodies, on_carrier)
        return fitted_windows(own.windows, near.starts, forcing_at(near), rounds).cost

    def in_step_forcing(
        self,
        change_of: Callable[[MeshMotion], LawChange],
        of_bodies: Mapping[str, float],
        on_carrier: Sequence[Function],
    ) -> Forcing:
        """What drives the motion under a change, where none but a motion in step is known."""
        forcing_at = self._forcing_under(change_of, of_bodies, on_carrier)
        s = self.windows
        return forcing_at(
            evaluated(s, symmetric_starts(s), self.forcing(LawChange(), self._masses({}), ()))
        )

    def _forcing_under(
        self,
        change_of: Callable[[MeshMotion], LawChange],
        of_bodies: Mapping[str, float],
        on_carrier: Sequence[Function],
    ) -> Callable[[WindowSolution], Forcing]:
        """What drives the motion under a change, which may follow from the motion."""
        self.windows = without_sensor_errors(self.recorded, of_bodies)
        masses = self._masses(of_bodies)

        def forcing_at(solution: WindowSolution) -> Forcing:
            m = self._motion_at_half_steps(solution)
            change = change_of(m)
            pushes = [
                (push, of_bodies[push.name])
                for push in body_forces(self.model, m, law(m, change), of_bodies, on_carrier)
            ]
            return self.forcing(change, masses, pushes)

        return forcing_at

    @cached_property
    def _with_lead(self) -> Trajectory:
        """The same with the windows before those that count."""
        return Trajectory(self.run, 0, self.lead_windows + self.recorded.n_windows)

    @cached_property
    def nominal(self) -> WindowSolution:
        """States under no change, from planets in step or out of it."""
        mine, of_whole = (
            one.forcing(LawChange(), self._masses({}), ()) for one in (self, self._with_lead)
        )
        return filter_and_fit(self.recorded, mine, self._with_lead.recorded, of_whole)

    def _restarted(self, forcing: Forcing, of_whole: Forcing) -> WindowSolution | None:
        """States found under a change itself: its pattern of contact may be another one.

        None where no motion of a gear follows what was measured under the change.
        """
        whole = self._with_lead.windows
        try:
            starts, cost = filtered_starts(whole, of_whole, first_states(whole))
        except np.linalg.LinAlgError:
            return None
        best = starts[int(np.argmin(np.nan_to_num(cost, nan=np.inf))), self.lead_windows :]
        return fitted_windows(self.windows, best, forcing, ROUNDS_NEW)

    def _masses(self, of_bodies: Mapping[str, float]) -> Array:
        """(9,) factors on 1/M."""
        s, c, p = (1.0 + of_bodies.get(f"M_{body}", 0.0) for body in "scp")
        return np.array([s, s, c, *[p] * (STATES // 2 - 3)])

    def block(
        self,
        solution: WindowSolution,
        change_of: Callable[[MeshMotion], LawChange],
        functions: Sequence[Function],
        wanted: Sequence[str],
    ) -> Block:
        """Residual of the windows at some states, with columns of the functions wanted."""
        s = self.windows
        m = self.motion(_concatenated(solution), s.phase[::2])
        now = law(m, change_of(m))
        self.last_linearisation = solution, now, m
        added = window_columns(s, solution, m, now, functions, wanted)
        waves_of_encoders, sizes = encoder_columns(s)
        J = np.hstack([jacobian(s, solution), waves_of_encoders])
        left = stacked_residual(solution)
        unknown = s.n_windows * STATES
        share = self._independent_share(J[:, :unknown])
        return Block(
            NAME,
            s.run.name,
            ("windows",),
            left[:, None],
            np.full((len(left), 1), np.sqrt(share)),
            tuple(wanted),
            added[:, None, :],
            J[:, None, :],
            np.append(np.full(unknown, STATE_PRIOR_SD), sizes)[None],
            np.zeros((0, 1, len(wanted))),
            np.zeros(0),
            independent_share=share,
        )

    def _independent_share(self, J: Array) -> float:
        """Share of the rows that noise is expected to leave squares in, one each.

        Ties have no noise of their own, they only hold the states; states take up what is left of
        a row in proportion to its leverage.
        """
        if self._share is None:
            read = np.flatnonzero(self.windows.weight.ravel() > 0.0)
            normal = J.T @ J + np.eye(J.shape[1]) / STATE_PRIOR_SD**2
            leverage = np.sum(J[read] * np.linalg.solve(normal, J[read].T).T)
            self._share = max(len(read) - float(leverage), 1.0) / len(J)
        return self._share

    def regression_inputs(self, block: Block, functions: Sequence[Function]) -> RegressionInputs:
        """What forces of many shapes would add to the rows of the block made last."""
        s = self.windows
        solution, now, m = self.last_linearisation
        some = [f for f in functions if f.name in GENERIC_FUNCTIONS]
        wanted = [f"{f.name} of {j}" for f in some for j in range(len(s.G))]
        made = window_columns(s, solution, m, now, some, wanted) / block.sigma
        left = nuisance_remover(block, 0)(made)
        nothing = np.zeros((len(left), 1, 1))
        return RegressionInputs(nothing, nothing[:, 0], nothing, left[:, None, :])

    def cycles(self) -> Array:
        """(rows,) mesh cycles since the start; jumps at that of their window."""
        s = self.windows
        W, samples, k = s.measured.shape
        phase = (s.phase - s.phase[0]) / (2.0 * np.pi)
        data = np.repeat(phase[:: 2 * s.steps_per_sample][: W * samples], k)
        return np.concatenate([data, np.repeat(phase[s.first_half_step[1:]], STATES)])


def _concatenated(solution: WindowSolution) -> Array:
    """States (n, 18) at every step, of the window that begins where two meet."""
    return np.vstack([solution.states[:, :-1].reshape(-1, STATES), solution.states[-1, -1:]])
