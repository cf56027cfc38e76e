"""The gear as views draw it, seen along the shaft: meshes, places, colours of fractions.

Lengths are in units of tooth numbers: the pitch radius of a gear is its number of teeth. y points
downwards.
"""

from __future__ import annotations

import math

from herringbone_sim.core.layout import KINDS, SIDES

SUN, PLANET, RING = 27, 25, 77
RIM = RING + 8  # outer radius of the ring
PLANETS = ("1", "2", "3")
MESHES = tuple(f"{k}{p}_{s}" for k in KINDS for s in SIDES for p in PLANETS)
MESH_RADIUS = dict(zip(KINDS, (SUN, RING), strict=True))
SIDE_NAMES = {"L": "left half", "R": "right half"}
SATURATED = 0.25  # fraction of the residual with the last colour, unless a mesh has more
RGB = tuple[int, int, int]


def angle_of(planet: str) -> float:
    """Return the angle [rad] of a planet: planet 1 on top, the others clockwise."""
    return -math.pi / 2 + (int(planet) - 1) * 2 * math.pi / len(PLANETS)


def polar(radius: float, angle: float) -> tuple[float, float]:
    """Return x and y of a point at a radius and an angle [rad] from the middle of the gear."""
    return radius * math.cos(angle), radius * math.sin(angle)


def ramp(fraction: float, first: RGB, last: RGB) -> RGB:
    """Return a colour between two: the first for 0 or less, the last for 1 or more."""
    weight = min(max(fraction, 0.0), 1.0)
    red, green, blue = (round(a + weight * (b - a)) for a, b in zip(first, last, strict=True))
    return red, green, blue
