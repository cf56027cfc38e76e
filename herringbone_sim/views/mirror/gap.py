"""A diagnosis in the Rerun viewer: measured, nominal and augmented motion side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from herringbone_sim.arrays import Array
from herringbone_sim.core.layout import KINDS
from herringbone_sim.gap.diagnose import Diagnosis
from herringbone_sim.gap.run_comparison import COLUMNS, RunView, mesh_shares, run_views
from herringbone_sim.views.gear_geometry import MESHES
from herringbone_sim.views.mirror.frame import Frame, send_frame
from herringbone_sim.views.mirror.gap_blueprint import COURSES, RunLayout, blueprint
from herringbone_sim.views.mirror.gear import send_gear, send_shares
from herringbone_sim.views.mirror.palette import mesh_colours
from herringbone_sim.views.mirror.plane import Axes, limits_for, smooth
from herringbone_sim.views.mirror.planes import LINE
from herringbone_sim.views.mirror.sink import Sink

TIMELINE = "run_time"


def mirror(diagnosis: Diagnosis, sink: Sink) -> None:
    """Send a diagnosis to an open sink: gear and verdict, then a tab per run.

    A tab has columns for the measurement, the nominal and the augmented model, with forces at the
    measured motion, residuals, and phase portraits of the measured and the simulated motions.

    Raises:
        ViewerError: the viewer has gone.
        RuntimeError: the receiver takes no more data.
    """
    recording = sink.recording
    recording.set_log_tick_enabled(False)
    recording.set_log_time_enabled(False)
    views = run_views(diagnosis)
    gear = bool(views) and views[0].meshes == MESHES
    if gear:
        _send_gears(recording, views)
    _log_text(recording, "verdict", verdict_text(diagnosis))
    layouts = []
    for view in views:
        layouts.append(_send_run(recording, view))
        sink.deliver()
    recording.send_blueprint(blueprint(gear, layouts))
    sink.deliver()


def verdict_text(diagnosis: Diagnosis) -> str:
    """Return verdict, five most probable causes and gap of each run as a page of Markdown."""
    verdict, gap = diagnosis.report.verdict, diagnosis.report.gap
    named = ", ".join(verdict.effects)
    title = verdict.verdict if named in ("", verdict.verdict) else f"{verdict.verdict}: {named}"
    lines = [f"## {title}", "", "| cause | where | probability |", "| --- | --- | --- |"]
    for cause in diagnosis.report.causes[:5]:
        lines.append(f"| {cause.effect} | {cause.place} | {cause.probability:.1%} |")
    closure = f"{gap.closure:.1%}" if np.isfinite(gap.closure) else "not known"
    lines += ["", f"Gap by {gap.metric}, RMS (closure on held-out runs: {closure}):", ""]
    lines += ["| run | role | nominal | augmented | floor |", "| --- | --- | --- | --- | --- |"]
    for run in gap.runs:
        numbers = (run.nominal, run.augmented, run.floor)
        values = " | ".join(f"{v:.4g}" if np.isfinite(v) else "not known" for v in numbers)
        lines.append(f"| {run.name} | {run.role} | {values} |")
    return "\n".join(lines)


def _send_gears(recording: Any, views: Sequence[RunView]) -> None:
    fit = [view for view in views if view.run.role == "fit"] or list(views)
    for name, of_meshes in mesh_shares(fit).items():
        send_gear(recording, f"gear/{name}")
        send_shares(recording, f"gear/{name}", of_meshes)


def _send_run(recording: Any, view: RunView) -> RunLayout:
    name = view.run.name
    kinds = {}
    for kind in KINDS:
        of_kind = [j for j, m in enumerate(view.meshes) if m.startswith(kind)]
        known = [j for j in of_kind if np.isfinite(view.force["measured"][:, j]).all()]
        if known:
            kinds[kind] = _send_courses(recording, view, kind, known)
    meshes = _portrayed(view)
    for mesh in meshes:
        _send_portraits(recording, view, mesh)
    _log_text(recording, f"{name}/about", run_text(view))
    return RunLayout(name, view.run.role, kinds, meshes, tuple(view.planes))


def run_text(view: RunView) -> str:
    """Return the operating point of a run, and notes on missing data, as Markdown."""
    point = [f"- {name} {value:.4g}" for name, value in view.run.point.items()]
    notes = [f"- {text}" for text in view.notes]
    return "\n".join([f"### {view.run.name}, {view.run.role}", "", *point, *notes])


def _send_courses(
    recording: Any, view: RunView, kind: str, at: Sequence[int]
) -> dict[str, tuple[float, float]]:
    """Send forces and residuals of meshes ``at`` of a kind; return limits of both axes [kN]."""
    measured = view.force["measured"]
    columns = {("force", name): view.force[name] for name in COLUMNS}
    columns |= {("residual", name): measured - view.force[name] for name in COLUMNS[1:]}
    colours = mesh_colours(view.run.model.layout)
    names = [view.meshes[j] for j in at]
    limits: dict[str, tuple[float, float]] = {}
    for (what, name), values in columns.items():
        values_kn = 1e-3 * values[:, at]
        path = f"{view.run.name}/{what}/{name}/{kind}"
        style = rr.SeriesLines(names=names, colors=[colours[m] for m in names])
        recording.log(path, style, static=True)
        index = [rr.TimeColumn(TIMELINE, duration=view.times)]
        recording.send_columns(path, index, rr.Scalars.columns(scalars=values_kn))
        low, high = limits_for(values_kn.ravel())
        before = limits.get(what, (low, high))
        limits[what] = min(low, before[0]), max(high, before[1])
    return {what: limits[what] for what in COURSES}


def _portrayed(view: RunView) -> tuple[str, ...]:
    """Return the mesh with the largest nominal residual as a tuple; empty without motions."""
    if not view.planes:
        return ()
    return (view.meshes[int(np.argmax(np.nan_to_num(view.reduced_chi2["nominal"])))],)


def _send_portraits(recording: Any, view: RunView, mesh: str) -> None:
    """Send a phase portrait of a mesh for each column with a motion, with equal limits."""
    j = view.meshes.index(mesh)
    scales = view.run.model.scales
    unit = np.array([scales.b_c, scales.velocity_m_per_s])
    orbits = {name: plane[:, j] / unit for name, plane in view.planes.items()}
    orbits = {name: orbit for name, orbit in orbits.items() if np.isfinite(orbit).all()}
    if not orbits:
        return
    every: Array = np.concatenate(list(orbits.values()))
    axes = Axes(limits_for(every[:, 0]), limits_for(every[:, 1]))
    border = float(view.run.model.half_backlash_m[j]) / scales.b_c
    frame = Frame(axes, f"x_{mesh} / b_c", "v / (b_c ω_n)", border)
    colour = mesh_colours(view.run.model.layout)[mesh]
    for name, orbit in orbits.items():
        path = f"{view.run.name}/plane/{name}/{mesh}"
        send_frame(recording, path, frame)
        line = rr.LineStrips2D([axes.place(smooth(orbit))], colors=[colour], radii=LINE)
        recording.log(f"{path}/orbit", line, static=True)


def _log_text(recording: Any, path: str, text: str) -> None:
    document = rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
    recording.log(path, document, static=True)
