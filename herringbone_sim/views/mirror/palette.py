"""Colours of the views, distinguishable with colour-blindness too (after Okabe and Ito)."""

from __future__ import annotations

from herringbone_sim.core.layout import Layout
from herringbone_sim.views.gear_geometry import ramp

Colour = tuple[int, int, int]

MESH_COLOURS: dict[str, Colour] = {
    "sp_L": (86, 180, 233),
    "sp_R": (230, 159, 0),
    "rp_L": (0, 190, 140),
    "rp_R": (224, 130, 180),
}
STATE_COLOURS: dict[str, Colour] = {
    "drive": (86, 180, 233),
    "separated": (150, 156, 170),
    "back": (240, 120, 40),
}
BACKGROUND: Colour = (14, 17, 23)
FRAME: Colour = (92, 98, 110)
LANE: Colour = (30, 33, 41)
UNKNOWN: Colour = (70, 74, 84)
GRID: Colour = (38, 42, 51)
BORDER: Colour = (150, 154, 164)
WORDS: Colour = (190, 196, 206)
MARKER: Colour = (240, 228, 66)


def shaded(colour: Colour, share: float) -> Colour:
    """Mix a colour with white (share > 0) or with the background (share < 0), share in -1..1."""
    return ramp(abs(share), colour, (255, 255, 255) if share > 0 else BACKGROUND)


def mesh_colours(layout: Layout) -> dict[str, Colour]:
    """Return the colour of each mesh by name: hue by kind and side, lightness by planet."""
    count = layout.n_classes
    shades = [0.0] if count == 1 else [0.45 - 0.9 * i / (count - 1) for i in range(count)]
    return {
        f"{kind}{planet}_{side}": shaded(MESH_COLOURS[f"{kind}_{side}"], shade)
        for planet, shade in zip(layout.planets, shades, strict=True)
        for kind in ("sp", "rp")
        for side in ("L", "R")
    }
