"""Small recordings to be spoilt: of this package and of rigs, whole and cut."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer

from herringbone_sim.core.integrate import Stepper
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters, to_mapping
from herringbone_sim.recording.messages import encode_samples, encode_string
from herringbone_sim.recording.schemas import FLOAT64_MULTI_ARRAY, STRING
from herringbone_sim.recording.writer import RunWriter

SAMPLES = 400
BLOCK = 50


@lru_cache(maxsize=1)
def motion() -> tuple[tuple[str, ...], Any, list[dict[str, Any]]]:
    """Channel names, rows (n, c) and, at the start of each half, what ``channels`` says."""
    p = Parameters(delta_T=20.0, z_s=30, z_p=30, z_r=90)
    stepper = Stepper(build(p))
    state, rows, told = stepper.start(), [], []
    for _ in range(2):
        stored = {"y": state.y.tolist(), "cycle": state.cycle, "index": state.index, "t": state.t}
        told.append({"source": "simulator", "parameters": to_mapping(p), "state": stored})
        block = stepper.advance(state, SAMPLES // 2)
        state = block.end
        rows.append(block.rows)
    return stepper.model.layout.channels, np.concatenate(rows), told


def simulated(folder: Path, split: bool = False, finish: bool = True) -> Path:
    """A run of the simulator, flushed after each block; in two files if wanted."""
    names, rows, told = motion()
    writer = RunWriter.create(folder, "run", "/sim", told[0], names, 0)
    for at in range(0, SAMPLES, BLOCK):
        if split and at == SAMPLES // 2:
            writer.next_file(told[1], float(rows[at, 0]))
        writer.write_samples(rows[at : at + BLOCK])
        writer.flush()
    if finish:
        writer.close()
    return writer.path


def cut_run(folder: Path) -> Path:
    """A run whose file ends within a record."""
    run = simulated(folder, finish=False)
    _cut(run / "run_0.mcap")
    return run


def split_run(folder: Path) -> Path:
    """A run of two files; the index of the first is damaged, the second ends within a record."""
    run = simulated(folder, split=True, finish=False)
    first = run / "run_0.mcap"
    content = bytearray(first.read_bytes())
    content[-60] ^= 0xFF
    first.write_bytes(content)
    _cut(run / "run_1.mcap")
    return run


def _cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-1000])


@lru_cache
def _contents(make: Callable[[Path], Path]) -> tuple[str, dict[str, bytes]]:
    with tempfile.TemporaryDirectory() as folder:
        run = make(Path(folder))
        return run.name, {file.name: file.read_bytes() for file in run.iterdir()}


def copied(make: Callable[[Path], Path], folder: Path) -> Path:
    """The run that ``make`` makes in a folder, made once."""
    name, contents = _contents(make)
    (folder / name).mkdir()
    for file, content in contents.items():
        (folder / name / file).write_bytes(content)
    return folder / name


def of_rig(
    folder: Path, compression: CompressionType, chunked: bool = True, channels: str = "{}"
) -> Path:
    """The same samples as another program writes them, in a folder without ``metadata.yaml``."""
    names, rows, _ = motion()
    folder.mkdir()
    with (folder / "rig_0.mcap").open("wb") as stream:
        writer = Writer(stream, chunk_size=40_000, compression=compression, use_chunking=chunked)
        writer.start("ros2", "rig")
        numbers = []
        for topic, kind in (("channels", STRING), ("samples", FLOAT64_MULTI_ARRAY)):
            schema = writer.register_schema(kind.name, "ros2msg", kind.text.encode())
            numbers.append(writer.register_channel(f"/rig/{topic}", "cdr", schema))
        writer.add_message(numbers[0], 0, encode_string(channels), 0)
        for at in range(0, SAMPLES, BLOCK):
            writer.add_message(numbers[1], at, encode_samples(names, rows[at : at + BLOCK]), at)
        writer.add_metadata("rig", {"operator": "me"})
        writer.finish()
    return folder
