"""Causes: effects with locus, shape and size as a label holds them, and how they are drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.random import Generator

from herringbone_sim.arrays import Array
from herringbone_sim.practice.rig_model import MESHES, RigModel

ALL = {"mesh": "all", "planet": "all", "side": "all"}
Point = Mapping[str, float]
Drawn = tuple[dict[str, Any], dict[str, Any]]  # locus and shape


@dataclass(frozen=True)
class Cause:
    """One effect in one rig.

    Attributes:
        effect: id in the catalogue, or ``unknown``.
        internal: key in ``plan.KINDS``, also of causes outside the catalogue.
        locus: mesh, planet, side; of sensors also the channels.
        shape: drawn properties other than the size.
        size: positive, solved for; ``Kind.parameters`` converts it to the catalogue's parameters.
    """

    effect: str
    internal: str
    locus: Mapping[str, Any]
    shape: Mapping[str, Any] = field(default_factory=dict)
    size: float = 1.0

    def sized(self, size: float) -> Cause:
        """Return a copy of the cause with another size."""
        return replace(self, size=size)

    @property
    def sign(self) -> float:
        """Drawn sign of the size, 1 if the effect has none."""
        return float(self.shape.get("sign", 1.0))

    @property
    def meshes(self) -> Array:
        """Mask (12,): 1 on the meshes of the locus, else 0."""
        return mesh_mask(self.locus)


@dataclass(frozen=True)
class Kind:
    """How a kind of effect is drawn, applied and labelled.

    Attributes:
        sense: where it shows: ``law`` (mesh force law), ``body`` (balance of a body) or
            ``sensor``.
        start, cap: size that is tried first, and largest size.
        draw: draws locus and shape; gets the names of the recorded channels.
        apply: returns the rig model with the effect (unchanged for sensors).
        parameters: returns the catalogue's parameters: name to (value, unit).
        least: smallest size.
    """

    sense: str
    start: float
    cap: float
    draw: Callable[[Generator, tuple[str, ...]], Drawn]
    apply: Callable[[RigModel, Cause, Point], RigModel]
    parameters: Callable[[Cause], dict[str, tuple[Any, str]]]
    least: float = 0.0


def mesh_mask(locus: Mapping[str, Any]) -> Array:
    """Return a mask (12,): 1 on the meshes of a locus, else 0."""
    wanted = [str(locus.get(name, "all")) for name in ("mesh", "planet", "side")]
    parts = [(m[:2], m[2], m[4]) for m in MESHES]
    inside = [
        all(w in ("all", part) for w, part in zip(wanted, parts_m, strict=True))
        for parts_m in parts
    ]
    return np.array(inside, dtype=float)


def at(mesh: str = "all", planet: int | str = "all", side: str = "all") -> dict[str, Any]:
    """Return the locus of a mesh kind, planet and side."""
    return {"mesh": mesh, "planet": str(planet), "side": side}


def draw_sign(rng: Generator) -> float:
    """Draw -1 or 1."""
    return float(rng.choice([-1.0, 1.0]))


def draw_locus(rng: Generator) -> dict[str, Any]:
    """Draw a locus: all meshes of a kind, those of a kind at one planet, or a single mesh."""
    mesh, planet = str(rng.choice(["sp", "rp"])), int(rng.integers(1, 4))
    which = int(rng.integers(3))
    if which == 0:
        return at(mesh)
    return at(mesh, planet, "all" if which == 1 else str(rng.choice(["L", "R"])))


def draw_kind_locus(rng: Generator) -> dict[str, Any]:
    """Draw a locus: all meshes, or all of a kind."""
    return at(str(rng.choice(["all", "sp", "rp"])))


def anywhere(rng: Generator, _: tuple[str, ...]) -> Drawn:
    """Draw a locus by ``draw_locus``; the shape is empty."""
    return draw_locus(rng), {}


def by_kind(rng: Generator, _: tuple[str, ...]) -> Drawn:
    """Draw a locus by ``draw_kind_locus``; the shape is empty."""
    return draw_kind_locus(rng), {}


def angle(rng: Generator) -> float:
    """Draw an angle in -pi .. pi [rad]."""
    return float(rng.uniform(-np.pi, np.pi))


def signed(locus: Callable[[Generator], dict[str, Any]]) -> Any:
    """Return a ``Kind.draw`` function that draws a locus by ``locus``, and a sign as its shape."""
    return lambda rng, _: (locus(rng), {"sign": draw_sign(rng)})


def size_as(name: str, unit: str) -> Any:
    """Return a ``Kind.parameters`` function that gives the signed size as the only parameter."""
    return lambda c: {name: (c.sign * c.size, unit)}


def on_meshes(name: str) -> Any:
    """Return a ``Kind.apply`` that replaces field ``name`` (12,) of a rig model.

    Its value becomes the signed size on the meshes of the locus and 0 on the others: only for
    fields that are 0 without the effect.
    """
    return lambda p, c, _: p._replace(**{name: c.sign * c.size * c.meshes})
