"""SVG of the gear: both halves side by side, twelve meshes coloured by their residual."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from html import escape

from markupsafe import Markup

from herringbone_sim.core.layout import KINDS, SIDES
from herringbone_sim.effects.effect import Locus
from herringbone_sim.views.gear_geometry import (
    MESH_RADIUS,
    MESHES,
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
from herringbone_sim.views.numbers import NOT_KNOWN, percent

SCALE, MARGIN, SPOT = 2.35, 34.0, 19.0
HALF = 2 * RIM * SCALE + 2 * MARGIN
PALE, DEEP = (255, 246, 232), (196, 68, 0)


def mesh_shares(
    where: Iterable[tuple[Locus, float]],
) -> dict[str, tuple[float | None, bool]]:
    """Return for each mesh its fraction of the residual, and whether the locus is this mesh alone.

    The fraction of a locus of several meshes is divided evenly; where loci overlap, the locus with
    the fewest meshes counts. A mesh without a locus has None.

    Args:
        where: locus and fraction of the residual.
    """
    loci = sorted(
        ((covered(locus), share) for locus, share in where), key=lambda region: len(region[0])
    )
    shares: dict[str, tuple[float | None, bool]] = {}
    for mesh in MESHES:
        names, share = next((region for region in loci if mesh in region[0]), ((mesh,), None))
        shares[mesh] = (None if share is None else share / len(names), len(names) == 1)
    return shares


def covered(locus: Locus) -> tuple[str, ...]:
    """Names of the meshes that a locus covers."""
    wanted = (locus.mesh, locus.planet, locus.side)

    def inside(mesh: str) -> bool:
        parts = (mesh[:2], mesh[2], mesh[4])
        return all(w in ("all", part) for w, part in zip(wanted, parts, strict=True))

    return tuple(mesh for mesh in MESHES if inside(mesh))


def gear_svg(
    shares: Mapping[str, tuple[float | None, bool]],
    marked: Collection[str] = (),
    bodies: Collection[str] = (),
) -> Markup:
    """SVG of both halves of the gear, seen along the shaft, with the colour scale.

    Args:
        shares: by mesh name, see ``mesh_shares``.
        marked: meshes with a heavy rim: where the named effect sits.
        bodies: drawn with a heavy outline: ``sun_L``, ``ring_R``, ``planet1_L`` ...
    """
    top = max([SATURATED, *(share for share, _ in shares.values() if share is not None)])
    halves = "".join(_half(side, shares, top, marked, bodies) for side in SIDES)
    width, height = 2 * HALF, HALF + 64
    return Markup(
        f'<svg class="gear" viewBox="0 0 {width:.0f} {height:.0f}" role="img" '
        f'aria-label="share of the residual by mesh">{halves}{_scale(top, bool(marked))}</svg>'
    )


def _half(
    side: str,
    shares: Mapping[str, tuple[float | None, bool]],
    top: float,
    marked: Collection[str],
    bodies: Collection[str],
) -> str:
    x, y = HALF / 2 + HALF * SIDES.index(side), HALF / 2 + 22
    centres = {p: polar((SUN + PLANET) * SCALE, angle_of(p)) for p in PLANETS}
    parts = [
        f'<text class="half" x="0" y="{-HALF / 2:.0f}">{SIDE_NAMES[side].capitalize()}</text>',
        _ring(f"ring_{side}" in bodies),
        _carrier(centres, f"carrier_{side}" in bodies),
        _gear((0.0, 0.0), SUN, 0.0, f"sun_{side}" in bodies),
        *(_gear(centres[p], PLANET, angle_of(p), f"planet{p}_{side}" in bodies) for p in PLANETS),
        '<text x="0" y="5">sun</text>',
        f'<text x="0" y="{(RING + 4.5) * SCALE:.1f}">ring</text>',
        *(f'<text x="{cx:.1f}" y="{cy + 5:.1f}">P{p}</text>' for p, (cx, cy) in centres.items()),
    ]
    for planet in PLANETS:
        for kind in KINDS:
            mesh = f"{kind}{planet}_{side}"
            at = polar(MESH_RADIUS[kind] * SCALE, angle_of(planet))
            parts.append(_spot(mesh, at, shares[mesh], top, mesh in marked))
    return f'<g transform="translate({x:.1f} {y:.1f})">{"".join(parts)}</g>'


def _gear(at: tuple[float, float], teeth: int, turn: float, heavy: bool) -> str:
    x, y = at
    path = _teeth(teeth, teeth - 1.3, teeth + 0.9, turn)
    return f'<path class="body{_heavy(heavy)}" transform="translate({x:.1f} {y:.1f})" d="{path}"/>'


def _ring(heavy: bool) -> str:
    outer = RIM * SCALE
    rim = f"M {outer:.1f} 0 A {outer:.1f} {outer:.1f} 0 1 0 {-outer:.1f} 0 "
    rim += f"A {outer:.1f} {outer:.1f} 0 1 0 {outer:.1f} 0 Z "
    inner = _teeth(RING, RING - 0.9, RING + 1.3, 0.0)
    return f'<path class="body{_heavy(heavy)}" fill-rule="evenodd" d="{rim}{inner}"/>'


def _carrier(centres: Mapping[str, tuple[float, float]], heavy: bool) -> str:
    corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in centres.values())
    return f'<polygon class="carrier{_heavy(heavy)}" points="{corners}"/>'


def _heavy(heavy: bool) -> str:
    return " heavy" if heavy else ""


def _teeth(teeth: int, low: float, high: float, turn: float) -> str:
    """SVG path of a gear with trapezoid teeth; radii in units of tooth numbers, angle in rad."""
    steps = ((low, 0.0), (low, 0.3), (high, 0.45), (high, 0.85))
    points = [
        polar(radius * SCALE, turn + 2 * math.pi * (tooth + part) / teeth)
        for tooth in range(teeth)
        for radius, part in steps
    ]
    return "M " + " L ".join(f"{x:.1f} {y:.1f}" for x, y in points) + " Z"


def _spot(
    mesh: str, at: tuple[float, float], share: tuple[float | None, bool], top: float, heavy: bool
) -> str:
    value, own = share
    x, y = at
    text = NOT_KNOWN if value is None else percent(value) + ("" if own else ", spread evenly")
    # Longer texts do not fit into the circle.
    inside = "?" if value is None else "≈ 0" if 0 < value < 0.001 else percent(value)
    classes = ("spot" if value is not None else "spot blank") + _heavy(heavy)
    ink = "#fff" if value is not None and value > 0.6 * top else "#22262c"
    return (
        f'<g data-mesh="{mesh}" data-share="{"" if value is None else f"{value:.6g}"}">'
        f"<title>{mesh}: {escape(text)}</title>"
        f'<circle class="{classes}" cx="{x:.1f}" cy="{y:.1f}" r="{SPOT + 4:.0f}" '
        f'fill="{colour(value, top)}"/>'
        f'<text class="name" x="{x:.1f}" y="{y - 3:.1f}" fill="{ink}">{mesh[:3]}</text>'
        f'<text class="share" x="{x:.1f}" y="{y + 11:.1f}" fill="{ink}">{escape(inside)}</text>'
        "</g>"
    )


def colour(share: float | None, top: float) -> str:
    """Return the colour of a fraction: pale to deep orange from 0 to ``top``; grey for None."""
    if share is None:
        return "#eceff2"
    return "#" + "".join(f"{channel:02x}" for channel in ramp(share / top, PALE, DEEP))


def _scale(top: float, marked: bool) -> str:
    x, y, width = HALF - 120, HALF + 34, 240
    stops = f'<stop offset="0" stop-color="{colour(0.0, top)}"/>'
    stops += f'<stop offset="1" stop-color="{colour(top, top)}"/>'
    rim = '<tspan font-weight="700">heavy rim</tspan>: where the named effect sits'
    return (
        f'<defs><linearGradient id="share">{stops}</linearGradient></defs>'
        f'<rect x="{x:.0f}" y="{y:.0f}" width="{width}" height="9" rx="4" fill="url(#share)"/>'
        f'<text class="end" x="{x - 8:.0f}" y="{y + 9:.0f}">0 %</text>'
        f'<text class="start" x="{x + width + 8:.0f}" y="{y + 9:.0f}">{percent(top)}</text>'
        + (f'<text x="{HALF:.0f}" y="{y + 27:.0f}">{rim}</text>' if marked else "")
    )
