"""A cause: which effect, where, of which shape and size; the truth that a label holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.random import Generator

from herringbone_sim.practice.machine import MESHES, Array, Machine

ALL = {"mesh": "all", "planet": "all", "side": "all"}
Point = Mapping[str, float]


@dataclass(frozen=True)
class Cause:
    """One effect in one rig.

    Attributes:
        effect: id of the catalogue, or ``unknown``.
        internal: name in the tables of this package.
        locus: mesh, planet, side; of sensors also the channels.
        shape: what was drawn besides the size.
        size: what is solved for, positive, in the unit of the first parameter.
    """

    effect: str
    internal: str
    locus: Mapping[str, Any]
    shape: Mapping[str, Any] = field(default_factory=dict)
    size: float = 1.0

    def sized(self, size: float) -> Cause:
        return replace(self, size=size)

    @property
    def sign(self) -> float:
        return float(self.shape.get("sign", 1.0))

    @property
    def meshes(self) -> Array:
        """(12,) 1 where the locus holds."""
        return mesh_mask(self.locus)


@dataclass(frozen=True)
class Kind:
    """How an effect is drawn, changes the machine and is told.

    Attributes:
        sense: where it shows: ``law``, ``body`` or ``sensor``.
        start, cap: size that is tried first, and the largest one.
        least: the smallest one that makes sense.
        draw: locus and shape, among the channels that there are.
        apply: the machine with the effect (none for sensors).
        tell: parameters of the catalogue: name to (value, unit).
    """

    sense: str
    start: float
    cap: float
    draw: Callable[[Generator, tuple[str, ...]], tuple[dict[str, Any], dict[str, Any]]]
    apply: Callable[[Machine, Cause, Point], Machine]
    tell: Callable[[Cause], dict[str, tuple[Any, str]]]
    least: float = 0.0


def mesh_mask(locus: Mapping[str, Any]) -> Array:
    """(12,) 1 on the meshes of a locus."""
    wanted = [str(locus.get(name, "all")) for name in ("mesh", "planet", "side")]
    parts = [(m[:2], m[2], m[4]) for m in MESHES]
    inside = [
        all(w in ("all", part) for w, part in zip(wanted, parts_m, strict=True))
        for parts_m in parts
    ]
    return np.array(inside, dtype=float)


def at(mesh: str = "all", planet: int | str = "all", side: str = "all") -> dict[str, Any]:
    """A locus."""
    return {"mesh": mesh, "planet": str(planet), "side": side}


def sign(rng: Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def anywhere(rng: Generator) -> dict[str, Any]:
    """All meshes of a kind, of a kind and planet, or a single mesh."""
    mesh, planet = str(rng.choice(["sp", "rp"])), int(rng.integers(1, 4))
    which = int(rng.integers(3))
    if which == 0:
        return at(mesh)
    return at(mesh, planet, "all" if which == 1 else str(rng.choice(["L", "R"])))


def by_kind(rng: Generator) -> dict[str, Any]:
    """All meshes, or all of a kind."""
    return at(str(rng.choice(["all", "sp", "rp"])))
