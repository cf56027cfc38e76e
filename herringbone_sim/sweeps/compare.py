"""Compare the motions of two gears over one parameter, and match the boundaries between motions.

The period of a motion is counted in forcing periods of the gear: a motion that repeats once a
revolution because of a cracked tooth is P1 too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from herringbone_sim.sweeps.diagram import SAME, Branch, diagram_of, differ
from herringbone_sim.sweeps.grid import Axis
from herringbone_sim.sweeps.store import Result

Labels = Sequence[str]

APERIODIC, NOT_KNOWN = "aperiodic", "not known"
CONTACT = {0.0: "contact kept", 1.0: "one flank lost", 2.0: "both flanks hit"}
LEAST_STRETCH = 0.02  # of the values; shorter stretches are periodic windows, not regimes


@dataclass(frozen=True)
class GearSweeps:
    """Sweeps of one of the two gears over the same values of a parameter.

    Attributes:
        name: ``nominal`` or ``augmented``.
        results: results over the same n values, by the way in which a value is reached: ``fixed``,
            ``up`` or ``down`` as in ``Sweep.start``; ``random 1``, ... from random initial states.
        forcing: mesh cycles after which the gear with its effects repeats; 1 without effects.
    """

    name: str
    results: Mapping[str, Result]
    forcing: int = 1

    @property
    def axis(self) -> Axis:
        return next(iter(self.results.values())).axes[0]

    def motions(self, way: str) -> list[str]:
        """Name of the motion at n values, reached in one way; see ``motion``."""
        return [motion(value, self.forcing) for value in self.results[way]["period"]]

    def contacts(self, way: str) -> list[str]:
        """Contact loss at n values, reached in one way: of ``CONTACT`` or ``failed``."""
        return [CONTACT.get(float(loss), NOT_KNOWN) for loss in self.results[way]["contact_loss"]]


@dataclass(frozen=True)
class Boundary:
    """Parameter value at which the motion or the contact loss changes.

    Attributes:
        kind: ``motion`` or ``contact``.
        before, after: label below and above it.
        value: middle between the last value of the sweep below and the first above.
        half_width: half of their distance.
    """

    kind: str
    before: str
    after: str
    value: float
    half_width: float


@dataclass(frozen=True)
class BoundaryShift:
    """A boundary of the nominal gear and the matching one of the augmented gear; one may be None.

    Attributes:
        way: in which the values are reached, see ``GearSweeps.results``.
        nominal, augmented: the boundary of each gear.
    """

    way: str
    nominal: Boundary | None
    augmented: Boundary | None

    @property
    def boundary(self) -> Boundary:
        """The boundary of the nominal gear, else that of the augmented one."""
        boundary = self.nominal or self.augmented
        assert boundary is not None
        return boundary

    @property
    def shift(self) -> float:
        """Augmented minus nominal parameter value; NaN if only one gear has the boundary."""
        if self.nominal is None or self.augmented is None:
            return float("nan")
        return self.augmented.value - self.nominal.value

    @property
    def uncertainty(self) -> float:
        """Uncertainty of the shift: the sum of the half-widths."""
        return sum(
            boundary.half_width
            for boundary in (self.nominal, self.augmented)
            if boundary is not None
        )


@dataclass(frozen=True)
class Stretch:
    """Interval of the parameter in which several motions coexist.

    Attributes:
        low, high: first and last value of the parameter in it.
        motions: names of the motions, sorted, as in ``motions_at``.
    """

    low: float
    high: float
    motions: tuple[str, ...]


def motion(period: float, forcing: int = 1) -> str:
    """Name a motion by its period in mesh cycles: ``P2``, ``aperiodic`` (0) or
    ``not known`` (NaN: the run failed, or holds too few points).

    The number counts periods of ``forcing`` mesh cycles; ``N mesh cycles`` if it is not whole.
    """
    if not np.isfinite(period):
        return NOT_KNOWN
    cycles = int(period)
    if cycles == 0:
        return APERIODIC
    return f"P{cycles // forcing}" if cycles % forcing == 0 else f"{cycles} mesh cycles"


def label_stretches(labels: Labels) -> list[tuple[int, int, str]]:
    """First index, last index and label of each stretch of equal labels.

    Stretches shorter than 2 % of the labels are dropped; equal neighbours are then joined.
    """
    least = LEAST_STRETCH * len(labels)
    edges = [0, *(i for i in range(1, len(labels)) if labels[i] != labels[i - 1]), len(labels)]
    long = [(a, b - 1, labels[a]) for a, b in pairwise(edges) if b - a >= least]
    stretches: list[tuple[int, int, str]] = []
    for first, last, label in long:
        if stretches and stretches[-1][2] == label:
            stretches[-1] = (stretches[-1][0], last, label)
        else:
            stretches.append((first, last, label))
    return stretches


def boundaries(kind: str, values: Sequence[float], labels: Labels) -> list[Boundary]:
    """Boundaries of a kind between stretches of labels (n,) over rising parameter values (n,)."""
    return [
        Boundary(
            kind,
            before,
            after,
            (values[first] + values[last]) / 2.0,
            (values[first] - values[last]) / 2.0,
        )
        for (_, last, before), (first, _, after) in pairwise(label_stretches(labels))
    ]


def match_boundaries(nominal: GearSweeps, augmented: GearSweeps, way: str) -> list[BoundaryShift]:
    """Boundaries of both gears for one way to reach the values, equal changes matched.

    Of several equal changes the nearest in value are matched. Motions come first, then contacts.
    """
    shifts: list[BoundaryShift] = []
    for kind in ("motion", "contact"):
        mine, other = (_boundaries(side, way, kind) for side in (nominal, augmented))
        shifts += _matched(way, mine, other)
    return sorted(
        shifts, key=lambda shift: (shift.boundary.kind != "motion", shift.boundary.value)
    )


def _boundaries(side: GearSweeps, way: str, kind: str) -> list[Boundary]:
    labels = side.motions(way) if kind == "motion" else side.contacts(way)
    return boundaries(kind, side.axis.values, labels)


def _matched(way: str, nominal: list[Boundary], augmented: list[Boundary]) -> list[BoundaryShift]:
    """Pair boundaries with equal labels before and after, the nearest first; each is used once."""
    pairs = sorted(
        (abs(a.value - b.value), i, j)
        for i, a in enumerate(nominal)
        for j, b in enumerate(augmented)
        if (a.before, a.after) == (b.before, b.after)
    )
    partner: dict[int, int] = {}
    for _, i, j in pairs:
        if i not in partner and j not in partner.values():
            partner[i] = j
    both = [
        BoundaryShift(way, a, augmented[partner[i]] if i in partner else None)
        for i, a in enumerate(nominal)
    ]
    taken = set(partner.values())
    return both + [BoundaryShift(way, None, b) for j, b in enumerate(augmented) if j not in taken]


def shares(nominal: GearSweeps, augmented: GearSweeps, way: str) -> dict[str, tuple[float, float]]:
    """Fraction of the values (nominal, augmented) by name of the motion, most frequent first."""
    counts = [Counter(side.motions(way)) for side in (nominal, augmented)]
    n = len(nominal.axis)
    names = [name for name, _ in (counts[0] + counts[1]).most_common()]
    return {name: (counts[0][name] / n, counts[1][name] / n) for name in names}


def coexisting(side: GearSweeps) -> list[Stretch]:
    """Stretches of the values in which sweeps with different starts end in different motions.

    A new stretch begins where the set of motions (``motions_at``, without failed runs) changes.
    Stretches shorter than 2 % of the values are dropped, and equal neighbours joined over them.
    """
    at, values = motions_at(side), side.axis.values
    stretches = label_stretches(["\n".join(sorted(motions)) for motions in at])
    spans = [(values[a], values[b], tuple(label.split("\n"))) for a, b, label in stretches]
    return [Stretch(*span) for span in spans if len(span[2]) > 1]


def motions_at(side: GearSweeps) -> list[list[str]]:
    """Names of the different motions at each value, in the order of ``results``; no failed runs.

    A motion with equal halves has ``(left = right)`` in its name. Two motions of the same name are
    both listed if ``diagram.differ`` tells them apart.
    """
    branches = [diagram_of([result]).branches[0] for result in side.results.values()]
    names = [
        _with_symmetry(side.motions(way), branch)
        for way, branch in zip(side.results, branches, strict=True)
    ]
    apart = {(i, j): differ(branches[i], branches[j]) for i in range(len(names)) for j in range(i)}
    names_at = []
    for k in range(len(side.axis)):
        distinct: list[int] = []
        for i, row in enumerate(names):
            if row[k] != NOT_KNOWN and all(apart[i, j][k] for j in distinct):
                distinct.append(i)
        names_at.append([names[i][k] for i in distinct])
    return names_at


def _with_symmetry(names: Sequence[str], branch: Branch) -> list[str]:
    """Add ``(left = right)`` to the names (n) of known motions of an asymmetry up to ``SAME``."""
    alike = (branch.asymmetry <= SAME) & np.isfinite(branch.period)
    pairs = zip(names, alike, strict=True)
    return [f"{name} (left = right)" if same else name for name, same in pairs]
