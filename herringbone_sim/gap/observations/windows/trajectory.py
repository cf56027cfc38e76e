"""The trajectory as an observation, for few channels: residual of fitted windows of the motion.

Where neither force law nor balance can be formed, states of short windows are fitted to the
recorded channels (``shooting``). The residual consists of those of the channels and of the jumps
between windows; the column of a function is the linear response of the windows to its force.

Over 300 lines: fit of the states, block and noise of the channels use the same cached states.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property

import numpy as np

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.diagnosis.flexible import RegressionInputs
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.diagnosis.search import CHANCE_CHI2
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.basis import Function
from herringbone_sim.gap.observations.regression_inputs import about_windows
from herringbone_sim.gap.observations.windows.columns import (
    nuisance_columns,
    window_columns,
)
from herringbone_sim.gap.observations.windows.elimination import StateElimination
from herringbone_sim.gap.observations.windows.forcing import ForcedWindows
from herringbone_sim.gap.observations.windows.integrator import STATES, Forcing
from herringbone_sim.gap.observations.windows.memory import Failure, Key, StateMemory
from herringbone_sim.gap.observations.windows.restarts import (
    WindowRange,
    misfits,
    restarted,
)
from herringbone_sim.gap.observations.windows.sensor_errors import (
    SWAP_PREFIX,
)
from herringbone_sim.gap.observations.windows.shooting import (
    FINE_TOLERANCE,
    WindowSolution,
    evaluated,
    fitted_windows,
    misses_much,
    stacked_residual,
    window_jacobian,
)
from herringbone_sim.gap.observations.windows.starts import (
    filter_and_fit,
    filtered_starts,
    initial_states,
)
from herringbone_sim.gap.observations.windows.windows import N_WINDOWS, Windows
from herringbone_sim.gap.residuals.mesh_law import LawChange, MeshMotion, law

NAME = "trajectory"
# Levenberg-Marquardt steps in the first fit of a ``key``, and in later ones, from its best states;
# chosen for run time.
ROUNDS_NEW, ROUNDS_AGAIN = 8, 2
# States are restarted once chi2 is less than this fraction of that at the last restart, as the
# motion has changed; chosen.
RESTART_SHARE = 0.75
# Restarts of misfitted windows: most in a fit, and most that gain nothing of the same windows at a
# chi2 that differs by less than ``RESTART_SHARE``; chosen for run time.
MAX_RESTARTS, MAX_FAILED = 3, 3
# Planets are out of step where their rotations differ by more than this fraction of the largest,
# and alike where their order changes chi2 by less than this fraction; chosen, far above rounding.
STEP_SHARE, ALIKE_SHARE = 1e-3, 1e-6
STATE_PRECISION = 1e-6  # of scaled start states: practically no prior


class Trajectory(ForcedWindows):
    """Windows of a run and their fitted states under changes of the law.

    Args:
        run, windows: see ``ForcedWindows``.
        exchanged: whether a swap of channels was undone in the run; then columns of swaps are 0.

    Attributes:
        last_linearisation: states, force law and mesh motion of the last ``block``.
        last_elimination: elimination of states, sensor errors and trends of the last ``block``.
    """

    _fine = False

    def __init__(
        self, run: PreparedRun, windows: int = N_WINDOWS, exchanged: bool = False
    ) -> None:
        super().__init__(run, windows=windows)
        self._exchanged = exchanged
        self.memory = StateMemory()
        self._independent: float | None = None
        self._nominal_solution: WindowSolution | None = None

    def fitted_states(
        self,
        key: Key,
        change_of: Callable[[MeshMotion], LawChange],
        other_amplitudes: Mapping[str, float],
        on_carrier: Sequence[Function] = (),
    ) -> WindowSolution:
        """Fit states under a change of the law, from the best fitted for the same ``key``.

        Other starts are tried against local minima: the states of least chi2 under any change
        without sensor errors; where chi2 is large, those of a new filter pass; and, where some
        windows fit much worse than the others, those of a new filter pass through these.

        Args:
            key: names of the functions with an amplitude.
            change_of: change of the law as a function of the motion.
            other_amplitudes: those of masses, sensor errors, friction, ripple and ``on_carrier``.
            on_carrier: functions on the carrier.

        Returns:
            Fitted states, kept in ``memory`` if their chi2 is the least of ``key``; ``nominal``
            where they diverge.
        """
        forcing_at = self.forcing_under(change_of, other_amplitudes, on_carrier)
        known = self.memory.known(key)
        new = known.best is None
        begin = known.best or self.nominal
        solution = fitted_windows(
            self.windows,
            begin.starts,
            forcing_at(begin),
            ROUNDS_NEW if new else ROUNDS_AGAIN,
            begin.trends,
        )
        better = self.memory.least
        if (
            better is not None
            and better.cost < solution.cost - CHANCE_CHI2
            and known.tried_chi2 != better.cost
        ):
            known.tried_chi2 = better.cost
            other = fitted_windows(
                self.windows, better.starts, forcing_at(better), ROUNDS_NEW, better.trends
            )
            solution = min(solution, other, key=lambda fit: fit.cost)
        anew, known.anew = known.anew, None
        if anew is not None:
            other = fitted_windows(
                self.windows, anew.starts, forcing_at(anew), ROUNDS_NEW, anew.trends
            )
            if other.cost < solution.cost:
                solution = other
                # The change may be refused: let a later fit of the key try the old states again.
                known.tried_chi2 = None
        before = self.nominal.cost if known.restart_chi2 is None else known.restart_chi2
        far_off = misses_much(self.windows, solution)
        settled = abs(known.last_chi2 - solution.cost) < CHANCE_CHI2
        at_rest = far_off and settled and not known.restarted_at_rest
        known.restarted_at_rest |= at_rest
        another = (
            at_rest or solution.cost < RESTART_SHARE * before or (new and solution.cost > before)
        )
        if another and far_off:
            near = solution
            other_pass = self._restarted(
                forcing_at(near),
                self._with_lead.in_step_forcing(change_of, other_amplitudes, on_carrier),
                near.trends,
            )
            better_pass = other_pass is not None and other_pass.cost < near.cost
            solution = other_pass if other_pass is not None and better_pass else near
            known.restart_chi2 = solution.cost
        if self._has_converged(solution):
            solution = self._without_misfits(self.windows, solution, forcing_at)
        if self._fine:
            solution = fitted_windows(
                self.windows,
                solution.starts,
                forcing_at(solution),
                trends=solution.trends,
                tolerance=FINE_TOLERANCE,
            )
        known.last_chi2 = solution.cost
        if not self._has_converged(solution):
            return self.nominal
        known.keep(solution.fitted)
        if self.windows is self.recorded:
            self.memory.keep_least(solution.fitted)
        return solution

    def states_anew(
        self,
        change_of: Callable[[MeshMotion], LawChange],
        other_amplitudes: Mapping[str, float],
        on_carrier: Sequence[Function],
        keys: Sequence[Key] = (),
    ) -> WindowSolution | None:
        """Fit states from those of a new filter pass under a change, see ``fitted_states``.

        Thread-safe unless remembered; None where the filter diverges.

        Args:
            keys: those whose next ``fitted_states`` starts from these, too.
        """
        own = copy.copy(self)
        forcing = own.forcing_under(change_of, other_amplitudes, on_carrier)(self.nominal)
        lead = copy.copy(self._with_lead)
        own.__dict__["_with_lead"] = lead
        with_lead = lead.in_step_forcing(change_of, other_amplitudes, on_carrier)
        solution = own._restarted(forcing, with_lead, self.nominal.trends)
        if solution is not None:
            for key in keys:
                self.memory.known(key).anew = solution.fitted
        return solution

    @contextmanager
    def to_the_end(self) -> Iterator[None]:
        """Let ``fitted_states`` fit to ``FINE_TOLERANCE`` inside this context."""
        self._fine = True
        try:
            yield
        finally:
            self._fine = False

    def is_out_of_step(self) -> bool:
        """Whether planets of a side move differently under the nominal law."""
        u = self.nominal.starts[:, 3 : STATES // 2].reshape(-1, 2, (STATES // 2 - 3) // 2)
        return bool(np.ptp(u, axis=2).max() > STEP_SHARE * np.abs(u).max())

    def is_alike(self, order: Indices) -> bool:
        """Whether the nominal law fits as well with bodies (9,) in another order."""
        change = self.in_order(order).cost - self.nominal.cost
        return bool(abs(change) < ALIKE_SHARE * self.nominal.cost)

    def in_order(self, order: Indices) -> WindowSolution:
        """Nominal states in which body i moves as body ``order[i]`` does in ``nominal``."""
        forcing = self.forcing(LawChange(), self.masses({}), ())
        starts = self.nominal.starts[:, _of_states(order)]
        return evaluated(self.recorded, starts, forcing, self.nominal.trends)

    def reordered(self, order: Indices) -> Trajectory:
        """Copy with ``nominal`` and the states fitted so far in an order, see ``in_order``.

        The trajectory itself where the order is the present one.
        """
        if np.array_equal(order, np.arange(len(order))):
            return self
        other = copy.copy(self)
        other._nominal_solution = self.in_order(order)
        other.memory = self.memory.reordered(_of_states(order))
        return other

    def with_own_memory(self) -> Trajectory:
        """Copy whose fits this trajectory does not remember."""
        other = copy.copy(self)
        other.memory = self.memory.copy()
        return other

    @property
    def is_fitted(self) -> bool:
        """Whether states were fitted under any change of the law."""
        return any(known.best is not None for known in self.memory.by_key.values())

    def _without_misfits(
        self, s: Windows, solution: WindowSolution, forcing_at: Callable[[WindowSolution], Forcing]
    ) -> WindowSolution:
        """Restart misfitted windows while that gains, see ``window_restarts``.

        Windows that failed ``MAX_FAILED`` times are left: what they lack is in the law.
        """
        for _ in range(MAX_RESTARTS):
            groups = [g for g in misfits(s, solution) if self._tries(g, solution) < MAX_FAILED]
            if not groups:
                return solution
            now = evaluated(s, solution.starts, forcing_at(solution), solution.trends)
            anew = restarted(s, now, groups[0], self._tries(groups[0], solution))
            if anew is None:
                tries = self._tries(groups[0], solution) + 1
                self.memory.failures.append(Failure(groups[0], solution.cost, tries))
                return solution
            solution = anew
        return solution

    def _tries(self, group: WindowRange, solution: WindowSolution) -> int:
        """Number of restarts of any of these windows that gained nothing at a similar chi2."""
        return max(
            (
                tries
                for g, chi2, tries in self.memory.failures
                if g.first <= group.last
                and group.first <= g.last
                and RESTART_SHARE * chi2 < solution.cost < chi2 / RESTART_SHARE
            ),
            default=0,
        )

    def _has_converged(self, solution: WindowSolution) -> bool:
        """Whether chi2 is at most that of the readings themselves; diverging states exceed it."""
        s = self.windows
        return bool(solution.cost <= np.sum((s.measured * s.weight) ** 2))

    def chi2_from(
        self,
        near: WindowSolution,
        change_of: Callable[[MeshMotion], LawChange],
        other_amplitudes: Mapping[str, float],
        on_carrier: Sequence[Function],
        rounds: int,
    ) -> float:
        """Chi2 of all windows after at most ``rounds`` steps of the fit from the states ``near``.

        Under a change; ``windows`` and ``memory`` are left as they are.

        Thread-safe; inf where the states diverge. Other arguments are those of ``fitted_states``.
        """
        own = copy.copy(self)
        forcing_at = own.forcing_under(change_of, other_amplitudes, on_carrier)
        forcing = forcing_at(near)
        cost = fitted_windows(own.windows, near.starts, forcing, rounds, near.trends).cost
        return cost if np.isfinite(cost) else np.inf

    @cached_property
    def _with_lead(self) -> ForcedWindows:
        """Windows of the whole run, including those at its start that only the filter uses."""
        return ForcedWindows(self.run, 0, self.lead_windows + self.recorded.n_windows)

    @property
    def nominal(self) -> WindowSolution:
        """States fitted under the nominal law, from planets in step and out of step; the best."""
        # No cached_property: before Python 3.12 it lets one thread at a time compute.
        if self._nominal_solution is None:
            forcing, forcing_with_lead = (
                trajectory.forcing(LawChange(), self.masses({}), ())
                for trajectory in (self, self._with_lead)
            )
            fit = filter_and_fit(
                self.recorded, forcing, self._with_lead.recorded, forcing_with_lead
            )
            self._nominal_solution = self._without_misfits(
                self.recorded, fit, lambda solution: forcing
            )
        return self._nominal_solution

    def _restarted(
        self, forcing: Forcing, forcing_with_lead: Forcing, trends: Array
    ) -> WindowSolution | None:
        """Fit states from those of a new filter pass; None if the filter diverges.

        Args:
            forcing: of the windows under the change.
            forcing_with_lead: of the windows of the whole run, ``_with_lead``, under the change.
            trends: (m,) initial amplitudes of the trends.
        """
        with_lead = self._with_lead.windows.without_trends(trends)
        try:
            starts, cost = filtered_starts(with_lead, forcing_with_lead, initial_states(with_lead))
        except np.linalg.LinAlgError:
            return None
        best = starts[int(np.argmin(np.nan_to_num(cost, nan=np.inf))), self.lead_windows :]
        return fitted_windows(self.windows, best, forcing, ROUNDS_NEW, trends)

    def block(
        self,
        solution: WindowSolution,
        change_of: Callable[[MeshMotion], LawChange],
        functions: Sequence[Function],
        wanted: Sequence[str],
    ) -> Block:
        """Block of the windows about fitted states, with one row.

        States, sensor errors and trends are eliminated. Sets ``last_linearisation`` and
        ``last_elimination``.

        Args:
            solution: the fitted states.
            change_of: change of the law as a function of the motion.
            functions: of the force law and on the carrier.
            wanted: names of the columns.
        """
        s = self.windows
        m = self.motion(solution.states_of_all, s.phase[::2])
        now = law(m, change_of(m))
        self.last_linearisation = solution, now, m
        states = StateElimination(
            window_jacobian(s, solution), *nuisance_columns(s), STATE_PRECISION
        )
        added = window_columns(s, solution, m, now, functions, wanted)
        if self._exchanged:
            added[:, [name.startswith(SWAP_PREFIX) for name in wanted]] = 0.0
        rows = states.clear(np.column_stack([stacked_residual(solution), added]))
        if self._independent is None:
            self._independent = self._independent_readings(states)
        share = self._independent / len(rows)
        self.last_elimination = states
        return Block(
            NAME,
            rows[:, :1],
            np.full((len(rows), 1), np.sqrt(share)),
            tuple(wanted),
            rows[:, None, 1:],
            np.zeros((len(rows), 1, 0)),
            np.zeros((1, 0)),
            np.zeros((0, 1, len(wanted))),
            np.zeros(0),
            independent_share=share,
        )

    def _independent_readings(self, states: StateElimination) -> float:
        """Number of readings minus those that the states use up, at least 1; jumps don't count."""
        return max(float(np.count_nonzero(self.windows.weight)) - states.leverage(), 1.0)

    def noise_left(self) -> dict[str, float]:
        """Noise of each channel by name, in its unit, from its residual under the nominal law.

        It is the RMS residual without sensor errors and trends, corrected for the fraction that
        the states absorb, equal in all channels, but not for the little that drift does. 0 without
        readings; empty if states diverge.
        """
        s, solution = self.recorded, self.nominal
        if not np.isfinite(solution.cost):
            return {}
        states = StateElimination(
            window_jacobian(s, solution), *nuisance_columns(s), STATE_PRECISION
        )
        there = s.weight > 0.0
        rows = states.clear(stacked_residual(solution)[:, None])[: there.size, 0]
        left = np.divide(
            rows.reshape(there.shape), s.weight, out=np.zeros_like(s.weight), where=there
        )
        count = np.count_nonzero(there, axis=(0, 1))
        share = self._independent_readings(states) / np.count_nonzero(there)
        rms = np.sqrt(np.sum(left**2, axis=(0, 1)) / np.maximum(share * count, 1.0))
        return dict(zip(s.channels.names, rms.tolist(), strict=True))

    def regression_inputs(self, block: Block, functions: Sequence[Function]) -> RegressionInputs:
        """Inputs of the flexible regression of the last ``block``: whitened responses to functions
        of the law, states eliminated.
        """
        s = self.windows
        solution, now, m = self.last_linearisation

        def responses(some: Sequence[Function], wanted: Sequence[str]) -> Array:
            return window_columns(s, solution, m, now, some, wanted)

        every = about_windows(responses, functions, len(s.G), self.cycles())
        left = self.last_elimination.clear(every) / block.sigma
        nothing = np.zeros((len(left), 1, 1))
        return RegressionInputs(nothing, nothing[:, 0], nothing, left[:, None, :])

    def cycles(self) -> Array:
        """(rows,) mesh cycles of residuals and jumps since the first window began; 0 of priors."""
        s = self.windows
        W, samples, k = s.measured.shape
        phase = (s.phase - s.phase[0]) / (2.0 * np.pi)
        data = np.repeat(phase[:: 2 * s.steps_per_sample][: W * samples], k)
        jumps = np.repeat(phase[s.first_half_step[1:]], STATES)
        return np.concatenate([data, jumps, np.zeros_like(nuisance_columns(s)[1])])


def _of_states(order: Indices) -> Indices:
    """Indices (18,) of states by those (9,) of bodies."""
    return np.concatenate([order, order + STATES // 2])
