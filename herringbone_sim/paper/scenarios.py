"""The five sweeps of sections 3 and 4 of the paper, with the motions published along them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.errors import AnalysisError

CHAOS = 0
FAILED = -1
SECTION_4_XI_PRINTED = 0.10
SECTION_4_XI = 0.0875


@dataclass(frozen=True)
class Window:
    """Published motion over part of a sweep: period in mesh cycles, 0 for chaos.

    ``implied``: not stated by the paper, but it follows from its statements.
    """

    low: float
    high: float
    motion: int
    implied: bool = False


@dataclass(frozen=True)
class Scenario:
    """One published sweep.

    Attributes:
        key: ``A`` to ``E``.
        title: the swept parameter in words.
        figure: number in the paper, as ``Fig. 5``.
        parameter: swept parameter.
        low, high: ends of the sweep; the paper does not print those of scenarios C, D and E.
        fixed: parameters set at every value, whether or not they are those of section 3.
        says: statements of the paper about it, shortened.
        windows: motions along the sweep, in order, published or ``implied``. Gaps: where two
            printed numbers disagree, and where the paper says nothing.
        controlled: whether it belongs to section 4; the xi printed there does not fit its figures.
        has_exponents: whether the paper shows the largest Lyapunov exponent over it.
    """

    key: str
    title: str
    figure: str
    parameter: str
    low: float
    high: float
    windows: tuple[Window, ...]
    says: tuple[str, ...]
    fixed: Mapping[str, float] = field(default_factory=dict)
    controlled: bool = False
    has_exponents: bool = True

    def values(self, n: int) -> Array:
        """(n,) evenly spaced values of the swept parameter, ends included."""
        return np.linspace(self.low, self.high, n)

    def parameters(self, reading: Parameters, value: float, xi: float) -> Parameters:
        """Parameters at one value of the sweep, with one sample a mesh cycle.

        Args:
            reading: parameters of section 3.
            value: value of the swept parameter.
            xi: damping ratio of section 4, used if the scenario is ``controlled``.
        """
        of_section = {"xi": xi} if self.controlled else {}
        changes = {**self.fixed, **of_section, self.parameter: float(value)}
        return reading.changed({**changes, "samples_per_cycle": 1})


def _controlled(key: str, K: float, ends: tuple[float, float, float]) -> Scenario:
    """Sweep of Fig. 20 over the temperature rise under control of amplitude K.

    Args:
        ends: published ends of chaos, of period 2 and of period 1.
    """
    chaos, period_2, period_1 = ends
    windows = (
        Window(0, chaos, CHAOS, implied=True),
        Window(chaos, period_2, 2),
        Window(period_2, period_1, 1),
    )
    says = (
        f"With K = {K:g} chaos is suppressed to two-period motion from {chaos:g} to {period_2:g}, "
        f"and to one-period motion from {period_2:g} to {period_1:g}.",
        "The control applies over the entire temperature range.",
    )
    title = f"temperature rise under K = {K:g}"
    ranges = ("delta_T", 0.0, 100.0)
    return Scenario(key, title, "Fig. 20", *ranges, windows, says, {"K": K}, True, False)


SCENARIOS = (
    Scenario(
        "A",
        "temperature rise",
        "Fig. 5",
        "delta_T",
        0.0,
        100.0,
        (Window(0, 64, CHAOS), Window(64, 67, 3), Window(67, 80, 2), Window(80, 100, 1)),
        (
            "From 0 to 64 the system is chaotic, the largest exponent is above 0.",
            "At 64 it turns to three-period motion, the exponent from positive to negative.",
            "From 67 to 80 two-period motion, above 80 one-period motion; the exponent remains "
            "below 0.",
            "Higher temperature rise (above 64) makes the system enter stable periodic motion.",
        ),
        {"xi": 0.07, "K": 0.0},
    ),
    Scenario(
        "B",
        "mesh damping ratio",
        "Fig. 10",
        "xi",
        0.02,
        0.18,
        (
            Window(0.02, 0.122, CHAOS),
            Window(0.122, 0.144, 4),
            Window(0.145, 0.163, 2),
            Window(0.163, 0.18, 1),
        ),
        (
            "Initially chaos, the exponent above 0; as Fig. 11 at 0.04.",
            "From 0.122 to 0.144 four-period motion; the exponent turns negative.",
            "Inverse period doublings at 0.145 and 0.163: to two periods, to one.",
            "Temperature rise 50. Larger damping (above 0.122) makes the motion periodic.",
        ),
        {"delta_T": 50.0, "K": 0.0},
    ),
    Scenario(
        "C",
        "control amplitude",
        "Fig. 15",
        "K",
        0.0,
        0.5,
        (
            Window(0.0, 0.224, CHAOS),
            Window(0.224, 0.242, 4),
            Window(0.242, 0.33, 2),
            Window(0.33, 0.5, 1),
        ),
        (
            "Temperature rise 50, damping ratio 0.10 (printed; open, see docs/paper.md).",
            "From 0 to 0.224 chaos, the exponent above 0; at 0.224 four-period motion, below 0.",
            "From 0.242 to 0.33 two-period motion, above 0.33 one-period motion.",
        ),
        {"delta_T": 50.0},
        controlled=True,
    ),
    _controlled("D", 0.3, (43, 53, 64)),
    _controlled("E", 0.5, (9, 14, 64)),
)


def scenario(key: str) -> Scenario:
    """Return the scenario with a letter; AnalysisError if there is none."""
    for candidate in SCENARIOS:
        if candidate.key == key.upper():
            return candidate
    raise AnalysisError(
        f"scenario must be one of {', '.join(s.key for s in SCENARIOS)}, got {key!r}"
    )


def motion_name(motion: int) -> str:
    """Name of a motion: ``chaos`` (0), ``failed`` (-1) or, by its period, ``P3``."""
    return {CHAOS: "chaos", FAILED: "failed"}.get(motion, f"P{motion}")
