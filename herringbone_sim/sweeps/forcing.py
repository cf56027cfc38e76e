"""How long to observe a gear whose control or effects repeat after more than one mesh cycle."""

from __future__ import annotations

from collections.abc import Sequence

from herringbone_sim.analysis.periods import MIN_REPEATS
from herringbone_sim.core.model import Model
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import Active
from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.grid import Axis, Observation

REPEATS = 2 * MIN_REPEATS  # forcing periods to observe: a motion of two is detected too
LONGEST = 100  # longest forcing period [mesh cycles] of which REPEATS are observed unasked


def first_model(base: Parameters, actives: Sequence[Active], axes: Sequence[Axis]) -> Model:
    """Return the gear at the first value of each axis, at the largest K, as 0 has no period.

    The gear at the last values stands for it where no gear can have the first ones.

    Raises:
        ParameterError: no gear can have the last values either.
    """

    def gear(end: int) -> Model:
        values = {a.name: max(a.values, key=abs) if a.name == "K" else a.values[end] for a in axes}
        return build_with(base.changed(values), actives)

    try:
        return gear(0)
    except ParameterError:
        return gear(-1)


def observation_of(
    forcing: int, transient: int = 300, cycles: int | None = None, exponents: bool = True
) -> Observation:
    """Return an observation long enough for a forcing that repeats after ``forcing`` mesh cycles.

    ``REPEATS`` periods or more are observed if ``cycles`` says so or, without it, if the period is
    at most ``LONGEST``.
    """
    long = forcing <= LONGEST or cycles is not None
    points = max(Observation.points, REPEATS * forcing if long else 0)
    cycles = points if cycles is None else cycles
    return Observation(transient, cycles, min(cycles, points), exponents)
