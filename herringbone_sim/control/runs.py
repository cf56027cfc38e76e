"""Many gears from many starts: what their motions are; done work is kept in a folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.model import Model
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.flow import effect_cycles
from herringbone_sim.effects.assemble import acting, build_with
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.written import effects_text
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.array_cache import ArrayCache
from herringbone_sim.sweeps.observe import asymmetries, contact_loss
from herringbone_sim.sweeps.periods import find_periods

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

CHUNK = 128
ALIKE = 0.01  # RMS of left less right in b_c up to which they move alike
LEAST_EXPONENT = 2e-3  # per tau: less is neutral


@dataclass(frozen=True)
class Look:
    """How long a motion is looked at.

    Attributes:
        transient: mesh cycles left out first.
        cycles: periods of the effects looked at (mesh cycles without them); a period of the
            motion needs 5 repeats in them.
        exponents: whether to work out Lyapunov exponents.
        max_period: largest period tried, in the same.
    """

    transient: int = 800
    cycles: int = 100
    exponents: bool = False
    max_period: int = 16

    def over(self, forcing: int) -> Look:
        """The same for effects that repeat only after so many mesh cycles."""
        cycles, longest = self.cycles * forcing, self.max_period * forcing
        return replace(self, cycles=cycles, max_period=longest)


@dataclass(frozen=True)
class Motions:
    """What n runs came to; arrays (n,), NaN where a run failed or nothing was asked for.

    Attributes:
        period: mesh cycles, 0 aperiodic.
        exponent, exponent_error: largest Lyapunov exponent per tau and its standard error.
        within, transverse: the same for perturbations that keep, and that part, left and right.
        asymmetry: RMS of left less right over the section, b_c.
        contact_loss: 0 never, 1 on one flank, 2 on both flanks of some mesh.
        apart: share of the time without contact, mean of the meshes.
        end: (n, n_state) last states, at phase 0.
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

    def repeats(self, cycles: int) -> NDArray[np.bool_]:
        """Whether the motion repeats after so many mesh cycles: P1 does so after 2 as well."""
        return repeats(self.period, cycles)

    @property
    def alike(self) -> NDArray[np.bool_]:
        """Whether left and right move alike."""
        return np.asarray(self.asymmetry < ALIKE, dtype=bool)


NAMES = tuple(item.name for item in fields(Motions))


def repeats(period: Array, cycles: int) -> NDArray[np.bool_]:
    """Whether motions of these periods repeat after so many mesh cycles; aperiodic never, none
    after 0."""
    periodic = (period > 0) & (cycles > 0)
    there = periodic & (np.mod(cycles, np.where(periodic, period, 1.0)) == 0.0)
    return np.asarray(there, dtype=bool)


class Runs:
    """Runs gears on threads and keeps what was seen.

    Args:
        folder: made when it is new; None keeps nothing.
        workers: threads.
        planned: told the number of runs before they begin.
        done: told the number of runs after each chunk.
        actives: effects of every gear.

    Raises:
        AnalysisError: the folder can't be written.
    """

    def __init__(
        self,
        folder: Path | None = None,
        workers: int = 2,
        planned: Callable[[int], object] = lambda runs: None,
        done: Callable[[int], object] = lambda runs: None,
        actives: Sequence[Active] = (),
    ) -> None:
        self._kept, self._workers = ArrayCache(folder), workers
        self._planned, self._done = planned, done
        self._actives = acting(actives)

    def build(self, one: Parameters) -> Model:
        """The gear of a parameter set; ParameterError where there can be none."""
        return build_with(one, self._actives)

    def forcing(self, one: Parameters) -> int:
        """Mesh cycles after which the effects repeat, whatever the control does; 1 without."""
        return effect_cycles(self.build(one))

    def observe(self, sets: Sequence[Parameters], starts: Array, look: Look) -> Motions:
        """Motions of n gears of one layout.

        Args:
            sets: n parameter sets.
            starts: (n, n_state) states at phase 0; a row of NaN fails.
            look: how long.
        """
        self._planned(len(sets))
        firsts = range(0, len(sets), CHUNK)
        pieces = [(sets[i : i + CHUNK], starts[i : i + CHUNK], look) for i in firsts]
        with ThreadPoolExecutor(self._workers) as pool:
            found = pool.map(lambda piece: self._chunk(*piece), pieces)
            return _joined([self._told(one) for one in found])

    def _chunk(self, sets: Sequence[Parameters], starts: Array, look: Look) -> Motions:
        parts = [NAMES, sets, effects_text(self._actives), starts, look]
        return Motions(**self._kept.get(parts, lambda: vars(self._run(sets, starts, look))))

    def _run(self, sets: Sequence[Parameters], starts: Array, look: Look) -> Motions:
        """One chunk; a gear that can't exist is NaN throughout."""
        built = [self._built(one) for one in sets]
        motions = _empty(len(sets), starts.shape[1])
        whole: list[bool] = np.asarray(np.isfinite(starts).all(axis=1)).tolist()
        models = {i: model for i, model in enumerate(built) if model is not None and whole[i]}
        if models:
            rows = np.array(list(models), dtype=np.int64)
            longer = look.over(self.forcing(sets[int(rows[0])]))
            _fill(motions, rows, list(models.values()), starts[rows], longer)
        return motions

    def _built(self, one: Parameters) -> Model | None:
        try:
            return self.build(one)
        except ParameterError:
            return None

    def _told(self, motions: Motions) -> Motions:
        self._done(len(motions.period))
        return motions


def _fill(
    motions: Motions, rows: Indices, models: Sequence[Model], starts: Array, look: Look
) -> None:
    """Run gears and put what they came to into their rows."""
    length = (look.transient, look.cycles, look.cycles, look.exponents)
    batch = run_batch(models, starts, *length)
    motions.period[rows] = find_periods(batch.sections, look.max_period)
    for name in ("exponent", "exponent_error"):
        getattr(motions, name)[rows] = getattr(batch, f"{name}s")
    motions.within[rows], motions.transverse[rows] = batch.within, batch.transverse
    motions.asymmetry[rows] = asymmetries(batch.sections[..., : models[0].layout.n_state])
    motions.contact_loss[rows] = contact_loss(batch.contact)
    motions.apart[rows] = batch.contact[:, :, 1].mean(axis=1)
    motions.end[rows] = batch.end


def _empty(n: int, n_state: int) -> Motions:
    return Motions(**{m: np.full((n, n_state) if m == "end" else n, np.nan) for m in NAMES})


def _joined(parts: Sequence[Motions]) -> Motions:
    return Motions(**{m: np.concatenate([getattr(one, m) for one in parts]) for m in NAMES})
