"""Where a branch of periodic orbits begins: the motion at a value, or an orbit near it."""

from __future__ import annotations

import math

from herringbone_sim.analysis.periods import find_period
from herringbone_sim.dynamics.curve import Family
from herringbone_sim.dynamics.flow import GearFlow, settle
from herringbone_sim.dynamics.gear_family import Gears
from herringbone_sim.dynamics.orbits import (
    Array,
    closest_return,
    find_orbit,
    iterate,
    least_period,
)
from herringbone_sim.errors import AnalysisError, ParameterError

WINDOW, RETURNS = 160, 2000  # periods of the forcing in which a period, a return, is looked for


def find_start(
    gears: Gears, family: Family, value: float, period: int | None = None, settled: int = 1000
) -> Array:
    """States (period, n) of the orbit at a value of the parameter.

    Args:
        gears: flow of each value.
        family: in which the orbit will be followed.
        value: of the parameter.
        period: of an orbit near the motion, stable or not [periods of the forcing]; None for that
            of the motion itself, which must be periodic then.
        settled: mesh cycles that pass before the motion is looked at.

    Raises:
        ParameterError: the value lies outside of the family.
        AnalysisError: the motion is not periodic, or there is no orbit of that period near.
    """
    name = f"{gears.name} = {value:g}"
    if not family.low <= value <= family.high:
        raise ParameterError(
            f"an orbit must start in {family.low:g} .. {family.high:g}, got {name}"
        )
    flow = gears(value)
    y = settle(flow, flow.start(), math.ceil(settled / flow.cycles))
    states = _periodic(flow, y, period, name)
    orbit = find_orbit(flow, states, mirror=family.mirror)
    if not orbit.found:
        raise AnalysisError(
            f"no orbit of {orbit.period} cycles at {name}: {orbit.reason}; start at another value"
        )
    return orbit.points[: least_period(orbit.points)]


def _periodic(flow: GearFlow, y: Array, period: int | None, name: str) -> Array:
    """States (period, n) of a motion that is periodic, or that nearly closes."""
    if period:
        return closest_return(flow, y, period, RETURNS)
    states = iterate(flow, y, WINDOW)
    found = find_period(states).value
    if not found:
        raise AnalysisError(
            f"the motion at {name} is not periodic: start at another value, or look for an "
            "unstable orbit of N cycles near it (VALUE:N)"
        )
    return states[-found:]
