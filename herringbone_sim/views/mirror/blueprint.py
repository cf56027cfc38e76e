"""Arrangement of the views of the live mirror in the Rerun viewer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import rerun.blueprint as rrb

from herringbone_sim.views.mirror.palette import BACKGROUND

KIND_WORDS = {"sp": "sun-planet", "rp": "ring-planet"}
LEFT, RIGHT, TOP, BOTTOM = 28.0, 8.0, 12.0, 24.0
Plane = tuple[str, float, float]


@dataclass(frozen=True)
class AvailableViews:
    """Views for which the blocks have data.

    Attributes:
        names: channels of the blocks.
        displacement_kinds, force_kinds: mesh kinds with displacements, with forces.
        planes: entity path -> title, width and height of each two-dimensional diagram.
        window_s: length of the time courses [s].
    """

    names: tuple[str, ...]
    displacement_kinds: tuple[str, ...]
    force_kinds: tuple[str, ...]
    planes: dict[str, Plane]
    window_s: float


def blueprint(available: AvailableViews) -> Any:
    """Arrange time courses and contact on the left, two-dimensional diagrams and text right."""
    views = {path: plane_view(path, *plane) for path, plane in available.planes.items()}
    courses = [
        course_row(available, "displacement", "Displacement", "µm", available.displacement_kinds),
        course_row(available, "force", "Mesh force", "kN", available.force_kinds),
    ]
    planes = [side_by_side(views.get("portrait"), views.get("section")), views.get("bifurcation")]
    left = stack([*courses, views.get("contact")], [4.0, 4.0, 5.0])
    right = stack([*planes, text_row()], [1.1, 1.1, 1.0])
    columns = [column for column in (left, right) if column is not None]
    shares = [3, 2][: len(columns)]
    return arranged(rrb.Horizontal(*columns, column_shares=shares), "sim_time", "following")


def arranged(views: Any, timeline: str, play_state: Any = None) -> Any:
    """Return a blueprint of views, with the panel of ``timeline`` collapsed and others hidden."""
    return rrb.Blueprint(
        views,
        rrb.TimePanel(state="collapsed", timeline=timeline, play_state=play_state),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def stack(parts: list[Any], shares: list[float]) -> Any:
    """Stack views with relative heights ``shares``, leaving out those that are None.

    Returns None if all are.
    """
    shares = [share for part, share in zip(parts, shares, strict=True) if part is not None]
    present = [part for part in parts if part is not None]
    return rrb.Vertical(*present, row_shares=shares) if present else None


def side_by_side(*parts: Any) -> Any:
    """Place views side by side, leaving out those that are None; None if all are."""
    present = [part for part in parts if part is not None]
    return rrb.Horizontal(*present) if present else None


def course_row(
    available: AvailableViews, path: str, title: str, unit: str, kinds: tuple[str, ...]
) -> Any:
    """Time courses of a quantity, one view per mesh kind side by side; None without a kind.

    Each is of the last ``window_s`` seconds before the time cursor.
    """
    range_s = rrb.TimeRange(
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-available.window_s),
        end=rrb.TimeRangeBoundary.cursor_relative(seconds=0.0),
    )
    views = [
        time_course(
            f"/{path}/{kind}",
            f"{title}, {KIND_WORDS[kind]} [{unit}]",
            axis_x=rrb.TimeAxis(view_range=range_s),
            plot_legend=rrb.PlotLegend(visible="contact" not in available.planes),
            time_ranges=[rrb.VisibleTimeRange("sim_time", range=range_s)],
        )
        for kind in kinds
    ]
    return side_by_side(*views)


def time_course(origin: str, name: str, **more: Any) -> Any:
    """Return a view of the curves under entity path ``origin`` over time, with a grid."""
    background = rrb.archetypes.PlotBackground(color=BACKGROUND, show_grid=True)
    return rrb.TimeSeriesView(origin=origin, name=name, background=background, **more)


def plane_view(path: str, title: str, width: float, height: float) -> Any:
    """Return a view of a two-dimensional diagram, with room for labels around its box."""
    return rrb.Spatial2DView(
        origin=f"/{path}",
        name=title,
        background=BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(
            x_range=(-LEFT, width + RIGHT),
            y_range=(-TOP, height + BOTTOM),
        ),
    )


def text_row() -> Any:
    """Return the view of parameters and regime beside the log of events."""
    return rrb.Horizontal(
        rrb.TextDocumentView(origin="/status", name="Parameters and regime"),
        rrb.TextLogView(
            origin="/events",
            name="Events",
            columns=rrb.TextLogColumns(timeline_columns=["sim_time"], text_log_columns=["Body"]),
        ),
    )
