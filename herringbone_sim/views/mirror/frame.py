"""Box, grid, ticks and labels of a diagram in the plane, as Rerun entities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from herringbone_sim.views.mirror.palette import BORDER, FRAME, GRID, WORDS, Colour
from herringbone_sim.views.mirror.plane import Axes, ticks

THIN = rr.Radius.ui_points(0.5)
TICK_X, TICK_Y, TITLE_X, TITLE_Y, LIFT = 1.0, -9.0, 12.0, -10.0, 4.0


@dataclass(frozen=True)
class Frame:
    """Axes, labels and backlash borders of a diagram.

    Attributes:
        axes: the limits.
        x_label, y_label: quantities with their units.
        border: half backlash in data units; None: no borders.
        border_across: whether displacement, and so the border, is on the y axis.
    """

    axes: Axes
    x_label: str
    y_label: str
    border: float | None = None
    border_across: bool = False


def send_frame(recording: Any, path: str, frame: Frame) -> None:
    """Draw box, grid, borders and labels under an entity path."""
    axes = frame.axes
    x_ticks, y_ticks = ticks(axes.x, round(axes.width / 20)), ticks(axes.y)
    grid = [axes.vertical(x) for x in x_ticks] + [axes.horizontal(y) for y in y_ticks]
    recording.log(f"{path}/frame/grid", strips(grid, GRID, 1.0))
    send_box(recording, path, axes)
    recording.log(f"{path}/frame/borders", strips(borders(frame), BORDER, 3.0))
    x_at = [(axes.vertical(x)[0, 0], axes.height + TICK_X) for x in x_ticks]
    y_at = [(TICK_Y, axes.horizontal(y)[0, 1] - LIFT) for y in y_ticks]
    texts = [f"{value:.4g}" for value in (*x_ticks, *y_ticks)]
    recording.log(f"{path}/frame/ticks", words([*x_at, *y_at], texts))
    titles_at = [(axes.width / 2, axes.height + TITLE_X), (12.0, TITLE_Y)]
    recording.log(f"{path}/frame/titles", words(titles_at, [frame.x_label, frame.y_label]))


def send_box(recording: Any, path: str, axes: Axes) -> None:
    """Draw the outline of the box of some axes under an entity path."""
    w, h = axes.width, axes.height
    outline = np.array([[0, 0], [w, 0], [w, h], [0, h], [0, 0]], dtype=np.float32)
    recording.log(f"{path}/frame/box", strips([outline], FRAME, 2.0))


def borders(frame: Frame) -> list[Any]:
    """Return lines (2, 2) at plus and minus the half backlash, if inside the limits."""
    if frame.border is None:
        return []
    low, high = frame.axes.y if frame.border_across else frame.axes.x
    line = frame.axes.horizontal if frame.border_across else frame.axes.vertical
    return [line(at) for at in (-frame.border, frame.border) if low < at < high]


def strips(lines: list[Any], colour: Colour, order: float) -> Any:
    """Rerun entity of thin lines, each (k, 2) in box coordinates; a higher order is in front."""
    return rr.LineStrips2D(lines, colors=[colour], radii=THIN, draw_order=order)


def words(at: Any, texts: list[str], colours: list[Colour] | None = None) -> Any:
    """Return a Rerun entity of k text labels centred at box coordinates (k, 2)."""
    where = np.asarray(at, dtype=np.float32).reshape(-1, 2)
    return rr.Points2D(where, labels=texts, colors=colours or [WORDS], radii=0.0, show_labels=True)
