"""A short recording, deterministic, as the campaigns against its files write it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.recording.writer import RunWriter

NAMES = ("t", "phase", "K", "delta_T", "T_1", "x_sp_L", "F_sp_L")
START_NS = 1_700_000_000_000_000_000
RATE_HZ = 80_000.0
SAMPLES_PER_CYCLE = 16
BLOCK_S = 0.02  # wall time of a delivery of the node
FLUSH_BLOCKS = 13  # the node flushes after 0.25 s: with the first block behind it
BLOCK = 200
FILE_BLOCKS = 20
BLOCKS = 50


def rows_of(start: int, stop: int) -> NDArray[np.float64]:
    """Samples start to stop (stop - start, 7), each value determined by its index."""
    index = np.arange(start, stop)
    phase = index * 2 * np.pi / SAMPLES_PER_CYCLE
    held = np.ones_like(phase)
    noise = np.random.default_rng(7).normal(size=BLOCK * BLOCKS)[start:stop]
    columns = (index / RATE_HZ, phase, 0.3 * held, 90 * held, 220 * held, 1e-5 * noise, noise)
    return np.stack(columns, axis=1)


def content_at(sample: int) -> dict[str, object]:
    """Content of the ``channels`` topic of a file that begins with a sample."""
    return {"source": "simulator", "parameters": {}, "first": sample}


def write_run(
    folder: Path, note: Callable[[RunWriter, int], None] = lambda writer, handed: None
) -> RunWriter:
    """Record ``folder/run`` as the node does: blocks, a flush each 0.25 s, a file each 0.4 s.

    Args:
        note: told the writer, and the samples handed in, before each block.
    """
    writer = RunWriter.create(folder, "run", "/sim", content_at(0), NAMES, START_NS)
    for number in range(BLOCKS):
        start = number * BLOCK
        note(writer, start)
        if number and number % FILE_BLOCKS == 0:
            writer.next_file(content_at(start), start / RATE_HZ)
        if number % FLUSH_BLOCKS == FLUSH_BLOCKS - 1:
            writer.flush()
        writer.write_samples(rows_of(start, start + BLOCK))
    writer.close()
    return writer


def seconds_of(samples: int) -> float:
    """Wall time [s] in which the node records so many samples here."""
    return samples / BLOCK * BLOCK_S
