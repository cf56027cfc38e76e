"""Two gears over one parameter: which motions each has, and what moves between them.

A motion is named by its period in periods of the gear's own forcing, so that one which repeats
once a revolution, because a tooth is cracked, is P1 too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.sweeps.diagram import SAME, Branch, diagram_of, differ
from herringbone_sim.sweeps.grid import Axis
from herringbone_sim.sweeps.store import Result

Array = NDArray[np.float64]
Labels = Sequence[str]

APERIODIC, FAILED = "aperiodic", "failed"
CONTACT = {0.0: "contact kept", 1.0: "one flank lost", 2.0: "both flanks hit"}
LEAST_STRETCH = 0.02  # of the values: shorter stretches are windows and stragglers


@dataclass(frozen=True)
class Side:
    """One of the two gears.

    Attributes:
        name: ``nominal`` or ``augmented``.
        results: over the same n values of one axis, by how a value is reached.
        forcing: mesh cycles after which its effects repeat.
    """

    name: str
    results: Mapping[str, Result]
    forcing: int = 1

    @property
    def axis(self) -> Axis:
        return next(iter(self.results.values())).axes[0]

    def motions(self, way: str) -> list[str]:
        """``P1``, ``aperiodic``, ``failed``, ... at each value."""
        return [motion(value, self.forcing) for value in self.results[way]["period"]]

    def contacts(self, way: str) -> list[str]:
        """What contact is lost at each value, as ``CONTACT`` names it, or ``failed``."""
        return [CONTACT.get(float(one), FAILED) for one in self.results[way]["contact_loss"]]


@dataclass(frozen=True)
class Boundary:
    """Where one thing gives way to another as the parameter rises.

    Attributes:
        kind: ``motion`` or ``contact``.
        before, after: what is there below and above.
        value: of the parameter.
        half_width: half of what lies between the last value below and the first above.
    """

    kind: str
    before: str
    after: str
    value: float
    half_width: float


@dataclass(frozen=True)
class Move:
    """A boundary of one gear and that of the other; None where only one of them has it.

    Attributes:
        way: how the values were reached.
        nominal, augmented: of the two gears.
    """

    way: str
    nominal: Boundary | None
    augmented: Boundary | None

    @property
    def boundary(self) -> Boundary:
        """The one that there is; that of the nominal gear where both are."""
        found = self.nominal or self.augmented
        assert found is not None
        return found

    @property
    def shift(self) -> float:
        """How far it moves; NaN where only one gear has it."""
        if self.nominal is None or self.augmented is None:
            return float("nan")
        return self.augmented.value - self.nominal.value

    @property
    def error(self) -> float:
        """Up to which the shift is uncertain: the two half-widths together."""
        return sum(one.half_width for one in (self.nominal, self.augmented) if one is not None)


@dataclass(frozen=True)
class Stretch:
    """Values from low to high, and what is there."""

    low: float
    high: float
    motions: tuple[str, ...]


def motion(period: float, forcing: int = 1) -> str:
    """Name of a motion by its period in mesh cycles (0 aperiodic, NaN failed)."""
    if not np.isfinite(period):
        return FAILED
    cycles = int(period)
    if cycles == 0:
        return APERIODIC
    return f"P{cycles // forcing}" if cycles % forcing == 0 else f"{cycles} mesh cycles"


def regimes(labels: Labels) -> list[tuple[int, int, str]]:
    """First and last index of each stretch of one label; the short ones are left out."""
    least = LEAST_STRETCH * len(labels)
    edges = [0, *(i for i in range(1, len(labels)) if labels[i] != labels[i - 1]), len(labels)]
    long = [(a, b - 1, labels[a]) for a, b in pairwise(edges) if b - a >= least]
    found: list[tuple[int, int, str]] = []
    for first, last, label in long:
        if found and found[-1][2] == label:
            found[-1] = (found[-1][0], last, label)
        else:
            found.append((first, last, label))
    return found


def boundaries(kind: str, values: Sequence[float], labels: Labels) -> list[Boundary]:
    """Where the labels (n,) of rising values (n,) change for long."""
    return [
        Boundary(
            kind,
            before,
            after,
            (values[first] + values[last]) / 2.0,
            (values[first] - values[last]) / 2.0,
        )
        for (_, last, before), (first, _, after) in pairwise(regimes(labels))
    ]


def moves(nominal: Side, augmented: Side, way: str) -> list[Move]:
    """All boundaries of both gears by one way, those of one kind matched to the nearest."""
    found: list[Move] = []
    for kind in ("motion", "contact"):
        mine, other = (_boundaries(side, way, kind) for side in (nominal, augmented))
        found += _matched(way, mine, other)
    return sorted(found, key=lambda one: (one.boundary.kind != "motion", one.boundary.value))


def _boundaries(side: Side, way: str, kind: str) -> list[Boundary]:
    labels = side.motions(way) if kind == "motion" else side.contacts(way)
    return boundaries(kind, side.axis.values, labels)


def _matched(way: str, mine: list[Boundary], other: list[Boundary]) -> list[Move]:
    pairs = sorted(
        (abs(a.value - b.value), i, j)
        for i, a in enumerate(mine)
        for j, b in enumerate(other)
        if (a.before, a.after) == (b.before, b.after)
    )
    partner: dict[int, int] = {}
    for _, i, j in pairs:
        if i not in partner and j not in partner.values():
            partner[i] = j
    both = [Move(way, a, other[partner[i]] if i in partner else None) for i, a in enumerate(mine)]
    taken = set(partner.values())
    return both + [Move(way, None, b) for j, b in enumerate(other) if j not in taken]


def shares(nominal: Side, augmented: Side, way: str) -> dict[str, tuple[float, float]]:
    """Share of the values at which each gear has a motion, by its name; the commonest first."""
    counts = [Counter(side.motions(way)) for side in (nominal, augmented)]
    n = len(nominal.axis)
    names = [name for name, _ in (counts[0] + counts[1]).most_common()]
    return {name: (counts[0][name] / n, counts[1][name] / n) for name in names}


def coexisting(side: Side) -> list[Stretch]:
    """Stretches over which different ways to a value end in the same different motions."""
    at, values = motions_at(side), side.axis.values
    stretches = regimes(["\n".join(sorted(motions)) for motions in at])
    found = [(values[a], values[b], tuple(label.split("\n"))) for a, b, label in stretches]
    return [Stretch(*one) for one in found if len(one[2]) > 1]


def motions_at(side: Side) -> list[list[str]]:
    """Names of the different motions at each value, in the order of the ways; no failed ones.

    ``(left = right)`` stands behind those whose halves move alike. Two motions of one name are
    two where they are told apart, see ``diagram.differ``.
    """
    branches = [diagram_of([found]).branches[0] for found in side.results.values()]
    names = [
        _told_apart(side.motions(way), branch)
        for way, branch in zip(side.results, branches, strict=True)
    ]
    apart = {(i, j): differ(branches[i], branches[j]) for i in range(len(names)) for j in range(i)}
    found = []
    for k in range(len(side.axis)):
        kept: list[int] = []
        for i, row in enumerate(names):
            if row[k] != FAILED and all(apart[i, j][k] for j in kept):
                kept.append(i)
        found.append([names[i][k] for i in kept])
    return found


def _told_apart(names: Sequence[str], branch: Branch) -> list[str]:
    alike = branch.asymmetry <= SAME
    pairs = zip(names, alike, strict=True)
    return [f"{name} (left = right)" if same else name for name, same in pairs]
