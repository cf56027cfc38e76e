"""Drawing of the gear as Rerun entities, its meshes coloured by their part of a residual."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import rerun as rr

from herringbone_sim.arrays import Array
from herringbone_sim.core.layout import SIDES
from herringbone_sim.views.gear_geometry import (
    MESH_RADIUS,
    PLANET,
    PLANETS,
    RIM,
    RING,
    SATURATED,
    SIDE_NAMES,
    SUN,
    angle_of,
    polar,
    ramp,
)
from herringbone_sim.views.mirror.frame import strips, words
from herringbone_sim.views.mirror.palette import FRAME, UNKNOWN, WORDS

REACH = float(RIM)
APART = 2.0 * REACH + 14.0
SPOT = 9.0
WIDTH, HEIGHT = APART + 2.0 * REACH, 2.0 * REACH
NONE, FULL = (58, 50, 44), (255, 140, 30)


def send_gear(recording: Any, path: str) -> None:
    """Draw the static part: the bodies of both halves and their titles.

    Args:
        recording: a ``rerun.RecordingStream``.
        path: entity path of the drawing.
    """
    circles = [_circle(centre, radius) for side in SIDES for centre, radius in _bodies(side)]
    recording.log(f"{path}/bodies", strips(circles, FRAME, 1.0), static=True)
    titles = [(_middle(side)[0] - REACH + 16.0, 2.0) for side in SIDES]
    recording.log(f"{path}/halves", words(titles, list(SIDE_NAMES.values())), static=True)


def send_shares(recording: Any, path: str, shares: Mapping[str, float | None]) -> None:
    """Draw a spot at each mesh, coloured by its fraction of the residual; None: not known."""
    known = [share for share in shares.values() if share is not None]
    top = max([SATURATED, *known])
    at = np.concatenate([_spots(mesh) for mesh in shares]).astype(np.float32)
    each = [share for mesh, share in shares.items() for _ in _spots(mesh)]
    texts = [
        f"{mesh.partition('_')[0]} {'?' if share is None else f'{share:.0%}'}"
        for mesh, share in shares.items()
        for _ in _spots(mesh)
    ]
    colours = [UNKNOWN if s is None else ramp(s / top, NONE, FULL) for s in each]
    spots = rr.Points2D(at, colors=colours, radii=SPOT, draw_order=5.0)
    recording.log(f"{path}/spots", spots)
    beneath = at + np.array([0.0, SPOT - 1.0], dtype=np.float32)
    recording.log(f"{path}/shares", words(beneath, texts, [WORDS] * len(texts)))


def _middle(side: str) -> tuple[float, float]:
    return REACH + APART * SIDES.index(side), REACH


def _at(side: str, planet: str, radius: float) -> tuple[float, float]:
    """Return the point of a half at a radius in the direction of a planet."""
    (x, y), (right, down) = _middle(side), polar(radius, angle_of(planet))
    return x + right, y + down


def _bodies(side: str) -> list[tuple[tuple[float, float], float]]:
    middle = _middle(side)
    planets = [(_at(side, planet, SUN + PLANET), float(PLANET)) for planet in PLANETS]
    return [(middle, float(SUN)), (middle, float(RING)), (middle, REACH), *planets]


def _spots(mesh: str) -> Array:
    """Return the positions (k, 2) of a mesh: one, or one per planet if none is named."""
    head, _, side = mesh.partition("_")
    kind, number = head[:2], head[2:]
    planets = (number,) if number else PLANETS
    return np.array([_at(side, planet, MESH_RADIUS[kind]) for planet in planets], dtype=float)


def _circle(centre: tuple[float, float], radius: float) -> Array:
    angle = np.linspace(0.0, 2.0 * np.pi, 97)
    return np.column_stack((np.cos(angle), np.sin(angle))) * radius + centre
