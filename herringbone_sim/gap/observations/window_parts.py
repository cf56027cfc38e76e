"""Grid search for moving parts in windows of the motion.

The displacement of a part follows from the motion by ``seat_motion``. The change of the mesh
forces by it acts through the linear response of the windows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from herringbone_sim.diagnosis.machine import Amplitudes
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.diagnosis.score import Score
from herringbone_sim.gap.observations import force_law, trajectory
from herringbone_sim.gap.observations.gear import Gear
from herringbone_sim.gap.observations.law import law
from herringbone_sim.gap.observations.seat_grid import PartTrial, RowChange, TrialRun, best_seats
from herringbone_sim.gap.observations.seats import Seat, pin_meshes
from herringbone_sim.gap.observations.window_columns import responses


def proposals(gear: Gear, amplitudes: Amplitudes, known: Score) -> list[Seat]:
    """Moving parts that remove most chi2 of the windows; see ``seat_grid.proposals``."""
    return best_seats(WindowPartTrial(gear, amplitudes, known))


class WindowPartTrial(PartTrial):
    """Evaluation of the chi2 that a part removes, linear about states fitted without it."""

    def _observations(self) -> list[str]:
        return [trajectory.NAME]

    def _run(self, r: int, blocks: Mapping[str, Block]) -> TrialRun:
        _, _, m = self.gear.trajectory_under(r, self._amplitudes).last_linearisation
        of_law = {f: a[r] for f, a in self._amplitudes.get(force_law.NAME, {}).items()}
        change = self.gear.change_of(m, of_law)
        return TrialRun(r, m, change, m, change, np.arange(len(m.times)), blocks)

    def _rows(self, run: TrialRun, seat: Seat) -> Iterator[RowChange]:
        """Yield the row of the windows without and with the part, states projected out."""
        model = self.gear.model
        run_trajectory = self.gear.trajectory_under(run.number, self._amplitudes)
        s, solution = run_trajectory.windows, run_trajectory.last_linearisation[0]
        drive = self._drive(run, seat)
        at = np.flatnonzero(drive.meshes_mask.any(axis=0))
        (q,) = drive.motions([seat])
        reach = -model.scales.cos_beta * drive.meshes_mask
        change = replace(
            run.change,
            d=run.change.d + q[:, :, 0] @ reach,
            d_rate=run.change.d_rate + q[:, :, 1] @ reach,
        )
        forces = (law(run.strided, change).force - law(run.strided, run.change).force)[:, at]
        directions, on_meshes = -s.inverse_masses * s.G[at], np.eye(len(s.G))[at]
        if seat.effect == "bearing_clearance":
            _, mass = pin_meshes(model, seat.locus)
            push = -mass * np.gradient(q[:, 0, 1], run.strided.times)
            forces = np.column_stack([forces, push])
            directions = np.vstack(
                [directions, s.inverse_masses * np.eye(len(s.inverse_masses))[2]]
            )
            on_meshes = np.vstack([on_meshes, np.zeros(len(s.G))])
        size = forces.T[:, s.first_half_step[:, None] // 2 + np.arange(s.steps_per_window + 1)]
        pushed = responses(s, solution, directions, size, on_meshes).sum(axis=1)
        block = run.blocks[trajectory.NAME]
        weight = np.sqrt(block.independent_share) / block.sigma[:, 0]
        before = block.residual[:, 0] * weight
        after = before - run_trajectory.last_elimination.clear(pushed[:, None])[:, 0] * weight
        yield trajectory.NAME, 0, before, after, np.ones(len(before))
