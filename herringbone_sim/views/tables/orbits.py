"""Branches of periodic orbits as text, and as CSV: orbits, sections, boundaries."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.boundaries import Boundary
from herringbone_sim.dynamics.cascade import Followed
from herringbone_sim.dynamics.turning import section
from herringbone_sim.views.figures.orbits import stability_of
from herringbone_sim.views.tables.csv_file import write_csv
from herringbone_sim.views.tables.text import aligned

NONE = complex("nan")
ORBIT_COLUMNS = [
    "period",
    "stability",
    "unstable_within",
    "unstable_transverse",
    "within_re",
    "within_im",
    "transverse_re",
    "transverse_im",
]
BOUNDARY_COLUMNS = [
    "value",
    "width",
    "kind",
    "branch",
    "period",
    "detail",
    "within_before",
    "transverse_before",
    "within_after",
    "transverse_after",
    "changes_stability",
    "multiplier_re",
    "multiplier_im",
]


def summary(branches: Sequence[Followed], name: str) -> str:
    """Return two tables as text: the branches, then the boundaries by ascending parameter value.

    Args:
        branches: with their boundaries.
        name: of the parameter.
    """
    rows = [["branch", "period", "left/right", "range", "points", "ends", "origin"]]
    for i, followed in enumerate(branches, start=1):
        values = [point.value for point in followed.branch.points]
        sides = "alike" if followed.symmetric else "differ"
        span = f"{min(values):.7g} .. {max(values):.7g}"
        ends = ", ".join(followed.branch.ends)
        rows.append(
            [str(i), f"P{followed.period}", sides, span, str(len(values)), ends, followed.origin]
        )
    table = [[name, "kind", "branch", "period", "along the branch", "detail"]]
    table += [_row(number, b) for number, b in _ordered(branches)]
    return "\n".join([*aligned(rows), "", *aligned(table)])


def _ordered(branches: Sequence[Followed]) -> list[tuple[int, Boundary]]:
    numbered = [
        (i, b) for i, followed in enumerate(branches, start=1) for b in followed.boundaries
    ]
    return sorted(numbered, key=lambda pair: pair[1].value)


def _row(number: int, boundary: Boundary) -> list[str]:
    before, after = _words(boundary.before), _words(boundary.after)
    change = f"{before} -> {after}" if before != after else before
    value, kind = f"{boundary.value:.7g}", boundary.kind
    return [value, kind, str(number), f"P{boundary.period}", change, boundary.detail]


def _words(unstable: tuple[int, int]) -> str:
    within, transverse = unstable
    parts = [f"{within} within"] * bool(within) + [f"{transverse} transverse"] * bool(transverse)
    return "+".join(parts) or "stable"


def write_orbits(folder: Path, branches: Sequence[Followed], p: Parameters) -> None:
    """Write ``branches.csv``, ``sections.csv`` and ``boundaries.csv`` into an existing folder.

    Their rows are orbits, section points of the orbits, and boundaries. The layout of ``p``, the
    parameters of the gear, gives the names of the meshes.
    """
    columns = [f"{a}_{m}" for a in "xv" for m in p.layout.meshes]
    head = ["branch", "index", "value"]
    write_csv(folder / "branches.csv", [*head, *ORBIT_COLUMNS], _orbit_rows(branches))
    write_csv(folder / "sections.csv", [*head, "cycle", *columns], _section_rows(branches))
    write_csv(folder / "boundaries.csv", BOUNDARY_COLUMNS, _boundary_rows(branches))


def _orbit_rows(branches: Sequence[Followed]) -> Iterator[Sequence[object]]:
    for i, followed in enumerate(branches, start=1):
        for j, point in enumerate(followed.branch.points):
            mu = point.multipliers
            largest = [part[0] if len(part) else NONE for part in (mu.within, mu.transverse)]
            parts = [f"{x:.12g}" for value in largest for x in (value.real, value.imag)]
            stability = stability_of(point)
            yield [i, j, f"{point.value:.12g}", followed.period, stability, *mu.unstable, *parts]


def _section_rows(branches: Sequence[Followed]) -> Iterator[Sequence[object]]:
    for i, followed in enumerate(branches, start=1):
        for j, point in enumerate(followed.branch.points):
            flow = followed.curve.family.flow_at(point.value)
            for cycle, both in enumerate(np.hstack(section(flow, point.orbit.points))):
                yield [i, j, f"{point.value:.12g}", cycle, *(f"{x:.12g}" for x in both)]


def _boundary_rows(branches: Sequence[Followed]) -> Iterator[Sequence[object]]:
    for number, b in _ordered(branches):
        where = [f"{b.value:.12g}", f"{b.width:.3g}", b.kind, number, b.period, b.detail]
        mu = [f"{b.multiplier.real:.9g}", f"{b.multiplier.imag:.9g}"]
        yield [*where, *b.before, *b.after, b.changes_stability, *mu]
