"""Sends blocks of samples to a Rerun recording: time courses, contact states, diagrams, text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import pi
from typing import Any

import numpy as np
import rerun as rr

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.layout import KINDS
from herringbone_sim.views.mirror.block import Drawing, MirrorBlock
from herringbone_sim.views.mirror.blueprint import AvailableViews, Plane, blueprint
from herringbone_sim.views.mirror.lanes import ContactLanes
from herringbone_sim.views.mirror.palette import BORDER, mesh_colours
from herringbone_sim.views.mirror.planes import Planes
from herringbone_sim.views.mirror.status import status_text

COURSES = (("displacement", "x", 1e6), ("force", "F", 1e-3))
BORDERS = "displacement/{kind}/backlash"


@dataclass(frozen=True)
class Burst:
    """The end of a block that is shown at full rate.

    Attributes:
        rows: (n, c) samples of the last mesh cycles of the block.
        times: (n,) seconds on the viewer's time line, rising from block to block.
        wall_ns: (n,) wall-clock stamps, spaced as simulation time is.
        gap: whether samples are missing between the previous block and the burst.
    """

    rows: Array
    times: Array
    wall_ns: Indices
    gap: bool

    def indexes(self, pick: Any = slice(None)) -> list[Any]:
        """Return the columns of both time lines, simulation and wall clock, at rows ``pick``."""
        return [
            rr.TimeColumn("sim_time", duration=self.times[pick]),
            rr.TimeColumn("wall_time", timestamp=self.wall_ns[pick].view("datetime64[ns]")),
        ]


class RerunStream:
    """Sends blocks to a recording; static data are sent again only when they change.

    Args:
        recording: a ``rerun.RecordingStream``.
        drawing: what is sent of each block, and in which units.
    """

    def __init__(self, recording: Any, drawing: Drawing) -> None:
        recording.set_log_tick_enabled(False)
        recording.set_log_time_enabled(False)
        self.recording = recording
        self.layout = drawing.layout
        self.scale = drawing.scale
        self.burst_cycles = drawing.burst_cycles
        self.mesh = drawing.mesh
        self._colours = mesh_colours(self.layout)
        self._planes: Planes | None = None
        self._lanes: ContactLanes | None = None
        self._available: AvailableViews | None = None
        self._recent: Array = np.empty((0, 0))
        self._last = -np.inf
        self._offset = 0.0

    def send(self, block: MirrorBlock) -> None:
        """Send the ``Burst``, contact states, diagrams and text of a block, if it has rows."""
        block = with_finite_times(block)
        if not len(block.rows):
            return
        restart = self._restart(block)
        burst = self._burst(block)
        self.recording.set_time("sim_time", duration=burst.times[-1])
        self.recording.set_time("wall_time", timestamp=np.datetime64(int(block.wall_ns), "ns"))
        self._arrange(block, burst)
        self._send_courses(block, burst)
        self._recent = burst.rows if restart else self._with_recent(block, burst)
        self._send_contact(block)
        if self._planes:
            self._planes.send(block, self._recent)
        self._send_text(block, restart)
        self._last = float(burst.times[-1])

    def _restart(self, block: MirrorBlock) -> str:
        """Shift the time line if the time of samples jumps back; return a text on it, or empty."""
        first = float(block.column("t")[0])
        if first + self._offset > self._last or not np.isfinite(self._last):
            return ""
        self._offset = self._last - first + step_of(block.column("t"))
        return f"time starts again at {first:.6g} s, shown {self._offset:.6g} s later"

    def _burst(self, block: MirrorBlock) -> Burst:
        rows = block.rows[last_cycles(block.rows, block.names, self.burst_cycles) :]
        times = rows[:, block.names.index("t")] + self._offset
        wall_ns = block.wall_ns + np.round((times - times[-1]) * 1e9).astype(np.int64)
        gap = bool(times[0] - self._last > 1.5 * step_of(block.column("t")))
        return Burst(rows, times, wall_ns, gap)

    def _with_recent(self, block: MirrorBlock, burst: Burst) -> Array:
        """Return rows (n, c) of the last cycles, of earlier blocks too if no sample is missing."""
        if burst.gap or self._recent.shape[1] != burst.rows.shape[1]:
            return burst.rows
        rows = np.vstack((self._recent, burst.rows))
        return rows[last_cycles(rows, block.names, self.burst_cycles) :]

    def _arrange(self, block: MirrorBlock, burst: Burst) -> None:
        """Send the blueprint and static styles, again if the views or the window have changed."""
        window_s = window_of(block, self.burst_cycles)
        before = self._available
        if before and "phase" not in block.names:
            window_s = max(window_s, before.window_s)
        if before and before.names == block.names and is_near(before.window_s, window_s):
            return
        if before is None or before.names != block.names:
            self._planes = self._open_planes(block)
            self._lanes = self._open_lanes(block)
            self._send_styles(block)
        self._available = self._find_views(block, window_s)
        self.recording.send_blueprint(blueprint(self._available))

    def _find_views(self, block: MirrorBlock, window_s: float) -> AvailableViews:
        kinds = {
            path: tuple(kind for kind in KINDS if self._meshes(block, prefix, kind))
            for path, prefix, _ in COURSES
        }
        return AvailableViews(
            names=block.names,
            displacement_kinds=kinds["displacement"],
            force_kinds=kinds["force"],
            planes=self._titles(),
            window_s=window_s,
        )

    def _titles(self) -> dict[str, Plane]:
        titles = dict(self._planes.titles) if self._planes else {}
        if self._lanes:
            titles["contact"] = ("Contact state over the window above", *self._lanes.size)
        return titles

    def _open_planes(self, block: MirrorBlock) -> Planes | None:
        """Open the diagrams of the mesh, or of the first with data if empty; None without data."""
        for mesh in self.layout.meshes:
            if f"x_{mesh}" in block.names and self.mesh in ("", mesh):
                return Planes(self.recording, self.layout, self.scale, mesh, block.names)
        return None

    def _open_lanes(self, block: MirrorBlock) -> ContactLanes | None:
        meshes = [m for kind in self._bordered(block) for m in self._meshes(block, "x", kind)]
        return (
            ContactLanes(self.recording, {m: self._colours[m] for m in meshes}) if meshes else None
        )

    def _send_styles(self, block: MirrorBlock) -> None:
        for path, prefix, _ in COURSES:
            for kind in KINDS:
                if meshes := self._meshes(block, prefix, kind):
                    style = rr.SeriesLines(
                        names=list(meshes),
                        colors=[self._colours[mesh] for mesh in meshes],
                        widths=[2.6 if mesh.endswith("L") else 1.3 for mesh in meshes],
                    )
                    self.recording.log(f"{path}/{kind}", style, static=True)
        for kind in self._bordered(block):
            borders = rr.SeriesLines(names=["b'", "-b'"], colors=[BORDER, BORDER], widths=[1, 1])
            self.recording.log(BORDERS.format(kind=kind), borders, static=True)

    def _send_courses(self, block: MirrorBlock, burst: Burst) -> None:
        for path, prefix, factor in COURSES:
            for kind in KINDS:
                meshes = self._meshes(block, prefix, kind)
                if meshes:
                    columns = [block.names.index(f"{prefix}_{mesh}") for mesh in meshes]
                    self._send_scalars(f"{path}/{kind}", burst, factor * burst.rows[:, columns])
        for kind in self._bordered(block):
            values = np.full((2, 2), 1e6 * self._borders(block)[kind]) * [1.0, -1.0]
            self._send_scalars(BORDERS.format(kind=kind), burst, values, [0, -1])

    def _send_scalars(
        self, entity: str, burst: Burst, values: Array, pick: Any = slice(None)
    ) -> None:
        indexes = burst.indexes(pick)
        self.recording.send_columns(entity, indexes, rr.Scalars.columns(scalars=values))

    def _send_contact(self, block: MirrorBlock) -> None:
        if self._lanes:
            columns = {m: block.names.index(f"x_{m}") for m in self._lanes.colours}
            x = {mesh: self._recent[:, column] for mesh, column in columns.items()}
            self._lanes.send(self._recent[:, block.names.index("t")], x, self._borders(block))

    def _send_text(self, block: MirrorBlock, restart: str) -> None:
        text = status_text(block)
        document = rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
        self.recording.log("status", document)
        for line in (restart, *block.events):
            if line:
                self.recording.log("events", rr.TextLog(line, level=rr.TextLogLevel.INFO))

    def _meshes(self, block: MirrorBlock, prefix: str, kind: str) -> tuple[str, ...]:
        """Return the meshes of a kind whose channel ``prefix_mesh`` is in a block."""
        return tuple(
            mesh
            for mesh in self.layout.meshes
            if mesh.startswith(kind) and f"{prefix}_{mesh}" in block.names
        )

    def _bordered(self, block: MirrorBlock) -> list[str]:
        """Return the mesh kinds with both a displacement and a known backlash."""
        return [k for k in KINDS if k in self._borders(block) and self._meshes(block, "x", k)]

    def _borders(self, block: MirrorBlock) -> Mapping[str, float]:
        """Return the half backlash [m] by mesh kind, of the block or else of the drawing."""
        return {**(self.scale.b_half if self.scale else {}), **(block.b_half or {})}


def with_finite_times(block: MirrorBlock) -> MirrorBlock:
    """Return the block without samples whose time is not finite."""
    rows, sections = (
        array[np.isfinite(array[:, block.names.index("t")])]
        for array in (block.rows, block.sections)
    )
    return replace(block, rows=rows, sections=sections)


def last_cycles(rows: Array, names: tuple[str, ...], cycles: int) -> int:
    """Return the index of the first of rows (n, c) in the last ``cycles``; 0 without phase."""
    if "phase" not in names:
        return 0
    phase = rows[:, names.index("phase")]
    known = np.flatnonzero(np.isfinite(phase))
    if not known.size:
        return 0
    first = np.searchsorted(phase[known], phase[known[-1]] - 2 * pi * cycles - 1e-9)
    return int(known[first]) if first else 0


def window_of(block: MirrorBlock, cycles: int) -> float:
    """Return the time [s] that mesh cycles take in a block; without phase, its length."""
    t = block.column("t")
    span = float(t[-1] - t[0])
    turned = 0.0
    if "phase" in block.names:
        phase = block.column("phase")
        turned = float(phase[-1] - phase[0]) / (2 * pi)
    return max(span * cycles / turned if turned > 0 else span, 1e-6)


def step_of(times: Array) -> float:
    """Return the median sample interval [s], 0 for a single sample."""
    return float(np.median(np.diff(times))) if len(times) > 1 else 0.0


def is_near(before_s: float, span_s: float) -> bool:
    """Return whether two windows differ by at most a fifth of the first."""
    return 0.8 * before_s <= span_s <= 1.2 * before_s
