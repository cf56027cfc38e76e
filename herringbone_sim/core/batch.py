"""Integrate a batch of models: section points, Lyapunov exponents, contact fractions of each.

Sweeps and maps are divided into batches. Models do not influence each other: the result of a
model is bitwise the same whichever others are in the batch, in any order.

Over 300 lines: the three ways to integrate a batch stand beside the code that fills its arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.integrate import batch_edges, stepper
from herringbone_sim.core.lanes.packed import (
    constants,
    integrated_added,
    make_work,
    sizes_of,
)
from herringbone_sim.core.lanes.run import Results, Values, run_linear_lanes, run_nonlinear_lanes
from herringbone_sim.core.layout import Layout
from herringbone_sim.core.mirror import (
    from_left_half,
    has_equal_halves,
    left_half,
    self_mirrored,
    state_mirror,
)
from herringbone_sim.core.model import Model, initial_state
from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.core.reference import Reference
from herringbone_sim.core.sensitivity import Directions, neighbours_of


@dataclass(frozen=True)
class Batch:
    """Results of n models; all numbers of a model that diverged are NaN.

    Attributes:
        sections: (n, points, n_state + 2 s) states at phase 0 of the last cycles, dimensionless;
            displacements and rates of the s coordinates that effects add come last.
        end: (n, n_state + 2 s) states after the last cycle.
        exponents: (n,) largest Lyapunov exponent per tau; NaN if not requested or with method rk4.
        exponent_errors: (n,) standard error of ``exponents``, from up to 10 batches of cycles.
        within: (n,) largest exponent of left-right symmetric perturbations; NaN where the halves
            of gear or motion differ, and for gears integrated by the laws of their effects.
        transverse: (n,) largest exponent of antisymmetric perturbations; NaN as for ``within``.
        contact: (n, n_mesh, 3) fractions of the time in back contact, separated and in drive
            contact; with method rk4, of the samples.
        reasons: n texts, empty, or ``diverged``.
        columns: (n, p, n_state + 2 s) derivatives of ``end`` with respect to p parameters, zero
            at the start, see ``sensitivity``; empty without ``Directions``.
    """

    sections: Array
    end: Array
    exponents: Array
    exponent_errors: Array
    within: Array
    transverse: Array
    contact: Array
    reasons: tuple[str, ...]
    columns: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))

    def of_gear(self, layout: Layout) -> Batch:
        """Return the batch with ``sections`` (n, points, n_state) alone, without added states."""
        return replace(self, sections=self.sections[..., : layout.n_state])


@dataclass(frozen=True)
class _Length:
    """Transient and observed mesh cycles, number of section points and of tangent vectors."""

    transient: int
    cycles: int
    points: int
    tangents: int

    @property
    def batches(self) -> int:
        return len(self.edges) - 1

    @property
    def edges(self) -> Indices:
        """(batches + 1,) observed cycles at which batches begin and end."""
        return batch_edges(self.cycles)


def run_batch(
    models: Sequence[Model] | Sequence[Directions],
    starts: Array | None = None,
    transient: int = 300,
    cycles: int = 100,
    points: int = 100,
    exponents: bool = False,
    before: Indices | None = None,
) -> Batch:
    """Integrate every model for ``transient`` and then ``cycles`` mesh cycles.

    A gear with equal halves from a start state with equal halves is integrated as one half; its
    largest exponent is the larger of ``within`` and ``transverse``.

    Args:
        models: n models of one layout, order and method, at least one; or each with the same
            number p of parameters to differentiate ``end`` by, as ``sensitivity.Directions``.
        starts: (n, n_state) states at phase 0, dimensionless, or (n, n_state + 2 s) with the s
            coordinates that effects add, which are otherwise at rest; by default the initial
            states of the models. NaN counts as 0.
        transient: mesh cycles that are integrated first and not evaluated.
        cycles: mesh cycles over which exponents and contact are averaged, at least 1.
        points: number of section points, from the last cycles; at most ``cycles``.
        exponents: whether to compute Lyapunov exponents.
        before: (n,) mesh cycles before ``starts``, 0 by default: they set the phase of forcing
            that does not repeat every mesh cycle, as of effects once a revolution.

    Raises:
        ValueError: the models differ in layout, order or method, some but not all of them are
            ``Directions``, or the lengths are invalid.
    """
    along = [one for one in models if isinstance(one, Directions)]
    if along and len(along) < len(models):
        raise ValueError(
            f"a batch takes models or Directions, got {len(along)} Directions among "
            f"{len(models)}: run one batch for each"
        )
    models = [one.model if isinstance(one, Directions) else one for one in models]
    _check(models, transient, cycles, points)
    layout = models[0].layout
    if starts is None:
        starts = np.array([initial_state(model) for model in models])
    n_all = models[0].n_state
    rest = np.zeros((len(models), max(n_all - starts.shape[1], 0)))
    starts = np.nan_to_num(np.concatenate([starts, rest], axis=1))
    found = _empty(len(models), points, layout, n_all)
    if along:
        columns = np.full((len(models), len(along[0].step), n_all), np.nan)
        found = replace(found, columns=columns)
    mirror = state_mirror(models[0])
    equal = np.array(
        [
            np.array_equal(y, y[mirror])
            and all(
                has_equal_halves(one) and np.array_equal(mirror, state_mirror(one))
                for one in (m, *(along[i].models() if along else ()))
            )
            for i, (m, y) in enumerate(zip(models, starts, strict=True))
        ]
    )
    reasons = np.array([""] * len(models), dtype=object)
    before = np.zeros(len(models), dtype=np.int64) if before is None else before
    for sides in (1, 2):
        chosen = np.flatnonzero(equal == (sides == 1))
        if len(chosen):
            length = _Length(transient, cycles, points, (3 - sides) * exponents)
            group = [models[int(i)] for i in chosen]
            begin = starts[chosen], before[chosen]
            if hasattr(models[0].integrator, "run_batch"):
                reasons[chosen] = _run_by_laws(found, chosen, group, begin, length)
                continue
            if models[0].parameters.method == "rk4" or models[0].integrator is not None:
                reasons[chosen] = [
                    _run_one(found, int(i), model, y, int(cycle), length)
                    for i, model, y, cycle in zip(chosen, group, *begin, strict=True)
                ]
                continue
            beside = [along[int(i)] for i in chosen] if along else []
            reasons[chosen] = _run_lanes(found, chosen, group, begin, sides, length, beside)
    return replace(found, reasons=tuple(reasons))


def _check(models: Sequence[Model], transient: int, cycles: int, points: int) -> None:
    """Raise ValueError for invalid lengths, or models that can't share a batch."""
    if not (transient >= 0 and cycles >= 1 and 0 <= points <= cycles):
        raise ValueError(
            f"a batch needs transient >= 0, cycles >= 1 and points from 0 to cycles, got "
            f"transient {transient}, cycles {cycles}, points {points}"
        )
    kinds = {
        (m.layout.channels, m.parameters.order, m.parameters.method, m.n_state, m.integrator)
        for m in models
    }
    if len(kinds) != 1:
        raise ValueError(
            f"a batch needs models of one layout, order and method, got {len(kinds)} kinds among "
            f"{len(models)} models: run one batch for each"
        )


