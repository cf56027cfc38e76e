"""Arrangement of a diagnosis in the Rerun viewer: a tab per run, a column per model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import rerun.blueprint as rrb

from herringbone_sim.gap.run_comparison import COLUMNS
from herringbone_sim.views.mirror.blueprint import (
    KIND_WORDS,
    arranged,
    plane_view,
    side_by_side,
    stack,
    time_course,
)
from herringbone_sim.views.mirror.gear import HEIGHT, WIDTH

COURSES = ("force", "residual")
TITLES = {"measured": "measured", "nominal": "nominal model", "augmented": "augmented model"}


@dataclass(frozen=True)
class RunLayout:
    """Views of a run for which there is data.

    Attributes:
        name, role: of the run.
        kinds: mesh kind -> ``force`` or ``residual`` -> limits of the axis [kN].
        meshes: meshes with phase portraits.
        planes: columns that have a motion, such as ``nominal``.
    """

    name: str
    role: str
    kinds: Mapping[str, Mapping[str, tuple[float, float]]]
    meshes: tuple[str, ...]
    planes: tuple[str, ...]


def blueprint(gear: bool, runs: Sequence[RunLayout]) -> Any:
    """Return a blueprint with a tab for verdict and gears, and a tab per run.

    Args:
        gear: whether there are drawings of the gear.
        runs: views of each run.
    """
    tabs = rrb.Tabs(_overview(gear, runs), *(_run(run) for run in runs), active_tab=0)
    return arranged(tabs, "run_time")


def _overview(gear: bool, runs: Sequence[RunLayout]) -> Any:
    verdict = rrb.TextDocumentView(origin="/verdict", name="Verdict")
    gears = [
        plane_view(f"gear/{name}", f"Share of the residual, {TITLES[name]}", WIDTH, HEIGHT)
        for name in COLUMNS[1:]
    ]
    below = _planes(runs[0]) if runs else None
    above = rrb.Horizontal(verdict, *(gears if gear else []))
    return rrb.Vertical(*(p for p in (above, below) if p is not None), name="Where and what")


def _run(run: RunLayout) -> Any:
    rows = [_forces(run, kind) for kind in run.kinds]
    rows += [_planes(run), _residuals(run)]
    shares = [2.0] * len(run.kinds) + [3.5, 3.5]
    return rrb.Vertical(stack(rows, shares), name=f"{run.name} ({run.role})")


def _forces(run: RunLayout, kind: str) -> Any:
    return rrb.Horizontal(*(_course(run, "force", name, kind) for name in COLUMNS))


def _residuals(run: RunLayout) -> Any:
    about = rrb.TextDocumentView(origin=f"/{run.name}/about", name="Run")
    columns = [
        rrb.Vertical(*(_course(run, "residual", name, kind) for kind in run.kinds))
        for name in COLUMNS[1:]
    ]
    return rrb.Horizontal(about, *(columns if run.kinds else []))


def _planes(run: RunLayout) -> Any:
    """Return the phase portraits of a run side by side; None without any."""
    views = [
        plane_view(
            f"{run.name}/plane/{name}/{mesh}", f"{run.name}: {mesh}, {TITLES[name]}", 110.0, 100.0
        )
        for mesh in run.meshes
        for name in COLUMNS
        if name in run.planes
    ]
    return side_by_side(*views)


def _course(run: RunLayout, what: str, name: str, kind: str) -> Any:
    return time_course(
        f"/{run.name}/{what}/{name}/{kind}",
        f"{what} [kN], {KIND_WORDS[kind]}, {TITLES[name]}",
        axis_y=rrb.ScalarAxis(range=run.kinds[kind][what]),
        plot_legend=rrb.PlotLegend(visible=name == COLUMNS[0]),
    )
