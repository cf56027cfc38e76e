"""Gears over the range of one live parameter, as a ``Family`` for continuation."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence

from herringbone_sim.arrays import Array
from herringbone_sim.core.parameters import Parameters, live_names
from herringbone_sim.dynamics.boundaries import Watch
from herringbone_sim.dynamics.curve import Family
from herringbone_sim.dynamics.flow import GearFlow, period_of, symmetry
from herringbone_sim.dynamics.turning import border_passes
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import Active
from herringbone_sim.errors import ParameterError

SWEPT = tuple(name for name in live_names() if name != "samples_per_cycle")
CACHE_SIZE = 8  # flows


class GearCache:
    """Flows of a gear by the value of one parameter, the last eight cached for Newton's method.

    Args:
        p: all other parameters.
        name: the parameter, one of ``SWEPT``.
        actives: effects of the gear.

    Raises:
        ParameterError: the name is not in ``SWEPT``.
    """

    def __init__(self, p: Parameters, name: str, actives: Sequence[Active] = ()) -> None:
        if name not in SWEPT:
            raise ParameterError(f"orbits go over one of {', '.join(SWEPT)}, got {name!r}")
        self._p, self.name, self._actives = p, name, actives
        controlled = build_with(p.changed({"K": 1.0}), actives) if name == "K" else None
        self._cycles = None if controlled is None else period_of(controlled)
        self._cache: OrderedDict[float, GearFlow] = OrderedDict()

    def __call__(self, value: float) -> GearFlow:
        """Return the flow of the gear at a value; ParameterError if no gear can have it."""
        if value not in self._cache:
            p = self._p.changed({self.name: value})
            self._cache[value] = GearFlow(build_with(p, self._actives), self._cycles)
            if len(self._cache) > CACHE_SIZE:
                self._cache.popitem(last=False)
        return self._cache[value]


def gear_family(
    p: Parameters, name: str, low: float, high: float, actives: Sequence[Active] = ()
) -> tuple[Family, Watch]:
    """Return the flows of a gear over a parameter range, and its count of backlash-edge crossings.

    The family has a left-right symmetry if the halves are equal at three values of the range, both
    ends and the middle. The count is for ``boundaries.find_boundaries``.

    Raises:
        ParameterError: an empty range, an end or the middle of it that no gear can have, or an
            unknown parameter.
    """
    if not low < high:
        raise ParameterError(f"the range of {name} must ascend, got {low:g} .. {high:g}")
    gears = GearCache(p, name, actives)
    exchanges = [symmetry(gears(value).model) for value in (low, 0.5 * (low + high), high)]
    sides = exchanges[0] if all(exchange is not None for exchange in exchanges) else None

    def watch(value: float, points: Array) -> dict[str, int]:
        return border_passes(gears(value), points, sides)

    return Family(gears, low, high, sides), watch
