"""Many parameter values at once: sections, exponents and contact of each, from arrays of models.

The unit of work of every sweep and map. Values do not see each other: the result of one is the
same to the bit, alone or among others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.integrate import State, Stepper
from herringbone_sim.core.model import Model
from herringbone_sim.core.packed import TWO_PI

Array = NDArray[np.float64]

BATCHES = 10


@dataclass(frozen=True)
class Batch:
    """What was observed of n values; a failed value is NaN throughout, with its reason.

    Attributes:
        sections: (n, points, n_state) states at phase 0 of the last cycles, dimensionless.
        end: (n, n_state) states after the last cycle.
        exponents: (n,) largest Lyapunov exponent per tau; NaN when none was asked for.
        exponent_errors: (n,) standard error of its mean over 10 batches of cycles.
        within: (n,) the same for perturbations that keep left and right alike; NaN for a motion
            whose halves differ.
        transverse: (n,) the same for perturbations that part left and right; NaN as above.
        contact: (n, n_mesh, 3) share of the time in back contact, separated, in drive contact.
        reasons: n texts, empty where all went well.
    """

    sections: Array
    end: Array
    exponents: Array
    exponent_errors: Array
    within: Array
    transverse: Array
    contact: Array
    reasons: tuple[str, ...]


def run_batch(
    models: Sequence[Model],
    starts: Array | None = None,
    transient: int = 300,
    cycles: int = 100,
    points: int = 100,
    exponents: bool = False,
) -> Batch:
    """Run every model for ``transient`` and then ``cycles`` mesh cycles.

    Args:
        models: n models of one layout.
        starts: (n, n_state) states at phase 0; the models' own initial states by default.
        transient: mesh cycles left out before anything is observed.
        cycles: mesh cycles over which exponents and contact are averaged.
        points: section points kept, of the last cycles; at most ``cycles``.
        exponents: whether to carry tangent vectors along.
    """
    n, layout = len(models), models[0].layout
    found = Batch(
        sections=np.full((n, points, layout.n_state), np.nan),
        end=np.full((n, layout.n_state), np.nan),
        exponents=np.full(n, np.nan),
        exponent_errors=np.full(n, np.nan),
        within=np.full(n, np.nan),
        transverse=np.full(n, np.nan),
        contact=np.full((n, layout.n_mesh, 3), np.nan),
        reasons=("",) * n,
    )
    reasons = []
    for i, model in enumerate(models):
        reasons.append(_one(found, i, model, starts, (transient, cycles, points), exponents))
    return replace(found, reasons=tuple(reasons))


def _one(
    found: Batch,
    i: int,
    model: Model,
    starts: Array | None,
    length: tuple[int, int, int],
    exponents: bool,
) -> str:
    transient, cycles, points = length
    stepper, per_cycle = Stepper(model), model.parameters.samples_per_cycle
    state = stepper.start()
    if starts is not None:
        state = replace(state, y=starts[i].copy())
    block = stepper.advance(state, transient * per_cycle)
    if block.diverged:
        return "diverged"
    state, sections = block.end, []
    contact = np.zeros((model.layout.n_mesh, 3))
    for _ in range(cycles):
        sections.append(state.y)
        block = stepper.advance(state, per_cycle)
        state, contact = block.end, contact + block.contact
    if block.diverged:
        return "diverged"
    found.sections[i] = sections[cycles - points :]
    found.end[i] = state.y
    found.contact[i] = contact / (cycles * per_cycle)
    if exponents:
        start = replace(state, y=sections[0])
        _exponents(found, i, stepper, start, cycles)
    return ""


def _exponents(found: Batch, i: int, stepper: Stepper, start: State, cycles: int) -> None:
    m = stepper.model.layout.n_coordinate
    general = np.random.default_rng(0).normal(size=2 * m)
    mirror = np.concatenate(
        [s + np.concatenate([[1, 0], np.roll(np.arange(2, m), (m - 2) // 2)]) for s in (0, m)]
    )
    mean, error = _mean_growth(stepper, start, general, cycles)
    found.exponents[i], found.exponent_errors[i] = mean, error
    if np.array_equal(start.y, start.y[mirror]):
        found.within[i] = _mean_growth(stepper, start, general + general[mirror], cycles)[0]
        found.transverse[i] = _mean_growth(stepper, start, general - general[mirror], cycles)[0]


def _mean_growth(
    stepper: Stepper, start: State, tangent: Array, cycles: int
) -> tuple[float, float]:
    now = replace(start, tangents=tangent[None] / np.linalg.norm(tangent), growth=np.zeros(1))
    length = max(cycles // BATCHES, 1)
    growth = []
    for _ in range(BATCHES):
        now = replace(now, growth=np.zeros(1))
        now = stepper.advance(now, length * stepper.model.parameters.samples_per_cycle).end
        growth.append(now.growth[0])
    rates = np.array(growth) / (length * TWO_PI / stepper.model.packed.Omega)
    return float(rates.mean()), float(rates.std(ddof=1) / np.sqrt(BATCHES))
