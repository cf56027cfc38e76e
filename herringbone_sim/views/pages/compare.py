"""``report.html`` of ``compare``: bifurcations of two gears over one parameter."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

from herringbone_sim.sweeps.compare import Boundary, BoundaryShift, Stretch
from herringbone_sim.views.pages.html import (
    Picture,
    bullets,
    html_page,
    number,
    picture_html,
    table,
)

WAYS = {
    "fixed": "from the initial state",
    "up": "continued upwards",
    "down": "continued downwards",
}
STYLE = """
td { vertical-align: top; } td.moved { color: #D55E00; font-weight: 600; }
h3 { font-size: 15px; margin: 22px 0 6px; } code { font-size: 12px; }
figure { margin-top: 14px; }
"""


@dataclass(frozen=True)
class Comparison:
    """Sweeps of a nominal and an augmented gear, compared.

    Attributes:
        name: of the parameter, with its unit.
        facts: lines about both gears and the sweeps.
        moves: matched boundaries by the way in which values are reached, one way or more.
        shares: by motion, its share of the values (nominal, augmented), by the first way.
        coexisting: by gear, intervals of the parameter with several motions.
        pictures: figures with captions.
    """

    name: str
    facts: Sequence[str]
    moves: Mapping[str, Sequence[BoundaryShift]]
    shares: Mapping[str, tuple[float, float]]
    coexisting: Mapping[str, Sequence[Stretch]]
    pictures: Sequence[Picture]


def headline(moves: Sequence[BoundaryShift]) -> str:
    """Line on how many boundaries move, and which moves most."""
    both = [move for move in moves if math.isfinite(move.shift)]
    clear = [move for move in both if abs(move.shift) > move.uncertainty]
    new, gone = (sum(side is None for side in sides) for sides in _sides(moves))
    text = f"{len(clear)} of {len(both)} shared boundaries move"
    if clear:
        most = max(clear, key=lambda move: (move.boundary.kind == "motion", abs(move.shift)))
        text += f", {between(most)} by {most.shift:+.3g}"
    return f"{text}; {new} are new, {gone} are gone"


def _sides(moves: Sequence[BoundaryShift]) -> tuple[list[Boundary | None], list[Boundary | None]]:
    return [move.nominal for move in moves], [move.augmented for move in moves]


def between(move: BoundaryShift) -> str:
    """Motions on both sides of a boundary, as ``P2 to P1``."""
    return f"{move.boundary.before} to {move.boundary.after}"


def cells(move: BoundaryShift) -> list[str]:
    """Cells of a table: boundary, its value in both gears, its shift."""
    values = [number(b.value, 5) if b else "–" for b in (move.nominal, move.augmented)]
    shift = f"{move.shift:+.3g} ± {move.uncertainty:.1g}" if math.isfinite(move.shift) else "–"
    if move.nominal is None or move.augmented is None:
        shift = "new" if move.nominal is None else "gone"
    return [between(move), *values, shift]


def way_words(way: str) -> str:
    """How a value is reached, in words."""
    return WAYS.get(way, way)


def compare_page(comparison: Comparison) -> str:
    """The complete page, pictures included."""
    name, moves_by_way = comparison.name, comparison.moves
    first_way, first = next(iter(moves_by_way.items()))
    body = [
        "<h1>Nominal and augmented gear</h1>",
        f'<p class="lead">{escape(headline(first))}</p>',
        bullets(comparison.facts),
        *map(picture_html, comparison.pictures[:1]),
        "<h2>Boundaries that move</h2>",
        *(_moves(name, way, moves) for way, moves in moves_by_way.items()),
        "<h2>Motions</h2>",
        _shares(comparison.shares, way_words(first_way)),
        "<h2>Coexisting motions</h2>",
        *(_coexisting(name, *entry) for entry in comparison.coexisting.items()),
        *map(picture_html, comparison.pictures[1:]),
        "<footer>Beside this page: compare.json, boundaries.csv, values.csv, figures/, and the "
        "sweeps themselves in nominal/ and augmented/. Stretches shorter than 2 % of the values "
        "make no boundary.</footer>",
    ]
    return html_page("Compare", body, STYLE)


def _moves(name: str, way: str, moves: Sequence[BoundaryShift]) -> str:
    title = f"<h3>{escape(way_words(way))}</h3>"
    if not moves:
        return f"{title}<p>Neither gear has a boundary.</p>"
    rows = [[escape(cell) for cell in (move.boundary.kind, *cells(move))] for move in moves]
    moved = {
        (i, 4): "moved" for i, move in enumerate(moves) if not abs(move.shift) <= move.uncertainty
    }
    head = ["", "boundary", f"nominal, {name}", f"augmented, {name}", "moves by"]
    return title + table(head, rows, (2, 3, 4), moved)


def _shares(shares: Mapping[str, tuple[float, float]], way: str) -> str:
    rows = [[escape(name), *(f"{share:.1%}" for share in pair)] for name, pair in shares.items()]
    head = [f"share of the values, {escape(way)}", "nominal", "augmented"]
    return table(head, rows, (1, 2))


def _coexisting(name: str, gear: str, stretches: Sequence[Stretch]) -> str:
    title = f"<h3>{escape(gear)}</h3>"
    if not stretches:
        return f"{title}<p>All starts end in one motion, except at single values.</p>"
    rows = [
        [number(s.low, 5), number(s.high, 5), escape(" and ".join(s.motions))] for s in stretches
    ]
    return title + table([f"{name} from", "to", "side by side"], rows, (0, 1))
