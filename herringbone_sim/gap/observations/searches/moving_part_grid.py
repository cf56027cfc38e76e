"""Grid search for moving parts: chi2 that a flexible ring or loose pin would remove."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.coefficients import CampaignProducts, functions_used
from herringbone_sim.diagnosis.machine import Amplitudes
from herringbone_sim.diagnosis.parallel import forked_map, parallel_map
from herringbone_sim.diagnosis.products import Block, products
from herringbone_sim.diagnosis.regression import solve
from herringbone_sim.diagnosis.score import Score
from herringbone_sim.diagnosis.search import MIN_GAIN_PER_VALUE
from herringbone_sim.effects.effect import Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.gap.observations import force_law, torque_balance
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.hypotheses.moving_parts import MovingPart, PartDrive
from herringbone_sim.gap.residuals.mesh_law import LawChange, MeshMotion, law, select_meshes
from herringbone_sim.gap.residuals.torque_balance import inertia_parts, window_of

# Grids of stiffness and clearance, chosen; later fits may depart from a point by 1.5 decades, see
# ``parts.MAX_LOG_OFFSET``.
RING_N_PER_M = np.geomspace(3e8, 3e11, 13)
SEATS_N_PER_M = np.geomspace(1e10, 1e12, 3)
CLEARANCES_M = np.geomspace(5e-7, 5e-5, 7)
RING_RATIO, SEAT_RATIO = 0.05, 0.1  # damping ratios, start values of the catalogue
# Values of ``softness`` (see ``MovingPart``), chosen; a soft seat is nearly linear.
HARD_END, SOFT_END = 0.05, 0.5
START_GROWTH = 0.3  # value of ``growth`` and ``drag`` (see ``MovingPart``), chosen; ``film`` is 1
MAX_TRIALS = 60  # evaluations of the local search, chosen for run time
# Fraction of the smallest relevant gain below which the best part of the grids is not refined; for
# run time. Refinement multiplies the gain of a part that is there by less than two. A part that is
# not there may imitate another effect once refined, which is no loss.
MIN_REFINED_SHARE = 0.1

Grid = list[tuple[float, ...]]  # values of ``MovingPart.theta``
GRIDS: tuple[tuple[str, Grid], ...] = (
    (
        "ring_flexibility",
        [(k, RING_RATIO, START_GROWTH, START_GROWTH) for k in RING_N_PER_M.tolist()],
    ),
    (
        "bearing_clearance",
        [
            (b, k, SEAT_RATIO, HARD_END, START_GROWTH, 1.0)
            for b in CLEARANCES_M.tolist()
            for k in SEATS_N_PER_M.tolist()
        ],
    ),
    (
        "bearing_clearance",
        [(1e-5, k, SEAT_RATIO, SOFT_END, START_GROWTH, 1.0) for k in SEATS_N_PER_M.tolist()],
    ),
)


def proposals(gear: GearObservations, amplitudes: Amplitudes, known: Score) -> list[MovingPart]:
    """Return the moving part of each of ``GRIDS`` that removes most chi2 from a gear's runs.

    Args:
        amplitudes: of the functions in the current fit.
        known: the current fit.

    Returns:
        One part a grid, see ``best_parts``; empty where motion between samples is unknown.
    """
    if any(g.dense is None for g in gear.runs):
        return []
    least = MIN_REFINED_SHARE * MIN_GAIN_PER_VALUE * known.count
    return best_parts(PartTrial(gear, amplitudes, known), least)


def best_parts(trial: PartTrial, least_refined: float) -> list[MovingPart]:
    """Return the moving part of each of ``GRIDS`` that removes most chi2, as evaluated by a trial.

    All points of a grid are tried at the places with most meshes (both sides of the gear), then
    the best point at every place inside the best of these. The best part of all grids is refined
    by a local search if it removes at least ``least_refined``.
    """
    layout = trial.gear.model.layout
    best_by_grid = []
    for effect, grid in GRIDS:
        places = list(known_effects()[effect].candidates(layout))
        size = {place: float(place.mask(layout).sum()) for place in places}
        largest = [place for place in places if size[place] == max(size.values())]
        parts = [MovingPart(effect, place, theta) for place in largest for theta in grid]
        best = trial.best(parts)
        inside = best.locus.mask(layout) > 0.0
        inner = [p for p in places if np.all(inside[p.mask(layout) > 0.0])]
        best = trial.best([replace(best, locus=p) for p in inner])
        best_by_grid.append(trial.evaluated(best))
    first = max(best_by_grid, key=lambda part: part.measured_gain)
    if first.measured_gain < least_refined:
        return best_by_grid
    return [trial.refined(part) if part is first else part for part in best_by_grid]


# Observation, number of the row, whitened residuals (n,) without and with a moving part, and
# factors (n,) that rescale whitened columns of the block to the noise of these residuals.
RowChange = tuple[str, int, Array, Array, Array]


@dataclass(frozen=True)
class TrialRun:
    """A run prepared for trying moving parts: its motion and force law in the current fit.

    Attributes:
        number: number of the run in ``GearObservations.runs``.
        strided: motion at the samples at which forces are compared.
        change: change of the law at ``strided``.
        dense: motion at finer equal steps, on which a moving part is integrated.
        between: change of the law at ``dense``.
        sample_index: index in ``dense`` of each sample of ``strided``.
        blocks: by observation, about the current fit, with columns of its functions.
    """

    number: int
    strided: MeshMotion
    change: LawChange
    dense: MeshMotion
    between: LawChange
    sample_index: NDArray[np.int64]
    blocks: Mapping[str, Block]


class PartTrial:
    """Evaluation of the chi2 that a moving part removes from some runs of a gear.

    The coefficients of the current fit are refitted linearly with each part.

    Args:
        amplitudes: of the functions in the current fit.
        known: the current fit.

    Attributes:
        every: 2 if every second run is used, for run time.
    """

    every = 2

    def __init__(self, gear: GearObservations, amplitudes: Amplitudes, known: Score) -> None:
        self.gear, self._amplitudes = gear, amplitudes
        looked = range(0, len(gear.runs), self.every)
        self._known = known.coefficients
        blocks = gear.blocks(amplitudes, functions_used(self._known), self._observations())
        run_products = [{o: products(b) for o, b in run_blocks.items()} for run_blocks in blocks]
        campaign = CampaignProducts(run_products, self._known)
        self._A = campaign.base_A[list(looked)].sum(axis=0)
        self._b = campaign.base_b[list(looked)].sum(axis=0)
        self._sd = np.array([c.sd for c in self._known]) * np.sqrt(len(gear.runs) / len(looked))
        self._bound = np.array([c.bound for c in self._known])
        self._start = known.mean - np.array([c.center for c in self._known])
        self._runs = [self._run(r, blocks[r]) for r in looked]
        self._drives: dict[tuple[str, Locus, int], PartDrive] = {}
        self._columns: dict[tuple[int, str, int], Array] = {}

    def _observations(self) -> Sequence[str]:
        """Names of the observations to which the coefficients are refitted."""
        return self.gear.observation_names

    def _run(self, r: int, blocks: Mapping[str, Block]) -> TrialRun:
        """Motion of run r and change of its law in the current fit."""
        some, dense = self.gear.runs[r].strided, self.gear.runs[r].dense
        assert dense is not None
        of_law = {f: a[r] for f, a in self._amplitudes.get(force_law.NAME, {}).items()}
        at = np.rint((some.times - dense.times[0]) / (dense.times[1] - dense.times[0]))
        changes = self.gear.change_of(some, of_law), self.gear.change_of(dense, of_law)
        return TrialRun(r, some, changes[0], dense, changes[1], at.astype(int), blocks)

    def gain(self, part: MovingPart) -> float:
        """Chi2, with the prior, that a part removes from the runs used; coefficients refitted."""
        return self._gain_and_refit([list(self._rows(run, part)) for run in self._runs])[0]

    def _gain_with_threads(self, part: MovingPart) -> tuple[float, Array]:
        """``_gain_and_refit`` of a part, its runs in parallel."""
        rows = parallel_map(lambda run: list(self._rows(run, part)), self._runs)
        return self._gain_and_refit(rows)

    def _gain_and_refit(self, rows: Sequence[Sequence[RowChange]]) -> tuple[float, Array]:
        """``gain`` of a part, and the refitted coefficients minus their prior means (p,).

        ``rows``: those of each run that the part changes.
        """
        fall, b = 0.0, np.zeros(len(self._known))
        for run, of_run in zip(self._runs, rows, strict=True):
            for o, row, before, after, weight in of_run:
                fall += float(before @ before - after @ after)
                b += self._base_columns(run, o, row).T @ (weight * (after - before))
        b = self._b + b
        followed = solve(self._A, b + self._A @ self._start, self._sd, self._bound).mean
        step = followed - self._start
        fall += float(2.0 * b @ step - step @ self._A @ step)
        fall -= float(np.sum((followed / self._sd) ** 2 - (self._start / self._sd) ** 2))
        return fall, followed

    def best(self, parts: Sequence[MovingPart]) -> MovingPart:
        """MovingPart with the largest ``gain``; all are evaluated in parallel."""
        for run, part in product(self._runs, parts):
            self._drive(run, part)  # kept for all parts of a place
        return parts[int(np.argmax(forked_map(self.gain, parts)))]

    def evaluated(self, part: MovingPart) -> MovingPart:
        """Copy of a part with ``load``, the largest over the runs used, and its evaluation there.

        It gives ``measured_gain``, scaled to all runs, and ``base_mean``, refitted coefficients.
        """
        part = replace(part, load=max(self._drive(run, part).load for run in self._runs))
        fall, followed = self._gain_with_threads(part)
        known = followed + np.array([c.center for c in self._known])
        whole = fall * len(self.gear.runs) / len(self._runs)
        return replace(part, measured_gain=whole, base_mean=tuple(known.tolist()))

    def refined(self, part: MovingPart) -> MovingPart:
        """Improve the parameters by a Nelder-Mead search over their logarithms; evaluated copy."""
        n = len(part.names)
        optimum = minimize(
            lambda offsets: -self._gain_with_threads(part.with_log_offsets(offsets))[0],
            np.zeros(n),
            method="Nelder-Mead",
            options={
                "maxfev": MAX_TRIALS,
                "initial_simplex": np.vstack([np.zeros(n), 0.5 * np.eye(n)]),
            },
        )
        return self.evaluated(part.with_log_offsets(optimum.x))

    def _drive(self, run: TrialRun, part: MovingPart) -> PartDrive:
        """Meshes and forces that drive the part in a run, cached by effect, locus and run."""
        key = part.effect, part.locus, run.number
        if key not in self._drives:
            model, motion = self.gear.model, (run.dense, run.between)
            self._drives[key] = PartDrive(model, part.locus, part.effect, *motion)
        return self._drives[key]

    def _rows(self, run: TrialRun, part: MovingPart) -> Iterator[RowChange]:
        """Yield rows of force law and balance that a part changes, without and with the part.

        The inertia force of a pin on the carrier is left out: it changes ``gain`` by about 1 %.
        """
        gear = self.gear
        at = np.flatnonzero(part.locus.mask(gear.model.layout) > 0.0)
        m, change = select_meshes(run.strided, run.change, at)
        before = law(m, change)
        drive = self._drive(run, part)
        reach = -gear.model.scales.cos_beta * drive.meshes_mask[:, at]
        (q,) = drive.motions([part])[:, run.sample_index]
        ch = replace(change)
        ch.d, ch.d_rate = ch.d + q[:, :, 0] @ reach, ch.d_rate + q[:, :, 1] @ reach
        now = law(m, ch)
        for i in np.flatnonzero(~gear.modelled[at]).tolist():
            # The larger noise of both, so that no coefficient removes more than there is.
            sigma = np.maximum(before.sigma[:, i], now.sigma[:, i])
            without, left = m.F[:, i] - before.force[:, i], m.F[:, i] - now.force[:, i]
            weight = before.sigma[:, i] / sigma
            yield force_law.NAME, int(at[i]), without / sigma, left / sigma, weight
        block = run.blocks.get(torque_balance.NAME)
        if block is None or not gear.modelled[at].any():
            return
        more = np.where(gear.modelled[at], now.force - before.force, 0.0)
        yield from self._balance_rows(run, block, more, at)

    def _balance_rows(
        self, run: TrialRun, block: Block, more: Array, at: NDArray[np.int64]
    ) -> Iterator[RowChange]:
        """Yield rows of the balance without and with forces ``more`` (n, k) [N] on meshes."""
        g = self.gear.runs[run.number]
        look = window_of(g.run)
        whole = np.arange(len(g.motion.times))
        steps = np.arange(len(more)) * self.gear.stride
        forces = np.stack([np.interp(whole, steps, f) for f in more.T], axis=1)
        reach = inertia_parts(self.gear.model).sum(0)[:, at]
        pushed = look.average(forces)[:: max(1, round(look.deviation))] @ reach.T
        weight = np.sqrt(block.independent_share) / block.sigma
        for row in np.flatnonzero(np.any(reach != 0.0, axis=1)).tolist():
            without = block.residual[:, row] * weight[:, row]
            left = without - pushed[:, row] * weight[:, row]
            yield torque_balance.NAME, row, without, left, np.ones(len(left))

    def _base_columns(self, run: TrialRun, o: str, row: int) -> Array:
        """(n, p) whitened columns of the coefficients of the current fit in one row, cached."""
        key = run.number, o, row
        if key not in self._columns:
            block = run.blocks[o]
            of_functions = dict(zip(block.functions, block.columns_of(row).T, strict=True))
            columns = np.zeros((len(block.residual), len(self._known)))
            for i, c in enumerate(self._known):
                for entry_row, f, w in c.placements[o].entries if o in c.placements else ():
                    if entry_row == row:
                        columns[:, i] += w[run.number] * of_functions[f]
            weight = np.sqrt(block.independent_share) / block.sigma[:, row]
            self._columns[key] = columns * weight[:, None]
        return self._columns[key]