def _empty(n: int, points: int, layout: Layout, n_all: int) -> Batch:
    """Return results of n models filled with NaN, n_all numbers in an end state; no reasons."""

    def none(*shape: int) -> Array:
        return np.full((n, *shape), np.nan)

    sections, contact = none(points, n_all), none(layout.n_mesh, 3)
    return Batch(sections, none(n_all), none(), none(), none(), none(), contact, ())


def _run_lanes(
    batch: Batch,
    chosen: Indices,
    models: Sequence[Model],
    begin: tuple[Array, Indices],
    sides: int,
    length: _Length,
    along: Sequence[Directions],
) -> list[str]:
    """Integrate models in the lanes and write their results into rows ``chosen`` of the batch.

    Returns their reasons. With ``sides`` 1 the left halves alone are integrated.
    """
    layout, n, order = models[0].layout, len(models), models[0].parameters.order
    taken = left_half(models[0]) if sides == 1 else np.arange(models[0].n_state)
    others = [other for one in along for other in one.models()]
    sizes = sizes_of([*models, *others], len(integrated_added(models[0], sides)))
    every = constants([*models, *others], sides, sizes)
    table = np.ascontiguousarray(every[:n])
    size, n_mesh = len(taken), layout.n_mesh // 2 * sides
    starts = np.zeros((n, 1 + length.tangents, size))
    starts[:, 0] = begin[0][:, taken]
    starts[:, 1:] = np.random.default_rng(0).normal(size=size)
    if sides == 1 and length.tangents:
        starts[:, 2, self_mirrored(models[0])] = 0.0
    sections = np.full((n, length.points, size), np.nan)
    end, contact = np.full((n, size), np.nan), np.full((n, n_mesh, 2), np.nan)
    growth = np.zeros((n, length.batches + 1, length.tangents))
    failed = np.zeros(n, dtype=np.bool_)
    lanes = run_nonlinear_lanes if sizes.powers else run_linear_lanes
    work = make_work(every, sizes, n_mesh, sides, order, length.tangents)
    neighbours = None
    if along:
        zeros = np.zeros((len(along[0].step), begin[0].shape[1]))
        inner = [one.to_kernel(y, zeros) for one, y in zip(along, begin[0], strict=True)]
        columns = np.ascontiguousarray(np.array(inner)[:, :, taken])  # one type at all sizes
        neighbours = neighbours_of(along, work, every[n:], columns)
    values = Values(
        table, np.array([model.parameters.steps for model in models]), starts, begin[1]
    )
    lanes(
        ((0,) * sides, (0,) * layout.n_classes, (0,) * sizes.extended),
        Reference(work),
        Reference(neighbours) if neighbours else None,
        1.0 / np.maximum(np.arange(order + 2.0), 1.0),
        sizes.loads > 0 or any(model.packed.K != 0.0 for model in [*models, *others]),
        values,
        (length.transient, length.cycles),
        Results(sections, end, growth, contact, failed),
    )
    whole = from_left_half(models[0]) if sides == 1 else taken
    batch.sections[chosen] = sections[..., whole]
    batch.end[chosen] = end[..., whole]
    if neighbours is not None:
        for i, one, columns in zip(chosen, along, neighbours.ends, strict=True):
            batch.columns[i] = one.from_kernel(batch.end[i], columns[:, whole])
        batch.columns[chosen[failed]] = np.nan
    _put_exponents(batch, chosen, models, growth, length)
    _put_contact(
        batch.contact, chosen, contact / (values.steps * length.cycles)[:, None, None], sides
    )
    for name in ("exponents", "exponent_errors", "within", "transverse", "contact"):
        getattr(batch, name)[chosen[failed]] = np.nan
    batch.sections[chosen[failed]], batch.end[chosen[failed]] = np.nan, np.nan
    return ["diverged" if bad else "" for bad in failed]


