"""Groups of channels that may have a common error: those of one quantity at a locus."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from herringbone_sim.arrays import Flags
from herringbone_sim.core.layout import KINDS, SIDES, Layout


@dataclass(frozen=True)
class Group:
    """Channels of one quantity at a locus.

    Attributes:
        quantity: ``x``, ``v`` or ``u``.
        kind: of mesh for x and v: ``sp``, ``rp``; of body for u: ``s``, ``c``, ``p``; or ``all``.
        planet: ``1`` ..., ``all``, or empty for names without planets.
        side: ``L``, ``R`` or ``all``.
        names: names of the channels.
    """

    quantity: str
    kind: str
    planet: str
    side: str
    names: tuple[str, ...]


def groups_of(layout: Layout, there: Flags | None = None) -> list[Group]:
    """Return all groups of the channels x, v and u.

    Of loci with the same recorded channels, only that with fewest channels of the layout.

    Args:
        layout: of the gear.
        there: (J,) whether each channel is recorded; None: all are.
    """
    names = sensor_names(layout)
    there = np.ones(len(names), dtype=bool) if there is None else there
    groups: dict[bytes, Group] = {}
    sizes: dict[bytes, int] = {}
    for quantity, kind, planet, side in product(
        "xvu",
        ("all", *KINDS, "s", "c", "p"),
        ("all", *layout.planets),
        ("all", *SIDES),
    ):
        inside = np.array([_inside(n, quantity, kind, planet, side) for n in names])
        members, size = inside & there, int(inside.sum())
        key = members.tobytes()
        if members.any() and size < sizes.get(key, len(names) + 1):
            chosen = tuple(n for n, m in zip(names, members, strict=True) if m)
            groups[key], sizes[key] = Group(quantity, kind, planet, side, chosen), size
    return list(groups.values())


def sensor_names(layout: Layout) -> tuple[str, ...]:
    """Return the names of all J channels x, v and u: by quantity, in the order of the layout."""
    return tuple(name for quantity in "xvu" for name in layout.channels_of(quantity))


def _inside(name: str, quantity: str, kind: str, planet: str, side: str) -> bool:
    """Whether a channel belongs to a quantity, a kind of mesh or body, a planet and a side."""
    q, body, *where = name.split("_")
    number = body.lstrip("sprc")
    return (
        q == quantity
        and kind in ("all", body.rstrip("0123456789"))
        and planet in ("all", number)
        and side in ("all", *where)
    )
