"""Every statement of the paper's sections 3 and 4 about a motion, as data.

A statement holds what is published; ``checks.check`` compares it with the computed motion.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from herringbone_sim.paper.scenarios import CHAOS, SCENARIOS, Scenario, motion_name


@dataclass(frozen=True)
class Statement:
    """What is published of one scenario.

    Attributes:
        scenario: its letter.
        text: the statement in words.
        published: its result as a short text.
    """

    scenario: str
    text: str
    published: str


@dataclass(frozen=True)
class WindowIs(Statement):
    """One motion (period, 0 for chaos) from ``low`` to ``high`` of the swept parameter."""

    low: float
    high: float
    motion: int


@dataclass(frozen=True)
class BoundaryAt(Statement):
    """The motion ``before`` (period, 0 = chaos) becomes ``after`` between ``low`` and ``high``.

    These are the printed ends of neighbouring windows, often equal.
    """

    low: float
    high: float
    before: int
    after: int


@dataclass(frozen=True)
class ExponentSign(Statement):
    """The largest exponent has one sign (+1 or -1) from ``low`` to ``high`` of the sweep."""

    low: float
    high: float
    sign: int


@dataclass(frozen=True)
class ChaosEnds(Statement):
    """Chaos ends at ``low``: there is none from there to ``high`` of the swept parameter."""

    low: float
    high: float


@dataclass(frozen=True)
class MotionAt(Statement):
    """The motion in one four-panel figure of the paper, at one value of the swept parameter."""

    value: float
    motion: int
    figure: str


@dataclass(frozen=True)
class Route(Statement):
    """The order of all motions along the sweep, as in the conclusions of the paper."""

    motions: tuple[int, ...]


FIGURES = (
    ("A", "Fig. 6", 20.0, CHAOS),
    ("A", "Fig. 7", 65.0, 3),
    ("A", "Fig. 8", 70.0, 2),
    ("A", "Fig. 9", 85.0, 1),
    ("B", "Fig. 11", 0.04, CHAOS),
    ("B", "Fig. 12", 0.13, 4),
    ("B", "Fig. 13", 0.15, 2),
    ("B", "Fig. 14", 0.17, 1),
    ("C", "Fig. 16", 0.1, CHAOS),
    ("C", "Fig. 17", 0.23, 4),
    ("C", "Fig. 18", 0.3, 2),
    ("C", "Fig. 19", 0.5, 1),
)
ENDS = (
    ("A", 64.0, 100.0, "a temperature rise above 64 ends chaos (abstract)"),
    ("B", 0.122, 0.18, "a damping ratio above 0.122 ends chaos (abstract)"),
    ("D", 43.0, 64.0, "the controller with K = 0.3 suppresses the chaos from 43 to 64"),
    ("E", 9.0, 64.0, "the controller with K = 0.5 suppresses the chaos from 9 to 64"),
)


def statements(keys: str = "ABCDE") -> tuple[Statement, ...]:
    """All statements about the scenarios with these letters, in the order of the paper."""
    chosen = [s for s in SCENARIOS if s.key in keys.upper()]
    return tuple(statement for scenario in chosen for statement in _of(scenario))


def _of(scenario: Scenario) -> Iterator[Statement]:
    yield from _windows(scenario)
    yield from boundaries(scenario)
    if scenario.has_exponents:
        yield from _signs(scenario)
    for key, low, high, text in ENDS:
        if key == scenario.key:
            yield ChaosEnds(key, text, f"{low:g}", low, high)
    for key, figure, value, motion in FIGURES:
        if key == scenario.key:
            name = motion_name(motion)
            text = f"{figure}: {scenario.parameter} = {value:g} is {name}"
            yield MotionAt(key, text, name, value, motion, figure)
    if scenario.has_exponents:
        motions = tuple(window.motion for window in scenario.windows)
        text = f"the route along {scenario.parameter} (conclusions)"
        yield Route(scenario.key, text, " - ".join(map(motion_name, motions)), motions)


def _windows(scenario: Scenario) -> Iterator[WindowIs]:
    for window in scenario.windows:
        implied = " (implied)" if window.implied else ""
        name = motion_name(window.motion)
        text = f"{name} for {window.low:g} < {scenario.parameter} < {window.high:g}{implied}"
        yield WindowIs(scenario.key, text, name, window.low, window.high, window.motion)


def boundaries(scenario: Scenario) -> Iterator[BoundaryAt]:
    """Yield the boundaries between the published windows of a scenario, in order."""
    for left, right in pairwise(scenario.windows):
        before, after = left.motion, right.motion
        text = f"{motion_name(before)} to {motion_name(after)} along {scenario.parameter}"
        low, high = left.high, right.low
        published = f"{low:g}" if low == high else f"{low:g} or {high:g}"
        yield BoundaryAt(scenario.key, text, published, low, high, before, after)


def _signs(scenario: Scenario) -> Iterator[ExponentSign]:
    for window in scenario.windows:
        sign = 1 if window.motion == CHAOS else -1
        word = "above" if sign > 0 else "below"
        span = f"{window.low:g} < {scenario.parameter} < {window.high:g}"
        text = f"largest exponent {word} 0 for {span}"
        published = "> 0" if sign > 0 else "< 0"
        yield ExponentSign(scenario.key, text, published, window.low, window.high, sign)
