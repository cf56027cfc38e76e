"""What a row is: a method, its work, and what was measured of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from herringbone_sim.arrays import Array


@dataclass(frozen=True)
class OrbitMethod:
    """A method on work (a).

    Attributes:
        family: methods that differ by their setting alone; costs are interpolated within one.
        setting: tolerance, or order and steps.
        run: takes a number of mesh cycles, gives the end state (8,) from ``orbit_start``.
        lanes: orbits that one run advances at once; the cost is that of one.
    """

    family: str
    setting: str
    run: Callable[[int], Array]
    lanes: int = 1


@dataclass(frozen=True)
class SweepMethod:
    """A method on work (b) or (c).

    Attributes:
        family: who.
        setting: tolerance, or order and steps.
        run: takes temperature rises (n,); gives sections (n, SECTIONS, 8) for (b), exponents (n,)
            for (c).
        most: values that it is given; the whole is scaled up when there are more.
        cores: threads it uses.
        remark: called after a run, for the note in the table.
    """

    family: str
    setting: str
    run: Callable[[Array], Array]
    most: int = 100_000
    cores: int = 1
    remark: Callable[[], str] = str
