"""Blocks for the mirror, and what Rerun reads of its files."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from herringbone_sim.core.layout import Layout
from herringbone_sim.views.mirror.block import Drawing, MirrorBlock, Scale
from herringbone_sim.views.mirror.mirror import RerunMirror

REDUCED = Layout(1, numbered=False)


SCALE = Scale(1e-4, {"sp": 5e-5, "rp": 5e-5}, 3.2e4)


PLAIN = Drawing(REDUCED)


SCALED = Drawing(REDUCED, SCALE)


FREQUENCY_HZ = 5000.0


SAMPLES = 16


TIMELINES = ("sim_time", "wall_time")


def make_block(
    layout: Layout = REDUCED, start: int = 0, cycles: int = 30, K: float = 0.1, **more: object
) -> MirrorBlock:
    """Harmonic motion of amplitude b_c in every mesh, ``start`` in samples."""
    turns = (start + np.arange(cycles * SAMPLES)) / SAMPLES
    rows = np.zeros((len(turns), len(layout.channels)))
    for column, name in enumerate(layout.channels):
        if name[0] in "xvF" and name != "t":
            rows[:, column] = 1e-4 * np.cos(2 * np.pi * turns)
    rows[:, :5] = np.column_stack(
        [turns / FREQUENCY_HZ, 2 * np.pi * turns, *np.outer([K, 50.0, 220.0], np.ones(len(turns)))]
    )
    return MirrorBlock(
        wall_ns=1_700_000_000_000_000_000 + start,
        names=layout.channels,
        rows=rows,
        sections=rows[::SAMPLES],
        parameters={"K": K, "delta_T": 50.0},
        **more,
    )


def read(path: Path) -> dict[str, list[dict[str, object]]]:
    """Rows of each entity, static ones included; ``sim_time`` and ``wall_time`` in ns."""
    from rerun.chunk import RrdReader

    rows: dict[str, list[dict[str, object]]] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        columns = {
            name: (column.cast("int64") if name in TIMELINES else column).to_pylist()
            for name, column in zip(batch.schema.names, batch.columns, strict=True)
        }
        made = [
            dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
        ]
        rows.setdefault(chunk.entity_path, []).extend(made)
    return rows


def wait_for(mirror: RerunMirror, start: str) -> None:
    deadline = time.monotonic() + 60
    while not mirror.state.startswith(start) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert mirror.state.startswith(start)