def _put_exponents(
    batch: Batch,
    chosen: Indices,
    models: Sequence[Model],
    growth: Array,
    length: _Length,
) -> None:
    """Write exponents per tau and their errors into rows ``chosen`` of the batch.

    ``growth`` (n, batches + 1, tangents) holds the logarithms of the growth factors in each batch
    of cycles; its last row is not used.
    """
    if not length.tangents:
        return
    cycle = TWO_PI / np.array([model.packed.Omega for model in models])
    spans = np.diff(length.edges)[:, None] * cycle[:, None, None]
    rates = growth[:, :-1] / spans
    means = growth[:, :-1].sum(axis=1) / (length.cycles * cycle)[:, None]
    errors = np.full_like(means, np.nan)
    if length.batches > 1:
        errors = rates.std(axis=1, ddof=1) / np.sqrt(length.batches)
    largest = np.argmax(means, axis=1)
    rows = np.arange(len(models))
    batch.exponents[chosen], batch.exponent_errors[chosen] = (
        means[rows, largest],
        errors[rows, largest],
    )
    if length.tangents == 2:
        batch.within[chosen], batch.transverse[chosen] = means.T


def _put_contact(shares: Array, chosen: Indices, contact: Array, sides: int) -> None:
    """Write ``Batch.contact`` into rows ``chosen`` of ``shares``.

    ``contact`` (n, meshes, 2) has the fractions in back and drive contact, of one half or both.
    """
    n, n_mesh, _ = contact.shape
    halves = contact.reshape(n, 2, sides, n_mesh // (2 * sides), 2)
    whole = np.repeat(halves, 2 // sides, axis=2).reshape(n, -1, 2)
    shares[chosen, :, 0], shares[chosen, :, 2] = whole[..., 0], whole[..., 1]
    shares[chosen, :, 1] = 1.0 - whole.sum(axis=2)


def _run_by_laws(
    batch: Batch,
    chosen: Indices,
    models: Sequence[Model],
    begin: tuple[Array, Indices],
    length: _Length,
) -> list[str]:
    """Integrate gears by the laws of their effects in lanes, with at most one tangent vector.

    Writes the results into rows ``chosen`` of the batch; returns the reasons.
    """
    look = length.transient, length.cycles, length.points
    tangents = min(length.tangents, 1)
    result = models[0].integrator.run_batch(models, *begin, look, tangents)
    batch.sections[chosen] = result.sections
    batch.end[chosen] = result.end
    with np.errstate(invalid="ignore"):  # 0 / 0 where a model diverged
        batch.contact[chosen] = result.contact / result.contact[:, :1].sum(axis=2, keepdims=True)
    if tangents:
        _put_exponents(batch, chosen, models, _by_batches(result.growth, length), length)
    for name in ("sections", "end", "contact", "exponents", "exponent_errors"):
        getattr(batch, name)[chosen[result.failed]] = np.nan
    return ["diverged" if bad else "" for bad in result.failed]


def _by_batches(growth: Array, length: _Length) -> Array:
    """Sum growth (n, cycles, tangents) of single cycles over batches, for ``_put_exponents``."""
    parts = [growth[:, first:stop].sum(axis=1) for first, stop in pairwise(length.edges)]
    return np.pad(np.stack(parts, axis=1), ((0, 0), (0, 1), (0, 0)))


def _run_one(batch: Batch, i: int, model: Model, y: Array, cycle: int, length: _Length) -> str:
    """Integrate a model by its stepper, with at most one tangent vector (with method rk4 none).

    Writes the results into row i; returns ``diverged`` or no text.
    """
    gear_stepper, per_cycle = stepper(model), model.parameters.samples_per_cycle
    k = min(length.tangents, 1) if model.integrator else 0
    start = replace(gear_stepper.start(k), y=y, cycle=cycle)
    if k:
        start = gear_stepper.advance(start, length.transient * per_cycle).end
    else:  # without rows, of which there may be as many as steps
        end, _ = gear_stepper.advance_cycles(y, start.tangents, cycle, length.transient)
        start = replace(start, y=end, cycle=cycle + length.transient)
    states, contact = [start], np.zeros((model.layout.n_mesh, 3))
    for _ in range(length.cycles):
        block = gear_stepper.advance(states[-1], per_cycle)
        states.append(block.end)
        contact += block.contact
        if block.diverged:
            return "diverged"
    if gear_stepper.advance(states[-1], 1).diverged:  # the last state, which no block looked at
        return "diverged"
    kept = states[length.cycles - length.points : length.cycles]
    batch.sections[i] = np.array([state.y for state in kept]).reshape(batch.sections[i].shape)
    batch.end[i] = states[-1].y
    batch.contact[i] = contact / contact[0].sum()
    if k:
        growth = np.diff([state.growth[0] for state in states]).reshape(1, -1, 1)
        _put_exponents(batch, np.array([i]), [model], _by_batches(growth, length), length)
    return ""
