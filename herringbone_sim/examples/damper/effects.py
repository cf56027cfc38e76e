"""What may be wrong with a damper: tolerances, functions of what is measured, and hypotheses.

A function says what one unit adds to the force; a hypothesis is a few coefficients of functions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numba import njit
from numpy.typing import NDArray

from herringbone_sim.diagnosis.products import Coefficient, Part
from herringbone_sim.diagnosis.search import Hypothesis
from herringbone_sim.examples.damper import simulate
from herringbone_sim.examples.damper.simulate import SIGMA, STEP, Run

Array = NDArray[np.float64]
LAW, IMPULSE = "force law", "impulse"  # the two observations
FALLING = (
    0.02,
    0.028,
    0.039,
    0.054,
    0.075,
    0.1,
)  # [m/s] over which friction falls: the range of lubricated contacts
RATIO = (0.8, 1.1, 1.5, 2.0)  # by how much more than the rest it falls
TRAVEL = (1e-4, 2e-4, 4e-4)  # [m] elastic before sliding; between them it is fitted


def _stribeck(falling: float, ratio: float) -> Callable[[Run], Array]:
    return lambda r: slides(r) * (1.0 + ratio * np.exp(-((r.v / falling) ** 2)))


def slides(r: Run) -> Array:
    """Direction of sliding, expected under the noise of v."""
    return np.asarray(np.tanh(r.v / (2.0 * SIGMA["v"])))


FIXED: Mapping[str, Callable[[Run], Array]] = {
    "c": lambda r: simulate.C * r.v,
    "friction": slides,
    **{f"stribeck {f} {q}": _stribeck(f, q) for f in FALLING for q in RATIO},
    "cubic": lambda r: r.x**3,
    "gain": lambda r: r.F,
}
BENT = ("k", "play", *(f"{what} {t}" for t in TRAVEL for what in ("slip", "longer")))
FUNCTIONS = {LAW: (*FIXED, *BENT), IMPULSE: ("mass", "gain")}


@njit(cache=True)  # type: ignore[untyped-decorator]
def slip(v: Array, travel: float) -> Array:
    """Dahl's state at each sample, from -1 to 1: dh/dt = (v - |v| h) / travel."""
    h = np.zeros(len(v))
    for i in range(1, len(v)):
        step = 0.5 * (v[i - 1] + v[i]) * STEP
        to = np.sign(step)
        h[i] = to + (h[i - 1] - to) * np.exp(-abs(step) / travel)
    return h


def coefficient(
    name: str, sd: float, bound: float, runs: int, *at: tuple[str, str]
) -> Coefficient:
    """A number that acts alike in all runs; ``at`` are observations and functions."""
    parts = {o: Part((0,), (f,), np.ones((runs, 1))) for o, f in at}
    return Coefficient(name, sd, bound, parts)


def tolerances(runs: int) -> tuple[Coefficient, ...]:
    """Spread evenly inside the bounds of the data sheet: standard deviation bound / sqrt(3)."""
    bounds = {"k": (simulate.K_SHARE, LAW), "c": (simulate.C_SHARE, LAW)}
    bounds["mass"] = simulate.M_SHARE, IMPULSE
    return tuple(
        coefficient(name, b / np.sqrt(3.0), b, runs, (o, name)) for name, (b, o) in bounds.items()
    )


def hypotheses(runs: int) -> list[Hypothesis]:
    """All six effects; of Stribeck's and Dahl's laws one with each shape."""

    def one(effect: str, *coefficients: Coefficient, **options: float) -> Hypothesis:
        n = len(coefficients)
        return Hypothesis(effect, tuple(options.items()), "mass", coefficients, n)

    def of(effect: str, name: str, *at: str) -> Coefficient:
        places = [(o, name) for o in at or (LAW,)]
        return coefficient(name, simulate.MODERATE[effect], np.inf, runs, *places)

    found = [one("coulomb", of("coulomb", "friction")), one("cubic", of("cubic", "cubic"))]
    found += [one("play", of("play", "play")), one("gain", of("gain", "gain", LAW, IMPULSE))]
    for f in FALLING:
        for q in RATIO:
            shape = of("stribeck", f"stribeck {f} {q}")
            found.append(one("stribeck", shape, falling=f, ratio=q))
    for t in TRAVEL:
        both = of("presliding", f"slip {t}"), of("presliding", f"longer {t}")
        found.append(one("presliding", *both, travel=t))
    return found
