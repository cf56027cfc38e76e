"""``report.html`` of two gears over one parameter: what moves, and both drawn over one another."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape

from herringbone_sim.sweeps.compare import Boundary, BoundaryShift, Stretch
from herringbone_sim.views.pages.report import CSS, Picture, number, picture_html

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
class Told:
    """All that the page says.

    Attributes:
        name: of the parameter, with its unit.
        facts: about both gears and the sweeps, a line each.
        moves: boundaries of both gears by way, one or more.
        shares: of the values with a motion by the first way (nominal, augmented), by its name.
        coexisting: stretches with several motions, by gear.
        pictures: to show.
    """

    name: str
    facts: Sequence[str]
    moves: Mapping[str, Sequence[BoundaryShift]]
    shares: Mapping[str, tuple[float, float]]
    coexisting: Mapping[str, Sequence[Stretch]]
    pictures: Sequence[Picture]


def headline(moves: Sequence[BoundaryShift]) -> str:
    """How many boundaries move, and the motion that moves most, in a line."""
    both = [one for one in moves if math.isfinite(one.shift)]
    clear = [one for one in both if abs(one.shift) > one.uncertainty]
    new, gone = (sum(side is None for side in sides) for sides in _sides(moves))
    said = f"{len(clear)} of {len(both)} shared boundaries move"
    if clear:
        most = max(clear, key=lambda one: (one.boundary.kind == "motion", abs(one.shift)))
        said += f", {between(most)} by {most.shift:+.3g}"
    return f"{said}; {new} are new, {gone} are gone"


def _sides(moves: Sequence[BoundaryShift]) -> tuple[list[Boundary | None], list[Boundary | None]]:
    return [one.nominal for one in moves], [one.augmented for one in moves]


def between(move: BoundaryShift) -> str:
    """``P2 to P1``."""
    return f"{move.boundary.before} to {move.boundary.after}"


def cells(move: BoundaryShift) -> list[str]:
    """Boundary, its value in both gears and how far it moves."""
    values = [number(b.value, 5) if b else "–" for b in (move.nominal, move.augmented)]
    shift = f"{move.shift:+.3g} ± {move.uncertainty:.1g}" if math.isfinite(move.shift) else "–"
    if move.nominal is None or move.augmented is None:
        shift = "new" if move.nominal is None else "gone"
    return [between(move), *values, shift]


def way_words(way: str) -> str:
    """How a value is reached, in words."""
    return WAYS.get(way, way)


def compare_page(told: Told) -> str:
    """The whole page; nothing outside it."""
    first = next(iter(told.moves.values()))
    lines = "".join(f"<li>{escape(line)}</li>" for line in told.facts)
    body = [
        "<h1>Nominal and augmented gear</h1>",
        f'<p class="lead">{escape(headline(first))}</p>',
        f"<ul>{lines}</ul>",
        *(picture_html(picture) for picture in told.pictures[:1]),
        "<h2>Boundaries that move</h2>",
        *(_moves(told.name, way, moves) for way, moves in told.moves.items()),
        "<h2>Motions</h2>",
        _shares(told.shares, way_words(next(iter(told.moves)))),
        "<h2>Coexisting motions</h2>",
        *(_coexisting(told.name, gear, found) for gear, found in told.coexisting.items()),
        *(picture_html(picture) for picture in told.pictures[1:]),
        "<footer>Beside this page: compare.json, boundaries.csv, values.csv, figures/, and the "
        "sweeps themselves in nominal/ and augmented/. Stretches shorter than 2 % of the values "
        "make no boundary.</footer>",
    ]
    head = f'<meta charset="utf-8"><title>Compare</title><style>{CSS}{STYLE}</style>'
    return f'<!doctype html><html lang="en"><head>{head}</head><body>{"".join(body)}</body></html>'


def _moves(name: str, way: str, moves: Sequence[BoundaryShift]) -> str:
    title = f"<h3>{escape(way_words(way))}</h3>"
    if not moves:
        return f"{title}<p>Neither gear has a boundary.</p>"
    rows = [[escape(cell) for cell in (one.boundary.kind, *cells(one))] for one in moves]
    moved = {i for i, one in enumerate(moves) if not abs(one.shift) <= one.uncertainty}
    head = ["", "boundary", f"nominal, {name}", f"augmented, {name}", "moves by"]
    return title + table(head, rows, (2, 3, 4), moved)


def _shares(shares: Mapping[str, tuple[float, float]], way: str) -> str:
    rows = [[escape(name), *(f"{share:.1%}" for share in pair)] for name, pair in shares.items()]
    head = [f"share of the values, {escape(way)}", "nominal", "augmented"]
    return table(head, rows, (1, 2))


def _coexisting(name: str, gear: str, found: Sequence[Stretch]) -> str:
    title = f"<h3>{escape(gear)}</h3>"
    if not found:
        return f"{title}<p>All starts end in one motion, but for single values.</p>"
    rows = [
        [number(one.low, 5), number(one.high, 5), escape(" and ".join(one.motions))]
        for one in found
    ]
    return title + table([f"{name} from", "to", "side by side"], rows, (0, 1))


def table(
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    numeric: Container[int],
    marked: Container[int] = (),
) -> str:
    def line(tag: str, row: Sequence[str], last: str = "") -> str:
        kinds = ["n" if i in numeric else "" for i in range(len(row))]
        kinds[-1] += f" {last}" if last else ""
        return "".join(
            f'<{tag} class="{kind}">{cell}</{tag}>' for kind, cell in zip(kinds, row, strict=True)
        )

    lines = "".join(
        f"<tr>{line('td', row, 'moved' if i in marked else '')}</tr>" for i, row in enumerate(rows)
    )
    return f'<div class="scroll"><table><tr>{line("th", head)}</tr>{lines}</table></div>'
