"""Steady-state motions of many gears from many starts; finished runs are cached in a folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from herringbone_sim.arrays import Array, Flags, Indices
from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.model import Model, with_added_states
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.flow import effect_cycles
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.gear import acting
from herringbone_sim.effects.written import effects_text
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.array_cache import ArrayCache
from herringbone_sim.sweeps.chunks import Chunk, ChunkRunner
from herringbone_sim.sweeps.observe import asymmetries, contact_loss
from herringbone_sim.sweeps.periods import find_periods

CHUNK = 128  # runs that are stored together
ALIKE = 0.01  # b_c, RMS left-right difference up to which the halves count as moving alike
LEAST_EXPONENT = 2e-3  # per tau; a smaller one counts as 0


@dataclass(frozen=True)
class RunSettings:
    """Length of a run, and what is computed of its motion.

    Attributes:
        transient: mesh cycles discarded first.
        cycles: periods of the effects observed then (mesh cycles without effects); a period of
            the motion is found if it repeats 5 times in them.
        exponents: whether to compute Lyapunov exponents.
        max_period: largest period sought, in periods of the effects.
    """

    transient: int = 800
    cycles: int = 100
    exponents: bool = False
    max_period: int = 16

    def over(self, period: int) -> RunSettings:
        """Settings with ``cycles``, ``max_period`` in mesh cycles, for effects of this period."""
        return replace(self, cycles=self.cycles * period, max_period=self.max_period * period)


@dataclass(frozen=True)
class Motions:
    """Steady-state motions of n runs; arrays (n,), NaN if failed or not computed.

    Attributes:
        period: mesh cycles, 0 = aperiodic.
        exponent, exponent_error: largest Lyapunov exponent per tau and its standard error.
        within, transverse: largest exponents per tau of perturbations that keep left = right, and
            of left-right differences.
        asymmetry: RMS left-right difference of the section points, b_c.
        contact_loss: 0 = never, 1 = on one flank, 2 = on both flanks of some mesh.
        apart: fraction of the time without contact, mean of the meshes.
        end: (n, n_state) final states, at phase 0, with those that effects add.
    """

    period: Array
    exponent: Array
    exponent_error: Array
    within: Array
    transverse: Array
    asymmetry: Array
    contact_loss: Array
    apart: Array
    end: Array

    def repeats(self, cycles: int) -> Flags:
        """(n,) whether each motion repeats after a number of mesh cycles, see ``repeats``."""
        return repeats(self.period, cycles)

    @property
    def alike(self) -> Flags:
        """(n,) whether the RMS left-right difference is below 0.01 b_c."""
        return np.asarray(self.asymmetry < ALIKE, dtype=bool)


NAMES = tuple(item.name for item in fields(Motions))


def repeats(period: Array, cycles: int | Indices) -> Flags:
    """Whether motions repeat after some mesh cycles: P1 also after 2, an aperiodic one never.

    Args:
        period: of the motions in mesh cycles, 0 = aperiodic, NaN = failed.
        cycles: number of mesh cycles, one or in a shape like that of ``period``; where it is 0,
            no motion repeats.

    Returns:
        Flags in the shape of ``period``.
    """
    periodic = (period > 0) & (cycles > 0)
    divides = np.mod(cycles, np.where(periodic, period, 1.0)) == 0.0
    return np.asarray(periodic & divides, dtype=bool)


class MotionRunner:
    """Integrates gears with the same effects on threads and caches their motions in a folder.

    Args:
        folder: created if missing; None caches nothing.
        workers: number of threads.
        bar: counts the runs, see ``ChunkRunner``.
        actives: effects of every gear.

    Raises:
        AnalysisError: the folder can't be written.
    """

    def __init__(
        self,
        folder: Path | None = None,
        workers: int = 2,
        bar: tqdm | None = None,
        actives: Sequence[Active] = (),
    ) -> None:
        self._chunks = ChunkRunner(ArrayCache(folder), workers, bar)
        self._actives = acting(actives)

    def build(self, parameters: Parameters) -> Model:
        """The model of a gear; ParameterError if it can't be built."""
        return build_with(parameters, self._actives)

    def effect_period(self, parameters: Parameters) -> int:
        """Period of the effects of a gear in mesh cycles; 1 without effects."""
        return effect_cycles(self.build(parameters))

    def run(self, sets: Sequence[Parameters], starts: Array, settings: RunSettings) -> Motions:
        """Integrate n gears of one layout, and describe their motions.

        Args:
            sets: n parameter sets.
            starts: (n, n_state) states at phase 0; a row of NaN counts as a failed run; states
                that effects add are at rest if left out.
            settings: length of the runs.
        """
        built = next((model for model in map(self.built, sets) if model is not None), None)
        starts = with_added_states(built, starts) if built else starts
        slices = [slice(i, i + CHUNK) for i in range(0, len(sets), CHUNK)]
        chunks = [self._chunk(sets[rows], starts[rows], settings) for rows in slices]
        return Motions(**self._chunks.arrays([chunks])[0])

    def _chunk(self, sets: Sequence[Parameters], starts: Array, settings: RunSettings) -> Chunk:
        key = [NAMES, sets, effects_text(self._actives), starts, settings]
        return Chunk(key, lambda: vars(self._motions(sets, starts, settings)), len(sets))

    def _motions(
        self, sets: Sequence[Parameters], starts: Array, settings: RunSettings
    ) -> Motions:
        """Motions of one chunk; NaN for a gear that can't be built or has no start."""
        motions = _empty(len(sets), starts.shape[1])
        models = {
            i: model
            for i, model in enumerate(map(self.built, sets))
            if model is not None and np.isfinite(starts[i]).all()
        }
        if models:
            rows = np.array(list(models), dtype=np.int64)
            period = self.effect_period(sets[int(rows[0])])
            _fill(motions, rows, list(models.values()), starts[rows], settings.over(period))
        return motions

    def built(self, parameters: Parameters) -> Model | None:
        """The model of a gear; None if it can't be built."""
        try:
            return self.build(parameters)
        except ParameterError:
            return None


def _fill(
    motions: Motions, rows: Indices, models: Sequence[Model], starts: Array, settings: RunSettings
) -> None:
    """Integrate gears and write their motions into the given rows of ``motions``."""
    length = (settings.transient, settings.cycles, settings.cycles, settings.exponents)
    batch = run_batch(models, starts, *length).of_gear(models[0].layout)
    motions.period[rows] = find_periods(batch.sections, settings.max_period)
    for name in ("exponent", "exponent_error"):
        getattr(motions, name)[rows] = getattr(batch, f"{name}s")
    motions.within[rows], motions.transverse[rows] = batch.within, batch.transverse
    motions.asymmetry[rows] = asymmetries(batch.sections)
    motions.contact_loss[rows] = contact_loss(batch.contact)
    motions.apart[rows] = batch.contact[:, :, 1].mean(axis=1)
    motions.end[rows] = batch.end


def _empty(n: int, n_state: int) -> Motions:
    return Motions(**{m: np.full((n, n_state) if m == "end" else n, np.nan) for m in NAMES})
