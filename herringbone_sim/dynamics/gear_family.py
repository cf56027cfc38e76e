"""The gears over the range of one live parameter, as continuation wants them."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence

from herringbone_sim.core.batch import layout_mirror
from herringbone_sim.core.parameters import Parameters, live_names
from herringbone_sim.dynamics.boundaries import Watch
from herringbone_sim.dynamics.curve import Family
from herringbone_sim.dynamics.flow import GearFlow, symmetry
from herringbone_sim.dynamics.orbits import Array
from herringbone_sim.dynamics.turning import border_passes
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import Active
from herringbone_sim.errors import ParameterError

SWEPT = tuple(name for name in live_names() if name != "samples_per_cycle")
KEPT = 8


class Gears:
    """Gears by the value of a parameter; the last few are kept, Newton asks for them again.

    Args:
        p: all other parameters.
        name: one of ``SWEPT``.
        actives: effects of the gear.

    Raises:
        ParameterError: another parameter.
    """

    def __init__(self, p: Parameters, name: str, actives: Sequence[Active] = ()) -> None:
        if name not in SWEPT:
            raise ParameterError(f"orbits go over one of {', '.join(SWEPT)}, got {name!r}")
        self._p, self.name, self._actives = p, name, actives
        self._kept: OrderedDict[float, GearFlow] = OrderedDict()

    def __call__(self, value: float) -> GearFlow:
        """The gear at a value; ParameterError where there is none."""
        if value not in self._kept:
            p = self._p.changed({self.name: value})
            self._kept[value] = GearFlow(build_with(p, self._actives))
            if len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        return self._kept[value]


def gear_family(
    p: Parameters, name: str, low: float, high: float, actives: Sequence[Active] = ()
) -> tuple[Family, Watch]:
    """The family of a gear with effects over a parameter, and the watch on its borders.

    Raises:
        ParameterError: an empty range, an end of it that no gear can have, or another parameter.
    """
    if not low < high:
        raise ParameterError(f"the range of {name} must ascend, got {low:g} .. {high:g}")
    gears = Gears(p, name, actives)
    alike = [symmetry(gears(value).model) is not None for value in (low, high)]
    sides = layout_mirror(p.layout) if all(alike) else None

    def watch(value: float, points: Array) -> dict[str, int]:
        return border_passes(gears(value), points, sides)

    return Family(gears, low, high, sides), watch
