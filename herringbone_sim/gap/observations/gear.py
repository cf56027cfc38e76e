"""All observations of a gear's runs, linearised about any change of the force law.

Over 300 lines: the observations share caches and copies of one object.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from itertools import count
from typing import TYPE_CHECKING

import numpy as np

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.diagnosis.flexible import RegressionInputs
from herringbone_sim.diagnosis.machine import Amplitudes
from herringbone_sim.diagnosis.parallel import parallel_map
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.diagnosis.search import CHANCE_CHI2
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations import consistency, force_law, torque_balance
from herringbone_sim.gap.observations.basis import Function
from herringbone_sim.gap.observations.block_columns import linear_block_at, with_common_columns
from herringbone_sim.gap.observations.law_changes import LawChanges
from herringbone_sim.gap.observations.recorded_channels import RecordedGear
from herringbone_sim.gap.observations.regression_inputs import about_meshes, about_rows
from herringbone_sim.gap.observations.runs import GearRun
from herringbone_sim.gap.observations.windows import columns as window_columns
from herringbone_sim.gap.observations.windows import trajectory
from herringbone_sim.gap.observations.windows.shooting import WindowSolution
from herringbone_sim.gap.residuals.mesh_law import Law, LawChange, MeshMotion, law
from herringbone_sim.gap.residuals.torque_balance import FINE, window_of

if TYPE_CHECKING:
    from herringbone_sim.gap.observations.hypotheses.moving_parts import MovingPart


class GearObservations(RecordedGear):
    """Observations of a gear's runs, linearised about any change of the law.

    Args:
        runs, stride, swap, gain_tolerance: see ``RecordedGear``.

    Attributes:
        exact_forces: whether the balance integrates forces between samples under all changes of
            the law, instead of the nominal law.
        body_functions: additional functions: forces on the carrier.
        part_numbers: counter that labels moving parts, shared by all copies.
    """

    def __init__(
        self,
        runs: Sequence[PreparedRun],
        stride: int = 1,
        swap: tuple[str, str] | None = None,
        gain_tolerance: Sequence[float] = (),
    ) -> None:
        super().__init__(runs, stride, swap, gain_tolerance)
        self.exact_forces = False
        self.body_functions: tuple[Function, ...] = ()
        self._changes = LawChanges(self.model, force_law.law_functions(self.model), {})
        self._part_amplitudes: Amplitudes = {}
        self._measured_balances: list[Block] = []  # shared by all copies
        self.part_numbers = count()

    @property
    def law_functions(self) -> tuple[Function, ...]:
        """Functions of the force law."""
        return self._changes.functions

    @cached_property
    def functions(self) -> dict[str, tuple[str, ...]]:
        """Names of all functions (columns), by observation."""
        laws = tuple(f.name for f in self.law_functions)
        return {
            force_law.NAME: laws,
            torque_balance.NAME: torque_balance.function_names(
                self.model,
                self.modelled,
                self.law_functions,
                [f.name for f in self.body_functions],
            ),
            consistency.NAME: consistency.function_names(self.model.layout, self.swap),
            trajectory.NAME: window_columns.function_names(
                self.model,
                (*self.law_functions, *self.body_functions),
                self.followed_channels,
            )
            if self.uses_windows
            else (),
        }

    def for_runs(self, runs: Sequence[PreparedRun]) -> GearObservations:
        """The same observations of other runs of the rig, at every sample.

        Coefficients fitted to this gear apply to it. Fitted windows of common runs are reused.
        """
        gear = GearObservations(runs, 1, self.swap, self.gain_tolerance)
        gear.take_observations(self)
        gear.windows = self.windows
        known = {id(g.run): self._trajectories.get(r) for r, g in enumerate(self.runs)}
        reused = {r: known.get(id(run)) for r, run in enumerate(runs)}
        gear._trajectories.update({r: t for r, t in reused.items() if t is not None})
        gear.part_numbers = self.part_numbers
        return gear

    def reordered(self, orders: Sequence[Indices]) -> GearObservations:
        """Copy with the bodies of each run in an order, see ``Trajectory.reordered``."""
        gear = copy.copy(self)
        gear._trajectories = {
            r: self.trajectory_of(r).reordered(order)
            for r, order in enumerate(orders)
            if self.has_windows_of(r)
        }
        gear._formed = {}
        return gear

    def states_improve(self, amplitudes: Amplitudes) -> bool:
        """Whether states fitted again under a change leave less chi2, by more than chance.

        Less than the least that is known of each run with the same functions.
        """

        def gained(r: int) -> float:
            known = self.trajectory_under(r, amplitudes).memory
            before = known.known(_functions_acting(r, amplitudes)).chi2
            return max(0.0, before - self.states(r, amplitudes).cost)

        runs = [r for r in range(len(self.runs)) if self.has_windows_of(r)]
        return sum(parallel_map(gained, runs)) > CHANCE_CHI2

    def with_windows(self, windows: int) -> GearObservations:
        """Copy with at most ``windows`` windows of a run, none of them fitted."""
        gear = copy.copy(self)
        gear._forget_windows(windows)
        return gear

    @cached_property
    def _quadrature(self) -> list[Array | None]:
        """``_quadrature_error`` of every run for the nominal law."""
        return [self._quadrature_error(r, {}) for r in range(len(self.runs))]

    def _quadrature_error(self, r: int, of_law: Mapping[str, Array]) -> Array | None:
        """Error (k, n_mesh) [N] of averaging the law's forces of run r over samples alone.

        Their Gaussian moving average at fine steps minus that at samples, for each of the k
        samples with a whole averaging window; None if run r has no ``dense`` motion.

        Args:
            r: index of the run.
            of_law: amplitudes (n_mesh,) by function of the law; empty: the nominal law.
        """
        g = self.runs[r]
        dense = g.dense
        if dense is None:
            return None
        force = self.law_of(dense, of_law, ()).force
        look = window_of(g.run)
        fine = look.finer(FINE)
        reach = len(look.mean) // 2
        first = reach * FINE - len(fine.mean) // 2
        whole = fine.average(force)[first::FINE][: len(g.run) - 2 * reach]
        return np.asarray(whole - look.average(force[::FINE]))

    def without_linearisation(self) -> GearObservations:
        """Copy whose balance integrates forces between samples with all changes of the law."""
        gear = copy.copy(self)
        gear.exact_forces = True
        return gear

    @cached_property
    def _balances(self) -> list[Block]:
        """Balances if all forces are recorded; only columns on the carrier depend on the law."""
        if not self._measured_balances:
            self._measured_balances[:] = [  # threads may form them side by side
                self._balance(r, g, law(g.motion), self.law_functions)
                for r, g in enumerate(self.runs)
            ]
        if not self.body_functions:
            return self._measured_balances
        names = [f.name for f in self.body_functions]
        blocks = []
        for r, (g, plain) in enumerate(zip(self.runs, self._measured_balances, strict=True)):
            of_law = {f: a[r] for f, a in self._part_amplitudes.get(force_law.NAME, {}).items()}
            now = self.law_of(g.motion, of_law)
            on_carrier = self._balance(r, g, now, self.law_functions, names)
            blocks.append(with_common_columns(plain, on_carrier))
        return blocks

    def _balance(
        self,
        r: int,
        g: GearRun,
        now: Law,
        chosen: Sequence[Function],
        wanted: Sequence[str] | None = None,
    ) -> Block:
        """Torque balance of run ``g``, number r, about the law ``now``; see ``balance.block``."""
        return torque_balance.block(
            g, now, self.modelled, self.body_functions, chosen, self._quadrature[r], wanted
        )

    def law_of(
        self, m: MeshMotion, amplitudes: Mapping[str, Array], wanted: Sequence[str] | None = None
    ) -> Law:
        """Evaluate the force law at a motion of a run, with functions at amplitudes (n_mesh,).

        Args:
            wanted: functions whose columns will be formed; None: all.
        """
        return law(m, self.change_of(m, amplitudes, wanted))

    def change_of(
        self, m: MeshMotion, amplitudes: Mapping[str, Array], wanted: Sequence[str] | None = ()
    ) -> LawChange:
        """Change of the law at a motion by functions at amplitudes (n_mesh,); see ``law_of``.

        Moving parts are integrated at the motion as recorded, even if ``m`` is that of a run with
        corrected motion sensors; only windows integrate them at ``m``.
        """
        r = self.number_of.get(m.name)
        between = None if r is None or not self._changes.parts else self.runs[r].dense
        return self._changes.evaluated(m, m if self.uses_windows else between, amplitudes, wanted)

    def linear_observations(self, amplitudes: Amplitudes) -> tuple[str, ...]:
        """Consistency; balance, if all forces are recorded, no motion sensor error is corrected.

        See ``diagnosis.machine.Machine``. No balance either where ``exact_forces``.
        """
        motion = any(np.any(a) for a in amplitudes.get(consistency.NAME, {}).values())
        if motion or self.modelled.any() or self.exact_forces:
            return (consistency.NAME,) if self.n_relations else ()
        known = (torque_balance.NAME,) if self.has_balance else ()
        return (*known, consistency.NAME) if self.n_relations else known

    def blocks(
        self,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
        observations: Sequence[str],
    ) -> list[dict[str, Block]]:
        """Blocks of all runs about amplitudes; see ``diagnosis.machine.Machine.blocks``."""
        return parallel_map(
            lambda r: self._blocks(r, amplitudes, wanted, observations), range(len(self.runs))
        )

    def _blocks(
        self,
        r: int,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
        observations: Sequence[str],
    ) -> dict[str, Block]:
        """Blocks of run r, by observation."""
        blocks: dict[str, Block] = {}
        relations = self.relations[r] if consistency.NAME in observations else None
        if relations is not None:
            blocks[consistency.NAME] = linear_block_at(
                relations, amplitudes.get(consistency.NAME, {}), r, wanted
            )
        if trajectory.NAME in observations and self.has_windows_of(r):
            blocks[trajectory.NAME] = self._trajectory_block(r, amplitudes, wanted)
        if not {force_law.NAME, torque_balance.NAME} & set(observations):
            return blocks
        g = self.corrected_run(r, amplitudes.get(consistency.NAME, {}))
        of_law = {f: a[r] for f, a in amplitudes.get(force_law.NAME, {}).items()}
        chosen = self.law_functions
        if wanted is not None:
            used = {*wanted.get(force_law.NAME, ()), *SHAFT_NAMES}
            chosen = tuple(f for f in chosen if f.name in used)
        law_columns = [f.name for f in chosen]
        if force_law.NAME in observations and self.has_force_law:
            now = self.law_of(g.strided, of_law, law_columns)
            blocks[force_law.NAME] = force_law.block(g.strided, now, self.model, chosen)
        if torque_balance.NAME in observations and self.has_balance and self.has_balance_of(r):
            # Functions of the law act through the forces already.
            direct = set(
                torque_balance.function_names(self.model, np.zeros_like(self.modelled), ())
            )
            direct |= {f.name for f in self.body_functions}
            given = amplitudes.get(torque_balance.NAME, {})
            of_balance = {name: a for name, a in given.items() if name in direct}
            gratings = [f"{f} of {j}" for f in SHAFT_NAMES for j in np.flatnonzero(self.modelled)]
            names = None
            if wanted is not None:
                names = [*wanted.get(torque_balance.NAME, ()), *of_balance, *gratings]
            cached = g is self.runs[r] and not self.modelled.any()
            if self.modelled.any():  # forces of the law, not those that sensors show
                of_law = {f: a for f, a in of_law.items() if not force_law.of_force_sensor(f)}
            full = (
                self._balances[r]
                if cached
                else self._balance(r, g, self.law_of(g.motion, of_law, law_columns), chosen, names)
            )
            if self.exact_forces and self._quadrature[r] is not None:
                full = torque_balance.with_quadrature(
                    full, self._quadrature_error(r, of_law), self._quadrature[r], g.run
                )
            blocks[torque_balance.NAME] = linear_block_at(full, of_balance, r, wanted)
        return blocks

    def _trajectory_block(
        self,
        r: int,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
    ) -> Block:
        """Trajectory block of run r, states fitted under the change."""
        names_of = self.functions if wanted is None else wanted
        names = names_of.get(trajectory.NAME, ())
        functions = [f.name for f in self.law_functions]
        if wanted is not None:
            used = {name.rpartition(" of ")[0] for name in names}
            functions = [name for name in functions if name in used]
        change_of = self._windows_change(r, amplitudes, functions)[0]
        solution = self.states(r, amplitudes)
        self._formed[r] = run_trajectory = self.trajectory_under(r, amplitudes)
        all_functions = (*self.law_functions, *self.body_functions)
        return run_trajectory.block(solution, change_of, all_functions, tuple(names))

    def states(self, r: int, amplitudes: Amplitudes) -> WindowSolution:
        """Fit the states of the windows of run r under a change."""
        run_trajectory = self.trajectory_under(r, amplitudes)
        change = self._windows_change(r, amplitudes)
        return run_trajectory.fitted_states(_functions_acting(r, amplitudes), *change)

    def states_anew(
        self, r: int, amplitudes: Amplitudes, remember_for: Sequence[Amplitudes] = ()
    ) -> WindowSolution | None:
        """States of run r from a new filter pass, see ``Trajectory.states_anew``.

        Args:
            remember_for: changes with the functions whose next fit starts from these states, too.
        """
        run_trajectory = self.trajectory_under(r, amplitudes)
        keys = [_functions_acting(r, change) for change in remember_for]
        return run_trajectory.states_anew(*self._windows_change(r, amplitudes), keys)

    def chi2_from(
        self, r: int, near: WindowSolution, amplitudes: Amplitudes, rounds: int
    ) -> float:
        """Chi2 of the windows of run r, states refitted under a change; inf where they diverge.

        Args:
            near: start states and trends to refit from.
            amplitudes: the change.
            rounds: largest number of Levenberg-Marquardt steps.

        Returns:
            ``WindowSolution.cost``: squares of residuals over their noise, and of jumps.
        """
        run_trajectory = self.trajectory_under(r, amplitudes)
        return run_trajectory.chi2_from(near, *self._windows_change(r, amplitudes), rounds)

    def _windows_change(
        self, r: int, amplitudes: Amplitudes, wanted: Sequence[str] = ()
    ) -> tuple[Callable[[MeshMotion], LawChange], dict[str, float], tuple[Function, ...]]:
        """Arguments of ``Trajectory.fitted_states`` for run r.

        Args:
            wanted: functions of the law whose columns will be formed.

        Returns:
            Change of the law by motion, amplitudes of functions on bodies and sensors, and the
            functions on the carrier.
        """
        of_law = {f: a[r] for f, a in amplitudes.get(force_law.NAME, {}).items()}
        names = {f.name for f in self.law_functions}
        other_amplitudes = {
            f: float(a[r][0])
            for f, a in amplitudes.get(trajectory.NAME, {}).items()
            if np.any(a[r]) and f.rpartition(" of ")[0] not in names
        }
        return (lambda m: self.change_of(m, of_law, wanted)), other_amplitudes, self.body_functions

    @property
    def parts(self) -> Mapping[str, MovingPart]:
        """Moving parts, by the label that prefixes their functions."""
        return self._changes.parts

    def with_functions(
        self,
        extra: Sequence[Function],
        on_bodies: Sequence[Function] = (),
        parts: Mapping[str, MovingPart] | None = None,
        about: Amplitudes | None = None,
    ) -> GearObservations:
        """Copy with additional functions.

        Args:
            extra: functions of the force law.
            on_bodies: forces on the carrier.
            parts: moving parts, by the label that prefixes their functions.
            about: amplitudes of the current fit, about which the forces of parts on the carrier
                are computed; None: as before.
        """
        gear = copy.copy(self)
        all_parts = {**self._changes.parts, **(parts or {})}
        gear._changes = LawChanges(self.model, (*self.law_functions, *extra), all_parts)
        gear.body_functions = (*self.body_functions, *on_bodies)
        gear._part_amplitudes = self._part_amplitudes if about is None else about
        for name in ("functions", "_balances"):
            gear.__dict__.pop(name, None)
        return gear

    def regression_inputs(self, observation: str, r: int, block: Block) -> RegressionInputs:
        """Inputs of the flexible regression for the rows of a block of run r."""
        if observation == trajectory.NAME:
            return self._formed[r].regression_inputs(block, self.law_functions)
        g = self.runs[r]
        cycles = (1.0, *force_law.cycles_per_member_turn(self.model).values())
        if observation == force_law.NAME:
            return about_meshes(g.strided, cycles, block)
        own: Sequence[Array] = (g.fused.z, g.fused.z_rate)
        relations = self.relations[r]
        if observation == consistency.NAME and relations is not None:
            own = consistency.dominant_channels(relations)
        return about_rows(g.motion, own, cycles, block)


def _functions_acting(r: int, amplitudes: Amplitudes) -> tuple[str, ...]:
    """Names of the functions with an amplitude in the windows of run r."""
    return tuple(sorted(f for f, a in amplitudes.get(trajectory.NAME, {}).items() if np.any(a[r])))


SHAFT_NAMES = tuple(f"shaft {s} 1 {trig}" for s in "scp" for trig in ("cos", "sin"))
