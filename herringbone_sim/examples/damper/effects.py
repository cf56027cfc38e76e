"""Tolerances, functions and hypotheses of the damper.

A function is the change of an observation by a unit amplitude, such as a force over time; a
hypothesis is an effect with the coefficients to fit, each a weighted sum of functions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numba import njit

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.coefficients import Coefficient, Placement
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.examples.damper import simulate
from herringbone_sim.examples.damper.simulate import SIGMA, STEP, Run

LAW, IMPULSE = "force law", "impulse"  # the two observations
# Grids of Stribeck's law, chosen as for lubricated contacts: velocity over which friction falls
# [m/s], and the excess of friction at rest over Coulomb friction, as a ratio.
STRIBECK_VELOCITIES = tuple(float(f) for f in np.geomspace(0.02, 0.1, 6).round(3))
STATIC_RATIOS = tuple(float(q) for q in np.geomspace(0.8, 2.0, 10).round(2))
TRAVELS = (1e-4, 2e-4, 4e-4)  # elastic travel before sliding [m]; values between are fitted


def sliding_direction(r: Run) -> Array:
    """(n,) expected direction of sliding, -1 to 1, given the measured v and its noise."""
    return np.asarray(np.tanh(r.v / (2.0 * SIGMA["v"])))


def stribeck_excess(falling: float) -> Callable[[Run], Array]:
    """Function of a run: friction (n,) of Stribeck's law above Coulomb's, of size 1 at rest.

    Args:
        falling: velocity over which it falls [m/s].
    """
    return lambda r: sliding_direction(r) * np.exp(-((r.v / falling) ** 2))


def stribeck_width_slope(falling: float) -> Callable[[Run], Array]:
    """Function of a run: derivative (n,) of ``stribeck_excess`` by log(``falling``)."""
    return lambda r: 2.0 * (r.v / falling) ** 2 * stribeck_excess(falling)(r)


LINEAR: Mapping[str, Callable[[Run], Array]] = {
    "c": lambda r: simulate.C * r.v,
    "friction": sliding_direction,
    **{f"fall {f}": stribeck_excess(f) for f in STRIBECK_VELOCITIES},
    **{f"later {f}": stribeck_width_slope(f) for f in STRIBECK_VELOCITIES},
    "cubic": lambda r: r.x**3,
    "gain": lambda r: r.F,
}
NONLINEAR = ("play", *(f"{what} {t}" for t in TRAVELS for what in ("slip", "longer")))
FUNCTIONS = {LAW: ("k", *LINEAR, *NONLINEAR), IMPULSE: ("mass", "gain")}


@njit(cache=True)  # type: ignore[untyped-decorator]
def dahl_state(v: Array, travel: float) -> Array:
    """(n,) state h of Dahl's friction, -1 to 1: dh/dt = (v - |v| h) / travel, ``travel`` in m."""
    h = np.zeros(len(v))
    for i in range(1, len(v)):
        step = 0.5 * (v[i - 1] + v[i]) * STEP
        to = np.sign(step)
        h[i] = to + (h[i - 1] - to) * np.exp(-abs(step) / travel)
    return h


def coefficient(
    name: str, sd: float, bound: float, runs: int, **parts: Mapping[str, float]
) -> Coefficient:
    """Coefficient that acts with the same weights in all runs.

    Args:
        name: name of the coefficient.
        sd: prior standard deviation.
        bound: largest absolute value.
        runs: number of runs.
        parts: weights by function, for the observations ``law`` and ``impulse``.
    """
    of = {"law": LAW, "impulse": IMPULSE}
    made = {
        of[o]: Placement((0,) * len(w), tuple(w), np.tile(list(w.values()), (runs, 1)))
        for o, w in parts.items()
    }
    return Coefficient(name, sd, bound, made)


def tolerances(runs: int) -> tuple[Coefficient, ...]:
    """Tolerances of stiffness, damping and mass, uniform: standard deviation bound / sqrt(3)."""

    def tolerance(name: str, bound: float, **parts: Mapping[str, float]) -> Coefficient:
        return coefficient(name, bound / np.sqrt(3.0), bound, runs, **parts)

    return (
        tolerance("k", simulate.K_SHARE, law={"k": 1.0}),
        tolerance("c", simulate.C_SHARE, law={"c": 1.0}),
        tolerance("mass", simulate.M_SHARE, impulse={"mass": 1.0}),
    )


def hypotheses(runs: int) -> list[Hypothesis]:
    """Catalogue of six effects, with a hypothesis for each shape of Stribeck's and Dahl's laws."""

    def main(effect: str, **parts: Mapping[str, float]) -> Coefficient:
        return coefficient(effect, simulate.MODERATE_SIZES[effect], np.inf, runs, **parts)

    def hypothesis(
        effect: str, *shape: Coefficient, own: Coefficient, **options: float
    ) -> Hypothesis:
        return Hypothesis(effect, tuple(options.items()), "mass", (own, *shape), 1)

    catalogue = [
        hypothesis("coulomb", own=main("coulomb", law={"friction": 1.0})),
        hypothesis("cubic", own=main("cubic", law={"cubic": 1.0})),
        hypothesis("play", own=main("play", law={"play": 1.0})),
        hypothesis("gain", own=main("gain", law={"gain": 1.0}, impulse={"gain": 1.0})),
    ]
    for f in STRIBECK_VELOCITIES:
        for q in STATIC_RATIOS:
            own = main("stribeck", law={"friction": 1.0, f"fall {f}": q})
            shape = _stribeck_departures(f, q, runs)
            catalogue.append(hypothesis("stribeck", *shape, own=own, falling=f, ratio=q))
    for t in TRAVELS:
        halfway = 0.5 * np.log(TRAVELS[1] / TRAVELS[0]) * simulate.MODERATE_SIZES["presliding"]
        longer = coefficient("longer", halfway, np.inf, runs, law={f"longer {t}": 1.0})
        own = main("presliding", law={f"slip {t}": 1.0})
        catalogue.append(hypothesis("presliding", longer, own=own, travel=t))
    return catalogue


def _stribeck_departures(
    falling: float, ratio: float, runs: int
) -> tuple[Coefficient, Coefficient]:
    """Departures from a grid point of Stribeck's law in ``falling`` [m/s] and ``ratio``.

    Prior standard deviation half a grid step; bound a whole one, as Coulomb's law is a limit.
    """
    size = ratio * simulate.MODERATE_SIZES["stribeck"]
    steps = (
        np.log(STRIBECK_VELOCITIES[1] / STRIBECK_VELOCITIES[0]),
        np.log(STATIC_RATIOS[1] / STATIC_RATIOS[0]),
    )
    later, more = (0.5 * size * step for step in steps)
    return (
        coefficient("later", later, 2.0 * later, runs, law={f"later {falling}": 1.0}),
        coefficient("more", more, 2.0 * more, runs, law={f"fall {falling}": 1.0}),
    )
