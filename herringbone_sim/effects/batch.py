"""Many parameter values of a gear with effects: what ``core.batch`` does, one after another.

Left and right are integrated both, so no motion is held symmetric by arithmetic, and the largest
exponent comes from a second trajectory; ``within`` and ``transverse`` stay NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.batch import BATCHES, Batch
from herringbone_sim.core.model import Model
from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.stepper import EffectStepper

Array = NDArray[np.float64]


def run_effects(
    models: Sequence[Model],
    actives: Sequence[Active],
    starts: Array,
    cycle: NDArray[np.int64],
    transient: int,
    cycles: int,
    points: int,
    exponents: bool,
) -> Batch:
    """Run every model with the effects for ``transient`` and then ``cycles`` mesh cycles.

    Args:
        models: n models of one layout.
        actives: the effects; those of sensors are passed over.
        starts: (n, n_state + n_own) states at phase 0, own states of the effects last; NaN there
            for own states at rest.
        cycle: (n,) mesh cycles that each has run before.
        transient, cycles, points, exponents: as ``core.batch.run_batch``.
    """
    size = starts.shape[1]
    layout = models[0].layout
    n = len(models)

    def none(*shape: int) -> Array:
        return np.full((n, *shape), np.nan)

    found = Batch(
        sections=none(points, layout.n_state),
        end=none(size),
        exponents=none(),
        exponent_errors=none(),
        within=none(),
        transverse=none(),
        contact=none(layout.n_mesh, 3),
        reasons=(),
    )
    length = transient, cycles, points, exponents
    reasons = tuple(
        _one(found, i, EffectStepper(model, actives), starts[i], int(cycle[i]), length)
        for i, model in enumerate(models)
    )
    return replace(found, reasons=reasons)


def _one(
    found: Batch,
    i: int,
    machine: EffectStepper,
    start: Array,
    cycle: int,
    length: tuple[int, int, int, bool],
) -> str:
    transient, cycles, points, exponents = length
    per_cycle = machine.model.parameters.samples_per_cycle
    state = machine.start(tangents=int(exponents))
    state = replace(state, y=np.where(np.isnan(start), 0.0, start), cycle=cycle)
    block = machine.advance(state, transient * per_cycle)
    states, growth = [], [float(block.end.growth.sum())]
    contact = np.zeros((machine.model.layout.n_mesh, 3))
    for _ in range(cycles):
        states.append(block.end.y)
        if block.diverged:
            return "diverged"
        block = machine.advance(block.end, per_cycle)
        growth.append(float(block.end.growth.sum()))
        contact += block.contact
    if block.diverged:
        return "diverged"
    m = machine.model.layout.n_state
    found.sections[i] = np.array(states[cycles - points :]).reshape(points, -1)[:, :m]
    found.end[i] = block.end.y
    found.contact[i] = contact / contact[0].sum()
    if exponents:
        rate = machine.model.packed.Omega / TWO_PI
        found.exponents[i] = (growth[-1] - growth[0]) / cycles * rate
        parts = np.array_split(np.diff(growth), min(BATCHES, cycles))
        means = np.array([part.mean() for part in parts]) * rate
        found.exponent_errors[i] = means.std(ddof=1) / np.sqrt(len(means)) if cycles > 1 else 0.0
    return ""
