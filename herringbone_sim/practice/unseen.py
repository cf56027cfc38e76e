"""Further effects outside the catalogue, which no rule or weight was ever tuned on.

The effects of ``outside`` were known when the diagnosis learnt to say ``unknown``. These were not,
so they show how it treats a cause that nobody anticipated.
"""

from __future__ import annotations

from typing import Any

from numpy.random import Generator

from herringbone_sim.practice.cause import ALL, Cause, Kind, Point, at, draw_kind_locus, draw_locus
from herringbone_sim.practice.rig_model import RigModel
from herringbone_sim.practice.sensors import sensor

Drawn = tuple[dict[str, Any], dict[str, Any]]


def _hysteresis(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add material hysteresis to the mesh springs."""
    return p._replace(hysteresis=c.size * c.meshes)


def _square_damping(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add damping proportional to the squared velocity."""
    return p._replace(c_square=c.size * c.meshes)


def _film(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add squeeze-film damping near the flanks."""
    return p._replace(film=c.size * c.meshes)


def _turn(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Vary the stiffness once a turn of the sun."""
    return p._replace(k_turn=c.size * c.meshes)


def _second_pair(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add the stiffness of a second tooth pair at large deflection."""
    return p._replace(k_second=c.size * c.meshes)


def _bar(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Connect the halves of the sun by a preloaded torsion spring."""
    return p._replace(bar=c.size)


def _windage(p: RigModel, c: Cause, _: Point) -> RigModel:
    """Add drag on the planets by their squared velocity."""
    return p._replace(windage=c.size)


def _size(unit: str) -> Any:
    return lambda c: {"size": (c.size, unit)}


def _anywhere(rng: Generator, _: tuple[str, ...]) -> Drawn:
    return draw_locus(rng), {}


def _by_kind(rng: Generator, _: tuple[str, ...]) -> Drawn:
    return draw_kind_locus(rng), {}


UNSEEN: dict[str, Kind] = {
    "material_hysteresis": Kind("law", 0.05, 0.6, _by_kind, _hysteresis, _size("-")),
    "square_damping": Kind("law", 0.1, 50.0, _by_kind, _square_damping, _size("s/m")),
    "squeeze_film": Kind("law", 0.5, 50.0, _by_kind, _film, _size("-")),
    "stiffness_by_turn": Kind("law", 0.05, 0.5, _anywhere, _turn, _size("-")),
    "second_pair": Kind("law", 0.1, 2.0, _by_kind, _second_pair, _size("-")),
    "torsion_bar": Kind("body", 1e7, 2e9, lambda rng, _: (at("sp"), {}), _bar, _size("N/m")),
    "windage": Kind("body", 1e2, 1e5, lambda rng, _: (dict(ALL), {}), _windage, _size("N s2/m2")),
    "crosstalk": sensor(0.02, 0.6, _size("-")),
    "soft_saturation": sensor(0.02, 1.0, _size("-")),
}
