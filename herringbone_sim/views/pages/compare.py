"""``report.html`` of ``compare``: bifurcations of two gears over one parameter."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from herringbone_sim.sweeps.compare import Boundary, BoundaryShift, Stretch
from herringbone_sim.views.figures.diagram import LOOKS
from herringbone_sim.views.pages.html import Table, number, render
from herringbone_sim.views.picture import Picture


@dataclass(frozen=True)
class Comparison:
    """Sweeps of a nominal and an augmented gear, compared.

    Attributes:
        name: of the parameter, with its unit.
        facts: lines about both gears and the sweeps.
        moves: start of the sweeps -> matched boundaries; one start or more.
        shares: motion -> fraction of the parameter values (nominal, augmented) at which the sweeps
            with the first start of ``moves`` end in it.
        coexisting: gear -> intervals of the parameter in which several motions coexist.
        pictures: figures with captions.
    """

    name: str
    facts: Sequence[str]
    moves: Mapping[str, Sequence[BoundaryShift]]
    shares: Mapping[str, tuple[float, float]]
    coexisting: Mapping[str, Sequence[Stretch]]
    pictures: Sequence[Picture]


def headline(moves: Sequence[BoundaryShift]) -> str:
    """Return a line: how many boundaries move by more than their uncertainty, and which most."""
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
    """Return the labels on both sides of a boundary, as ``P2 to P1``."""
    return f"{move.boundary.before} to {move.boundary.after}"


def cells(move: BoundaryShift) -> list[str]:
    """Return table cells: labels of a boundary, its value in both gears, its shift."""
    values = [number(b.value, 5) if b else "–" for b in (move.nominal, move.augmented)]
    shift = f"{move.shift:+.3g} ± {move.uncertainty:.1g}" if math.isfinite(move.shift) else "–"
    if move.nominal is None or move.augmented is None:
        shift = "new" if move.nominal is None else "gone"
    return [between(move), *values, shift]


def way_words(way: str) -> str:
    """Return the start of a sweep in words; a start that is no key of ``LOOKS`` as it is."""
    return LOOKS[way][1] if way in LOOKS else way


def compare_page(comparison: Comparison) -> str:
    """Return the HTML of the page, with embedded pictures."""
    name, moves_by_way = comparison.name, comparison.moves
    first_way, first = next(iter(moves_by_way.items()))
    return render(
        "compare.html",
        title="Compare",
        headline=headline(first),
        facts=comparison.facts,
        pictures=comparison.pictures,
        boundaries=[(way_words(way), _moves(name, moves)) for way, moves in moves_by_way.items()],
        shares=_shares(comparison.shares, way_words(first_way)),
        coexisting=[
            (gear, _coexisting(name, stretches))
            for gear, stretches in comparison.coexisting.items()
        ],
    )


def _moves(name: str, moves: Sequence[BoundaryShift]) -> Table | None:
    """Return the table of boundaries, with a CSS class for moved ones; None without boundaries."""
    if not moves:
        return None
    moved = {
        (i, 4): "moved" for i, move in enumerate(moves) if not abs(move.shift) <= move.uncertainty
    }
    head = ["", "boundary", f"nominal, {name}", f"augmented, {name}", "moves by"]
    return Table(head, [[m.boundary.kind, *cells(m)] for m in moves], (2, 3, 4), moved)


def _shares(shares: Mapping[str, tuple[float, float]], way: str) -> Table:
    rows = [[name, *(f"{share:.1%}" for share in pair)] for name, pair in shares.items()]
    return Table([f"share of the values, {way}", "nominal", "augmented"], rows, (1, 2))


def _coexisting(name: str, stretches: Sequence[Stretch]) -> Table | None:
    """Return the table of intervals with several motions; None without intervals."""
    if not stretches:
        return None
    rows = [[number(s.low, 5), number(s.high, 5), " and ".join(s.motions)] for s in stretches]
    return Table([f"{name} from", "to", "side by side"], rows, (0, 1))
