"""Arrangement, names and colours of a live comparison in the viewer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from herringbone_sim.core.layout import Layout
from herringbone_sim.views.mirror.blueprint import (
    KIND_WORDS,
    arranged,
    plane_view,
    side_by_side,
    stack,
    time_course,
)
from herringbone_sim.views.mirror.gear import HEIGHT, WIDTH, send_gear
from herringbone_sim.views.mirror.palette import WORDS, mesh_colours

WORDS_OF = {**KIND_WORDS, "bodies": "all bodies"}


def arrange(recording: Any, places: tuple[str, ...], groups: Mapping[str, Sequence[int]]) -> None:
    """Send static names and colours, and the blueprint.

    Args:
        recording: a ``rerun.RecordingStream``.
        places: meshes, or coordinates of bodies.
        groups: indices of places by mesh kind, or all under ``bodies``.
    """
    meshes = tuple(p for p in places if p[:2] in KIND_WORDS)
    if meshes:
        send_gear(recording, "gear")
    numbered = any(mesh[2].isdigit() for mesh in meshes)
    colours = mesh_colours(Layout(3, True) if numbered else Layout(1, False))
    for kind, at in groups.items():
        names = [places[j] for j in at]
        shades = [colours.get(name, WORDS) for name in names]
        recording.log(f"floors/{kind}", rr.SeriesLines(names=names, colors=shades), static=True)
        for source, width in (("rig", 2.5), ("sim", 1.0)):
            lines = rr.SeriesLines(
                names=[f"{name} {source}" for name in names],
                colors=shades,
                widths=[width] * len(names),
            )
            recording.log(f"force/{kind}/{source}", lines, static=True)
    recording.send_blueprint(_blueprint(bool(meshes), tuple(groups)))


def _blueprint(gear: bool, kinds: tuple[str, ...]) -> Any:
    drawing = plane_view("gear", "Share of the gap by mesh", WIDTH, HEIGHT) if gear else None
    floors = [_course("floors", "Residual / floor", k) for k in kinds]
    force = [_course("force", "RMS force [kN], rig thick", k) for k in kinds]
    text = rrb.TextDocumentView(origin="/text", name="Rig and simulator")
    left = stack([drawing, side_by_side(*floors)], [3.0, 2.0])
    right = stack([text, side_by_side(*force) if gear else None], [3.0, 2.0])
    return arranged(side_by_side(left, right), "wall_time", "following")


def _course(path: str, title: str, kind: str) -> Any:
    return time_course(f"/{path}/{kind}", f"{title}, {WORDS_OF[kind]}")
