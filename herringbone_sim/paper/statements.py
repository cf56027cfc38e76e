"""Every statement of the paper's sections 3 and 4 about a motion, as data.

A statement holds what is published; ``checks.check`` compares it with the computed motion. Each
has the letter of its ``scenario``, a ``text``, and its ``published`` result as a short text.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from herringbone_sim.paper.scenarios import CHAOS, SCENARIOS, Scenario, motion_name


@dataclass(frozen=True)
class WindowIs:
    """One motion (period, 0 for chaos) from ``low`` to ``high`` of the swept parameter."""

    scenario: str
    text: str
    low: float
    high: float
    motion: int

    @property
    def published(self) -> str:
        return motion_name(self.motion)


@dataclass(frozen=True)
class BoundaryAt:
    """The motion ``before`` (period, 0 = chaos) becomes ``after`` between ``low`` and ``high``.

    These are the printed ends of neighbouring windows, often equal.
    """

    scenario: str
    text: str
    low: float
    high: float
    before: int
    after: int

    @property
    def published(self) -> str:
        return f"{self.low:g}" if self.low == self.high else f"{self.low:g} or {self.high:g}"


@dataclass(frozen=True)
class ExponentSign:
    """The largest exponent has one sign (+1 or -1) from ``low`` to ``high`` of the sweep."""

    scenario: str
    text: str
    low: float
    high: float
    sign: int

    @property
    def published(self) -> str:
        return "> 0" if self.sign > 0 else "< 0"


@dataclass(frozen=True)
class ChaosEnds:
    """Chaos ends at ``low``: there is none from there to ``high`` of the swept parameter."""

    scenario: str
    text: str
    low: float
    high: float

    @property
    def published(self) -> str:
        return f"{self.low:g}"


@dataclass(frozen=True)
class MotionAt:
    """The motion in one four-panel figure of the paper, at one value of the swept parameter."""

    scenario: str
    text: str
    value: float
    motion: int
    figure: str

    @property
    def published(self) -> str:
        return motion_name(self.motion)


@dataclass(frozen=True)
class Route:
    """The order of all motions along the sweep, as in the conclusions of the paper."""

    scenario: str
    text: str
    motions: tuple[int, ...]

    @property
    def published(self) -> str:
        return " - ".join(map(motion_name, self.motions))


Statement = WindowIs | BoundaryAt | ExponentSign | ChaosEnds | MotionAt | Route

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
            yield ChaosEnds(key, text, low, high)
    for key, figure, value, motion in FIGURES:
        if key == scenario.key:
            text = f"{figure}: {scenario.parameter} = {value:g} is {motion_name(motion)}"
            yield MotionAt(key, text, value, motion, figure)
    if scenario.has_exponents:
        motions = tuple(window.motion for window in scenario.windows)
        yield Route(scenario.key, f"the route along {scenario.parameter} (conclusions)", motions)


def _windows(scenario: Scenario) -> Iterator[WindowIs]:
    for window in scenario.windows:
        implied = " (implied)" if window.implied else ""
        name = motion_name(window.motion)
        text = f"{name} for {window.low:g} < {scenario.parameter} < {window.high:g}{implied}"
        yield WindowIs(scenario.key, text, window.low, window.high, window.motion)


def boundaries(scenario: Scenario) -> Iterator[BoundaryAt]:
    """Yield the boundaries between the published windows of a scenario, in order."""
    for left, right in pairwise(scenario.windows):
        text = (
            f"{motion_name(left.motion)} to {motion_name(right.motion)} along {scenario.parameter}"
        )
        yield BoundaryAt(scenario.key, text, left.high, right.low, left.motion, right.motion)


def _signs(scenario: Scenario) -> Iterator[ExponentSign]:
    for window in scenario.windows:
        sign = 1 if window.motion == CHAOS else -1
        word = "above" if sign > 0 else "below"
        span = f"{window.low:g} < {scenario.parameter} < {window.high:g}"
        text = f"largest exponent {word} 0 for {span}"
        yield ExponentSign(scenario.key, text, window.low, window.high, sign)
