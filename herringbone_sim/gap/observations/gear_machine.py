"""The gear as a machine of the diagnosis engine: observations, tolerances and catalogue."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.diagnosis.coefficients import amplitudes
from herringbone_sim.diagnosis.flexible import RegressionInputs
from herringbone_sim.diagnosis.machine import A, Amplitudes, B, Hypothesis, Machine
from herringbone_sim.diagnosis.parallel import forked_map
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.diagnosis.score import Score
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations import force_law
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.hypotheses import damaged_teeth
from herringbone_sim.gap.observations.hypotheses import meshes as mesh_hypotheses
from herringbone_sim.gap.observations.hypotheses.coefficients import CoefficientBuilder
from herringbone_sim.gap.observations.hypotheses.damaged_teeth import Event
from herringbone_sim.gap.observations.hypotheses.moving_parts import MovingPart
from herringbone_sim.gap.observations.hypotheses.tolerances import tolerances
from herringbone_sim.gap.observations.recorded_channels import FittedInParallel
from herringbone_sim.gap.observations.searches import (
    damaged_teeth_in_windows,
    moving_part_grid,
    moving_parts_in_windows,
    planet_permutations,
    trials_in_windows,
)
from herringbone_sim.gap.observations.windows import trajectory
from herringbone_sim.gap.observations.windows.windows import MORE_WINDOWS, window_samples


class GearMachine:
    """Implements ``diagnosis.machine.Machine`` for a gear."""

    def __init__(self, gear: GearObservations) -> None:
        self.gear = gear
        self.builder = CoefficientBuilder(gear)
        self.base = tolerances(self.builder)
        self.rows: Mapping[str, int] = {o: self.builder.rows(o) for o in gear.functions}
        self.runs = len(gear.runs)

    @property
    def functions(self) -> Mapping[str, tuple[str, ...]]:
        return self.gear.functions

    def hypotheses(self) -> list[Hypothesis]:
        return list(mesh_hypotheses.hypotheses(self.builder))

    def proposals(
        self, amplitudes: Amplitudes, known: Score
    ) -> tuple[GearMachine, list[Hypothesis]]:
        """Damaged teeth, flexible rings and loose pins that the residual suggests."""
        if self.gear.uses_windows:
            proposed: list[Event | MovingPart] = [
                *damaged_teeth_in_windows.proposals(self.gear, amplitudes)
            ]
            proposed += moving_parts_in_windows.proposals(self.gear, amplitudes, known)
            return self.with_parts(proposed, amplitudes)
        if not (self.gear.has_force_law or self.gear.has_balance):
            return self, []
        proposed = [*damaged_teeth.proposals(self.gear, amplitudes)]
        proposed += moving_part_grid.proposals(self.gear, amplitudes, known)
        return self.with_parts(proposed, amplitudes)

    def improved(
        self, hypothesis: Hypothesis, amplitudes: Amplitudes, known: Score
    ) -> tuple[GearMachine, list[Hypothesis]]:
        """Search better parameters of a moving part in windows, about states fitted with it."""
        part = hypothesis.source
        if not self.gear.uses_windows or not isinstance(part, MovingPart):
            return self, []
        trial = moving_parts_in_windows.WindowPartTrial(self.gear, amplitudes, known, part)
        return self.with_parts(trial.improved(), amplitudes)

    def orders(self) -> tuple[list[Mapping[str, str]], NDArray[np.bool_]]:
        """Orders of the planets of both sides, in windows; see ``planet_permutations``."""
        functions = self.functions[trajectory.NAME]
        every = planet_permutations.orders(self.gear.model.layout)
        names: list[Mapping[str, str]] = [
            planet_permutations.renaming(self.gear.model.layout, o, functions) for o in every
        ]
        return names, planet_permutations.reorderable(self.gear)

    def reordered(self, choice: Sequence[int]) -> GearMachine:
        """Copy with the states of each run in one of ``orders``."""
        every = planet_permutations.orders(self.gear.model.layout)
        return self._in_orders([every[number] for number in choice])

    def _in_orders(self, orders: Sequence[Indices]) -> GearMachine:
        """Copy with the bodies of each run in an order."""
        machine = copy.copy(self)
        machine.gear = self.gear.reordered(orders)
        return machine

    def restarted_from_other_sizes(self, hypothesis: Hypothesis, fit: Score) -> Array | None:
        """Other start values of an effect in windows, see ``restart_from_other_sizes``."""
        tried = hypothesis.source is None and hypothesis.is_linear and hypothesis.vanishes_at_zero
        if not (self.gear.uses_windows and tried):
            return None
        return trials_in_windows.restart_from_other_sizes(self.gear, self.rows, hypothesis, fit)

    def ordered_for(self, hypotheses: Sequence[Hypothesis], mean: Array) -> GearMachine:
        """Copy with planets of runs that are not fitted yet in the order for an explanation.

        Args:
            hypotheses, mean: of the explanation, fitted to other runs of the rig.
        """
        if not self.gear.uses_windows:
            return self
        there, own = self.transferred(hypotheses)
        every = (*there.base, *(c for h in own for c in h.coefficients))
        made = amplitudes(every, mean, there.runs, there.rows)
        return self._in_orders(planet_permutations.best_orders(there.gear, made))

    def nonlinear_trials(
        self, ranked: Sequence[tuple[Hypothesis, Array]], known: Score
    ) -> list[tuple[float, Hypothesis, Array]]:
        """Nonlinear trials by fits of windows; none for other observations, as nearly linear."""
        if not self.gear.uses_windows:
            return []
        return trials_in_windows.nonlinear_trials(
            self.gear, self.rows, len(self.base), ranked, known
        )

    def with_parts(
        self, parts: Sequence[Event | MovingPart], about: Amplitudes | None = None
    ) -> tuple[GearMachine, list[Hypothesis]]:
        """Machine with the functions of some damaged teeth and moving parts, and their hypotheses.

        Args:
            about: see ``GearObservations.with_functions``.
        """
        labels = [f"part {next(self.gear.part_numbers)}" for _ in parts]
        every = [
            f
            for p, label in zip(parts, labels, strict=True)
            for f in p.functions(self.gear, label)
        ]
        machine = GearMachine(
            self.gear.with_functions(
                [f for f in every if f.slot != "body"],
                [f for f in every if f.slot == "body"],
                {x: p for p, x in zip(parts, labels, strict=True) if isinstance(p, MovingPart)},
                about,
            )
        )
        made = [
            p.hypothesis(machine.builder, label) for p, label in zip(parts, labels, strict=True)
        ]
        return machine, made

    def for_runs(self, runs: Sequence[PreparedRun]) -> GearMachine:
        """Machine of other runs of the rig, at every sample; see ``GearObservations.for_runs``."""
        return GearMachine(self.gear.for_runs(runs))

    def transferred(
        self, hypotheses: Sequence[Hypothesis]
    ) -> tuple[GearMachine, list[Hypothesis]]:
        """Rebuild hypotheses of another machine of the rig for the runs of this one.

        Returns:
            Copy of this machine with their functions, and the hypotheses in the order given.
        """
        machine, made = self.with_parts([h.source for h in hypotheses if h.source is not None])
        plain = [h for h in hypotheses if h.source is None]
        only = {h.effect for h in plain}
        known = {
            (h.effect, h.options, h.locus): h
            for h in (mesh_hypotheses.hypotheses(machine.builder, only) if plain else ())
        }
        rest = iter(made)
        return machine, [
            next(rest) if h.source is not None else known[h.effect, h.options, h.locus]
            for h in hypotheses
        ]

    @property
    def estimates_states(self) -> bool:
        return self.gear.uses_windows

    def fitted_in_parallel(self, fit: Callable[[Machine, A], B], items: Sequence[A]) -> list[B]:
        """See ``Machine``; what was fitted is remembered when all are."""

        def apart(item: A) -> tuple[B, FittedInParallel]:
            own = copy.copy(self)
            own.gear = self.gear.with_own_states()
            return fit(own, item), own.gear.states_since(self.gear)

        fits = forked_map(apart, items)
        for _, states in fits:
            self.gear.learn_states(states)
        return [result for result, _ in fits]

    def states_improve(self, amplitudes: Amplitudes) -> bool:
        return self.gear.states_improve(amplitudes)

    def with_more_values(self) -> GearMachine | None:
        """Machine with up to ``MORE_WINDOWS`` windows of a run; None where these are no more."""
        fitted = self.gear.windows
        longer = any(len(g.run) > (fitted + 1) * window_samples(g.run) for g in self.gear.runs)
        if not self.gear.uses_windows or fitted >= MORE_WINDOWS or not longer:
            return None
        return GearMachine(self.gear.with_windows(MORE_WINDOWS))

    def without_linearisation(self) -> GearMachine:
        if self.gear.uses_windows:
            return self
        machine = copy.copy(self)
        machine.gear = self.gear.without_linearisation()
        return machine

    def linear_observations(self, amplitudes: Amplitudes) -> tuple[str, ...]:
        return self.gear.linear_observations(amplitudes)

    def blocks(
        self,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
        observations: Sequence[str],
    ) -> list[dict[str, Block]]:
        return self.gear.blocks(amplitudes, wanted, observations)

    def regression_inputs(self, observation: str, r: int, block: Block) -> RegressionInputs:
        return self.gear.regression_inputs(observation, r, block)

    def cycles(self, observation: str, r: int) -> Array:
        if observation == trajectory.NAME:
            return self.gear.trajectory_of(r).cycles()
        g = self.gear.runs[r]
        phase = (g.strided if observation == force_law.NAME else g.motion).phase
        return np.asarray((phase - phase[0]) / (2.0 * np.pi))
