"""First orbit of a continuation: the periodic motion at a parameter value, or an orbit near it."""

from __future__ import annotations

import math

from herringbone_sim.analysis.periods import find_period
from herringbone_sim.arrays import Array
from herringbone_sim.dynamics.curve import Family
from herringbone_sim.dynamics.flow import GearFlow, iterate, settle
from herringbone_sim.dynamics.gear_family import GearCache
from herringbone_sim.dynamics.orbits import closest_return, find_orbit, least_period
from herringbone_sim.errors import AnalysisError, ParameterError

# Forcing periods in which the period of the motion, or its closest return, is looked for.
WINDOW, RETURNS = 160, 2000


def find_start(
    gears: GearCache, family: Family, value: float, period: int | None = None, settled: int = 1000
) -> Array:
    """Find a periodic orbit at one value of the parameter, as the first of a continuation.

    Args:
        gears: returns the flow of the gear at a value of the parameter.
        family: range of the parameter and symmetry of the continuation.
        value: of the parameter.
        period: period of the orbit [forcing periods]; the orbit may be unstable, Newton's method
            starts at the closest return of the motion. None: the motion itself must be periodic.
        settled: mesh cycles of transient that are integrated first.

    Returns:
        (period, n) states at phase 0, one per forcing period; ``period`` is the least period.

    Raises:
        ParameterError: the value lies outside of the family.
        AnalysisError: the motion is not periodic, or Newton's method finds no orbit near it.
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
    """First guess (period, n) of an orbit, from the state y after the transient.

    One period of the motion; with a given ``period``, the closest return of the motion.
    """
    if period:
        return closest_return(flow, y, period, RETURNS)
    states = iterate(flow, y, WINDOW)
    detected = find_period(states).value
    if not detected:
        raise AnalysisError(
            f"the motion at {name} is not periodic: start at another value, or look for an "
            "unstable orbit of N cycles near it (VALUE:N)"
        )
    return states[-detected:]
