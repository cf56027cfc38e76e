"""Phase portrait, stroboscopic section and live bifurcation diagram of one mesh."""

from __future__ import annotations

from collections import deque
from math import isfinite
from typing import Any

import numpy as np
import rerun as rr

from herringbone_sim.arrays import Array
from herringbone_sim.core.layout import UNITS, Layout
from herringbone_sim.views.mirror.block import STATES, MirrorBlock, Scale, contact_states
from herringbone_sim.views.mirror.blueprint import Plane
from herringbone_sim.views.mirror.frame import Frame, send_frame
from herringbone_sim.views.mirror.palette import (
    MARKER,
    STATE_COLOURS,
    mesh_colours,
    shaded,
)
from herringbone_sim.views.mirror.plane import Axes, Bifurcation, limits_for, smooth

STEERED = ("K", "delta_T", "T_1", "Omega", "xi", "control_phase")
SECTION_POINTS = 2000
WIDTHS, HEIGHT = {"portrait": 110.0, "section": 110.0, "bifurcation": 252.0}, 100.0
MICRON = Scale(b_c=1e-6)
LINE = rr.Radius.ui_points(0.8)
DOT = rr.Radius.ui_points(1.6)


class Planes:
    """Sends the diagrams of one mesh to a recording, of each only what a block changes.

    Args:
        recording: a ``rerun.RecordingStream``.
        layout: names of the meshes.
        scale: units and backlash, or None for micrometres.
        mesh: name of the mesh, which has a displacement.
        names: channels of the blocks.
    """

    def __init__(
        self,
        recording: Any,
        layout: Layout,
        scale: Scale | None,
        mesh: str,
        names: tuple[str, ...],
    ) -> None:
        self.recording = recording
        self.mesh = mesh
        self.scale = scale or MICRON
        self.colour = mesh_colours(layout)[mesh]
        self.has_velocity = f"v_{mesh}" in names
        self.has_section = "phase" in names
        self.steered = "K"
        self._x_label = f"x_{mesh} / b_c" if scale else f"x_{mesh} [µm]"
        self._v_label = f"v_{mesh}{self.scale.velocity[1]}"
        self._frames: dict[str, Frame] = {}
        self._section: deque[tuple[float, float]] = deque(maxlen=SECTION_POINTS)
        self._bifurcation = Bifurcation()
        self._rising = True
        self._before: dict[str, float] = {}

    @property
    def titles(self) -> dict[str, Plane]:
        """Entity path -> title, width and height of the diagrams with data."""
        titles = {}
        if self.has_velocity:
            titles["portrait"] = f"Phase portrait, {self.mesh}"
        if self.has_velocity and self.has_section:
            titles["section"] = f"Section at phase 0, {self.mesh}"
        if self.has_section:
            titles["bifurcation"] = f"Live bifurcation at phase 0, {self.mesh}"
        return {path: (title, WIDTHS[path], HEIGHT) for path, title in titles.items()}

    def send(self, block: MirrorBlock, rows: Array) -> None:
        """Draw a block; ``rows`` (n, c): the last cycles, for the phase portrait."""
        b_half = {**self.scale.b_half, **(block.b_half or {})}.get(self.mesh[:2])
        border = None if b_half is None else b_half / self.scale.b_c
        if self.has_velocity:
            self._send_portrait(self._plane(block, rows), border)
        if self.has_velocity and self.has_section:
            self._send_section(self._plane(block, block.sections), border)
        if self.has_section:
            self._send_bifurcation(block, border)

    def _plane(self, block: MirrorBlock, rows: Array) -> Array:
        """Return displacement and velocity (n, 2) of rows (n, c), in the units of the diagrams."""
        x = rows[:, block.names.index(f"x_{self.mesh}")] / self.scale.b_c
        v = rows[:, block.names.index(f"v_{self.mesh}")] / self.scale.velocity[0]
        return np.column_stack((x, v))

    def _send_portrait(self, points: Array, border: float | None) -> None:
        axes, _ = self._fit("portrait", points, (self._x_label, self._v_label), border)
        line = rr.LineStrips2D([axes.place(smooth(points))], colors=[self.colour], radii=LINE)
        self.recording.log("portrait/orbit", line)

    def _send_section(self, points: Array, border: float | None) -> None:
        self._section.extend((float(x), float(v)) for x, v in points)
        every = np.array(self._section, dtype=np.float64).reshape(-1, 2)
        axes, _ = self._fit("section", every, (self._x_label, self._v_label), border)
        colours = np.tile(np.array(shaded(self.colour, -0.35), np.uint8), (len(every), 1))
        colours[max(len(every) - len(points), 0) :] = shaded(self.colour, 0.5)
        self.recording.log(
            "section/points", rr.Points2D(axes.place(every), colors=colours, radii=DOT)
        )

    def _send_bifurcation(self, block: MirrorBlock, border: float | None) -> None:
        self._follow_steered(block)
        at = self._steered_values(block)
        x = block.at_section(f"x_{self.mesh}") / self.scale.b_c
        at, x = at[np.isfinite(x)], x[np.isfinite(x)]
        state = np.zeros(len(x), np.int64) if border is None else contact_states(x, border)
        touched = self._bifurcation.add(at, x, state, self._rising)
        labels = (self._steered_label(), self._x_label)
        axes, moved = self._fit("bifurcation", self._bifurcation.points()[:, :2], labels, border)
        for page in range(self._bifurcation.n_pages) if moved else sorted(touched):
            self._send_page(page, axes)
        if len(at):
            bottom, top = axes.vertical(float(at[-1]))
            here = [bottom - np.array([[0, 0], [0, 5]]), top + np.array([[0, 0], [0, 5]])]
            marker = rr.LineStrips2D(here, colors=[MARKER], radii=LINE, draw_order=10)
            self.recording.log("bifurcation/here", marker)

    def _send_page(self, page: int, axes: Axes) -> None:
        points = self._bifurcation.page(page)
        palette = np.array([STATE_COLOURS[state] for state in STATES], dtype=np.uint8)
        colours = palette[points[:, 2].astype(int)]
        dots = rr.Points2D(axes.place(points[:, :2]), colors=colours, radii=DOT)
        self.recording.log(f"bifurcation/points/{page:02d}", dots)

    def _follow_steered(self, block: MirrorBlock) -> None:
        """Start a new bifurcation diagram if parameters have changed, but not that on its axis.

        Note whether the parameter on the axis, in a new diagram the changed one, rises or falls.
        """
        now = {name: self._last_value(block, name) for name in STEERED}
        known = {
            name: value for name, value in now.items() if value is not None and isfinite(value)
        }
        changed = [name for name, value in known.items() if self._before.get(name, value) != value]
        if changed and self.steered not in changed:
            self.steered = changed[0]
            self._bifurcation = Bifurcation()
            self._frames.pop("bifurcation", None)
        if changed:
            self._rising = known[self.steered] > self._before[self.steered]
        self._before |= known

    def _last_value(self, block: MirrorBlock, name: str) -> float | None:
        if name in block.names:
            return float(block.column(name)[-1])
        return block.parameters.get(name)

    def _steered_values(self, block: MirrorBlock) -> Array:
        """Return the bifurcation parameter at each section point (m,); 0 if unknown."""
        if self.steered in block.names:
            return block.at_section(self.steered)
        return np.full(len(block.sections), block.parameters.get(self.steered, 0.0))

    def _steered_label(self) -> str:
        unit = UNITS.get(self.steered, "-")
        return self.steered if unit == "-" else f"{self.steered} [{unit}]"

    def _fit(
        self, path: str, points: Array, labels: tuple[str, str], border: float | None
    ) -> tuple[Axes, bool]:
        """Return axes around points (n, 2), and whether they changed; draw a changed frame."""
        before = self._frames.get(path)
        steered = path == "bifurcation"
        x = limits_for(points[:, 0], before.axes.x if before else None, 0.1 * steered)
        y = limits_for(points[:, 1], before.axes.y if before else None)
        frame = Frame(Axes(x, y, WIDTHS[path], HEIGHT), *labels, border, border_across=steered)
        if frame != before:
            self._frames[path] = frame
            send_frame(self.recording, path, frame)
        return frame.axes, before is None or frame.axes != before.axes
