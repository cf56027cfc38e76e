"""Events once a revolution: the best position of a crack or a spall, by folding.

The response to an event every three cycles is taken for each offset in half cycles; each event
of it stands for a mesh cycle of its own. Products with the residual are then folded modulo the
mesh cycles of a revolution of each member, so that all positions of all members cost no more
than six responses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model
from herringbone_sim.effects.effect import Active, Effect, Locus, Options, active
from herringbone_sim.gap.attribution.hypothesis import Case, added
from herringbone_sim.gap.residuals.recalibrate import Law

Array = NDArray[np.float64]

SPACING = 3  # cycles between probing events, more than the widest probed event
PARTS = 2  # offsets a cycle
WIDTHS = (0.7, 1.5)


@dataclass(frozen=True)
class Folded:
    """Products over an event at each place in phase, for one run.

    Attributes:
        right, normal: (n_mesh, places) response times residual, and squared; whitened.
        first: place of the first column, in parts of a cycle of the unwrapped phase.
    """

    right: Array
    normal: Array
    first: int


def fold(
    one: Case, factors: Array, law: Law, residual: Array, probe: Active, step: float
) -> Folded:
    """Products of the residual (n, n_mesh), whitened, with events at every place of a run."""
    cycles = one.run.phase / (2.0 * np.pi)
    first = int(np.floor(cycles[0] * PARTS)) - PARTS * SPACING
    places = int(np.ceil(cycles[-1] * PARTS)) + PARTS * SPACING - first + 1
    right, normal = np.zeros((2, residual.shape[1], places))
    for offset in range(SPACING * PARTS):
        at = offset / PARTS
        effect = replace(probe.effect, place=_periodic)
        theta = np.array(probe.theta)
        theta[_index(effect, "position")] = at
        shown = replace(probe, effect=effect, theta=tuple(theta), locus=Locus())
        response = added(one, factors, law, (shown,))[0] / (step * law.sigma_n)
        event = np.rint((cycles - at) / SPACING).astype(int) * SPACING * PARTS + offset
        for m in np.flatnonzero(one.usable):
            np.add.at(right[m], event - first, response[:, m] * residual[:, m])
            np.add.at(normal[m], event - first, response[:, m] ** 2)
    return Folded(right, normal, first)


def modulo(model: Model, effect: Effect, member: str, folded: Folded) -> tuple[Array, Array]:
    """Sums (n_mesh, positions) of right and normal by position on a member, parts of a cycle."""
    mask = Locus({"sun": "sp", "planet": "all", "ring": "rp"}[member]).mask(model.layout)
    _, period, late = effect.place(model, mask, {"member": member})
    bins = int(np.rint(period[0] * PARTS))
    right, normal = np.zeros((2, len(mask), bins))
    places = folded.first + np.arange(folded.right.shape[1])
    for m in np.flatnonzero(mask):
        at = (places - int(np.rint(late[m] * PARTS))) % bins
        np.add.at(right[m], at, folded.right[m])
        np.add.at(normal[m], at, folded.normal[m])
    return right, normal


def probe(effect: Effect, width: float) -> tuple[Active, float]:
    """A small event of a width in cycles, and its size."""
    theta = effect.start
    step = 1e-3 * theta[0]
    theta[0], theta[_index(effect, "width")] = step, width
    return Active(effect, tuple(theta), Locus(), active(effect).options), step


def placed(one: Active, size: float, position: float, member: str, locus: Locus) -> Active:
    """The event of a probe with a size at a position of a member."""
    theta = np.array(one.theta)
    theta[0], theta[_index(one.effect, "position")] = size, position
    theta = np.clip(theta, *one.effect.bounds)
    return Active(one.effect, tuple(map(float, theta)), locus, (("member", member),))


def _index(effect: Effect, name: str) -> int:
    return [p.name for p in effect.parameters].index(name)


def _periodic(model: Model, mask: Array, options: Options) -> Array:
    one = np.ones(mask.shape)
    return np.stack([mask, SPACING * one, 0.0 * one])
