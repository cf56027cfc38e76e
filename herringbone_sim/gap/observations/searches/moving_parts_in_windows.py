"""Grid search for moving parts in windows of the motion.

The displacement of a part follows from the motion by ``hypotheses.moving_part_motion``. The change
of the mesh forces by it acts through the linear response of the windows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import qmc

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.machine import Amplitudes
from herringbone_sim.diagnosis.parallel import forked_map
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.diagnosis.score import Score
from herringbone_sim.diagnosis.search import CHANCE_CHI2
from herringbone_sim.gap.observations import force_law
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.hypotheses.moving_parts import MovingPart, pin_meshes
from herringbone_sim.gap.observations.searches.moving_part_grid import (
    PartTrial,
    RowChange,
    TrialRun,
    best_parts,
)
from herringbone_sim.gap.observations.windows import trajectory
from herringbone_sim.gap.observations.windows.columns import responses
from herringbone_sim.gap.residuals.mesh_law import law


def proposals(gear: GearObservations, amplitudes: Amplitudes, known: Score) -> list[MovingPart]:
    """Moving parts that remove most chi2 of the windows; see ``moving_part_grid.proposals``."""
    return best_parts(WindowPartTrial(gear, amplitudes, known), CHANCE_CHI2)


# Search for better parameters of a part; chosen for run time.
N_SEARCHED, N_REFINED = 64, 3  # points tried, and those improved by a local search
SEARCH_RANGE = 10.0  # largest factor on a parameter
ALIKE = 1.15  # factor on clearance or stiffness within which parts are taken as one


class WindowPartTrial(PartTrial):
    """Evaluation of the chi2 that a part removes, linear about the states of a fit.

    Args:
        gear: with its runs.
        amplitudes: of the functions in the fit.
        known: the fit.
        present: moving part of the fit that others replace, its coefficients the last ones of
            ``known``; None: the fit has none.
    """

    def __init__(
        self,
        gear: GearObservations,
        amplitudes: Amplitudes,
        known: Score,
        present: MovingPart | None = None,
    ) -> None:
        self._present = present
        self._label = next((x for x, part in gear.parts.items() if part is present), "")
        if present is not None:
            own = len(known.coefficients) - 1 - len(present.names)
            offsets = known.mean[own + 1 :]
            self._present = present.with_log_offsets(offsets)
            known = replace(known, coefficients=known.coefficients[:own], mean=known.mean[:own])
            self.every = 1
        super().__init__(gear, amplitudes, known)

    def improved(self) -> list[MovingPart]:
        """Parts with other parameters that remove most chi2: optima of a search about the fit.

        The search starts from the part in the fit and from the best of ``N_SEARCHED`` points
        within ``SEARCH_RANGE`` of it. Optima are left out where another's parameters are within
        ``ALIKE``, and, but for the best, where they remove less than the part in the fit.
        """
        assert self._present is not None
        points = qmc.Sobol(len(self._present.names), seed=0).random(N_SEARCHED)
        offsets = np.log(SEARCH_RANGE) * (2.0 * points - 1.0)
        parts = [self._present.with_log_offsets(offset) for offset in offsets]
        gains = np.array(forked_map(self.gain, parts))
        starts = [self._present, *(parts[i] for i in np.argsort(-gains)[:N_REFINED])]
        optima: list[MovingPart] = []
        for part in sorted(forked_map(self.refined, starts), key=lambda s: -s.measured_gain):
            if optima and part.measured_gain < 0.0:
                break
            ratios = [np.divide(part.theta[:2], other.theta[:2]) for other in optima]
            if all(np.max(np.abs(np.log(ratio))) > np.log(ALIKE) for ratio in ratios):
                optima.append(part)
        return optima

    def _observations(self) -> Sequence[str]:
        return [trajectory.NAME]

    def _run(self, r: int, blocks: Mapping[str, Block]) -> TrialRun:
        _, _, m = self.gear.trajectory_under(r, self._amplitudes).last_linearisation
        of_law = {f: a[r] for f, a in self._amplitudes.get(force_law.NAME, {}).items()}
        if self._label:
            head = f"{self._label} "
            of_law = {f: a for f, a in of_law.items() if not f"{f} ".startswith(head)}
        change = self.gear.change_of(m, of_law)
        return TrialRun(r, m, change, m, change, np.arange(len(m.times)), blocks)

    def _rows(self, run: TrialRun, part: MovingPart) -> Iterator[RowChange]:
        """Yield the row of the windows without and with the part, states projected out."""
        model = self.gear.model
        run_trajectory = self.gear.trajectory_under(run.number, self._amplitudes)
        s, solution = run_trajectory.windows, run_trajectory.last_linearisation[0]
        drive = self._drive(run, part)
        at = np.flatnonzero(drive.meshes_mask.any(axis=0))
        parts = [part] if self._present is None else [part, self._present]
        q, *before_it = drive.motions(parts)
        present = before_it[0] if before_it else np.zeros_like(q)
        reach = -model.scales.cos_beta * drive.meshes_mask

        def force(q: Array) -> Array:
            """Mesh forces with the part displaced by q."""
            change = replace(
                run.change,
                d=run.change.d + q[:, :, 0] @ reach,
                d_rate=run.change.d_rate + q[:, :, 1] @ reach,
            )
            return law(run.strided, change).force

        forces = (force(q) - force(present))[:, at]
        directions, on_meshes = -s.inverse_masses * s.G[at], np.eye(len(s.G))[at]
        if part.effect == "bearing_clearance":
            _, mass = pin_meshes(model, part.locus)
            push = -mass * np.gradient((q - present)[:, 0, 1], run.strided.times)
            forces = np.column_stack([forces, push])
            directions = np.vstack(
                [directions, s.inverse_masses * np.eye(len(s.inverse_masses))[2]]
            )
            on_meshes = np.vstack([on_meshes, np.zeros(len(s.G))])
        size = forces[s.first_half_step[:, None] // 2 + np.arange(s.steps_per_window + 1)]
        pushed = responses(s, solution, directions, size, on_meshes).sum(axis=1)
        block = run.blocks[trajectory.NAME]
        weight = np.sqrt(block.independent_share) / block.sigma[:, 0]
        before = block.residual[:, 0] * weight
        after = before - run_trajectory.last_elimination.clear(pushed[:, None])[:, 0] * weight
        yield trajectory.NAME, 0, before, after, np.ones(len(before))
