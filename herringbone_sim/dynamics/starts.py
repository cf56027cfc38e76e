"""First orbit of a continuation: the motion at a parameter value, or an orbit near it."""

from __future__ import annotations

import math

from herringbone_sim.analysis.periods import find_period
from herringbone_sim.arrays import Array
from herringbone_sim.dynamics.curve import Family
from herringbone_sim.dynamics.flow import GearFlow, settle
from herringbone_sim.dynamics.gear_family import GearCache
from herringbone_sim.dynamics.orbits import closest_return, find_orbit, iterate, least_period
from herringbone_sim.errors import AnalysisError, ParameterError

# Forcing periods searched for the period of the motion, and for its closest return.
WINDOW, RETURNS = 160, 2000


def find_start(
    gears: GearCache, family: Family, value: float, period: int | None = None, settled: int = 1000
) -> Array:
    """States (period, n) of an orbit at a value of the parameter.

    Args:
        gears: flow of each value.
        family: in which the orbit will be continued.
        value: of the parameter.
        period: period of the orbit [forcing periods], stable or not, looked for near the motion;
            None for the motion itself, which must be periodic then.
        settled: mesh cycles of transient left out.

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
    if not orbit.converged:
        raise AnalysisError(
            f"no orbit of {orbit.period} cycles at {name}: {orbit.reason}; start at another value"
        )
    return orbit.points[: least_period(orbit.points)]


def _periodic(flow: GearFlow, y: Array, period: int | None, name: str) -> Array:
    """States (period, n) of the periodic motion, or of its closest return for a given period."""
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
