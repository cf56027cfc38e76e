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
# Friction falls over so many [m/s], from so many times more than the rest: lubricated contacts.
FALLING = tuple(float(f) for f in np.geomspace(0.02, 0.1, 6).round(3))
RATIO = tuple(float(q) for q in np.geomspace(0.8, 2.0, 10).round(2))
TRAVEL = (1e-4, 2e-4, 4e-4)  # [m] elastic before sliding; between them it is fitted


def slides(r: Run) -> Array:
    """Direction of sliding, expected under the noise of v."""
    return np.asarray(np.tanh(r.v / (2.0 * SIGMA["v"])))


def fall(falling: float) -> Callable[[Run], Array]:
    """What Stribeck's law has more than Coulomb's, per unit at rest."""
    return lambda r: slides(r) * np.exp(-((r.v / falling) ** 2))


def later(falling: float) -> Callable[[Run], Array]:
    """Its derivative by the logarithm of ``falling``."""
    return lambda r: 2.0 * (r.v / falling) ** 2 * fall(falling)(r)


FIXED: Mapping[str, Callable[[Run], Array]] = {
    "c": lambda r: simulate.C * r.v,
    "friction": slides,
    **{f"fall {f}": fall(f) for f in FALLING},
    **{f"later {f}": later(f) for f in FALLING},
    "cubic": lambda r: r.x**3,
    "gain": lambda r: r.F,
}
BENT = ("play", *(f"{what} {t}" for t in TRAVEL for what in ("slip", "longer")))
FUNCTIONS = {LAW: ("k", *FIXED, *BENT), IMPULSE: ("mass", "gain")}


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
    name: str, sd: float, bound: float, runs: int, **parts: Mapping[str, float]
) -> Coefficient:
    """A number that acts alike in all runs: weights of functions by observation."""
    of = {"law": LAW, "impulse": IMPULSE}
    made = {
        of[o]: Part((0,) * len(w), tuple(w), np.tile(list(w.values()), (runs, 1)))
        for o, w in parts.items()
    }
    return Coefficient(name, sd, bound, made)


def tolerances(runs: int) -> tuple[Coefficient, ...]:
    """Spread evenly inside the bounds of the data sheet: standard deviation bound / sqrt(3)."""

    def one(name: str, bound: float, **parts: Mapping[str, float]) -> Coefficient:
        return coefficient(name, bound / np.sqrt(3.0), bound, runs, **parts)

    return (
        one("k", simulate.K_SHARE, law={"k": 1.0}),
        one("c", simulate.C_SHARE, law={"c": 1.0}),
        one("mass", simulate.M_SHARE, impulse={"mass": 1.0}),
    )


def hypotheses(runs: int) -> list[Hypothesis]:
    """All six effects; of Stribeck's and Dahl's laws one with each shape."""

    def main(effect: str, **parts: Mapping[str, float]) -> Coefficient:
        return coefficient(effect, simulate.MODERATE[effect], np.inf, runs, **parts)

    def one(effect: str, *shape: Coefficient, own: Coefficient, **options: float) -> Hypothesis:
        return Hypothesis(effect, tuple(options.items()), "mass", (own, *shape), 1)

    found = [
        one("coulomb", own=main("coulomb", law={"friction": 1.0})),
        one("cubic", own=main("cubic", law={"cubic": 1.0})),
        one("play", own=main("play", law={"play": 1.0})),
        one("gain", own=main("gain", law={"gain": 1.0}, impulse={"gain": 1.0})),
    ]
    for f in FALLING:
        for q in RATIO:
            own = main("stribeck", law={"friction": 1.0, f"fall {f}": q})
            found.append(one("stribeck", *_falls(f, q, runs), own=own, falling=f, ratio=q))
    for t in TRAVEL:
        halfway = 0.5 * np.log(TRAVEL[1] / TRAVEL[0]) * simulate.MODERATE["presliding"]
        shape = coefficient("longer", halfway, np.inf, runs, law={f"longer {t}": 1.0})
        own = main("presliding", law={f"slip {t}": 1.0})
        found.append(one("presliding", shape, own=own, travel=t))
    return found


def _falls(falling: float, ratio: float, runs: int) -> tuple[Coefficient, Coefficient]:
    """Departures halfway to the next shapes; bounded, or Stribeck's law could become Coulomb's."""
    size = ratio * simulate.MODERATE["stribeck"]
    steps = np.log(FALLING[1] / FALLING[0]), np.log(RATIO[1] / RATIO[0])
    later, more = (0.5 * size * step for step in steps)
    return (
        coefficient("later", later, 2.0 * later, runs, law={f"later {falling}": 1.0}),
        coefficient("more", more, 2.0 * more, runs, law={f"fall {falling}": 1.0}),
    )
