"""Runs and files for the tests of the recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

from herringbone_sim.recording.messages import encode_samples, encode_string
from herringbone_sim.recording.schemas import FLOAT64_MULTI_ARRAY, STRING
from herringbone_sim.recording.writer import SAMPLES, RunWriter

NAMES = ("t", "phase", "K", "delta_T", "T_1", "x_sp_L", "F_sp_L")
START_NS = 1_700_000_000_000_000_000
SAMPLES_PER_CYCLE = 16
RATE_HZ = 80_000.0
CHANNELS: dict[str, Any] = {
    "schema": "herringbone_sim/channels/1",
    "version": "0.1.0",
    "source": "simulator",
    "model": "reduced",
    "channels": [{"name": name, "unit": "s" if name == "t" else "-"} for name in NAMES],
    "parameters": {"Omega": 1.0},
    "samples_per_cycle": SAMPLES_PER_CYCLE,
}


def make_rows(start: int, stop: int) -> NDArray[np.float64]:
    """Samples start to stop (stop - start, 7), each value determined by its index."""
    index = np.arange(start, stop)
    phase = index * 2 * np.pi / SAMPLES_PER_CYCLE
    constant = np.ones_like(phase)
    x = np.sin(0.37 * phase) * 1e-5
    columns = (index / RATE_HZ, phase, 0.3 * constant, 90 * constant, 220 * constant, x, 1e8 * x)
    return np.stack(columns, axis=1)


def new_run(folder: Path, name: str = "run") -> RunWriter:
    return RunWriter.create(folder, name, "/herringbone_sim", CHANNELS, NAMES, START_NS)


def write_run(folder: Path, n: int = 5000, name: str = "run") -> Path:
    """A finished run of n samples, flushed every 2500, with a change at sample 800; its folder."""
    writer = new_run(folder, name)
    for start in range(0, n, 2500):
        writer.write_samples(make_rows(start, min(start + 2500, n)))
        writer.flush()
    writer.write_parameter_event(800 / RATE_HZ, "/herringbone_sim", {"K": 0.5})
    meshes = np.array([1e-5, 2e-5])
    writer.write_state(0.01, ("sp_L", "sp_R"), meshes, 10 * meshes, 1e8 * meshes)
    writer.close({"dropped_blocks": "0"})
    return writer.path


def foreign_file(
    path: Path,
    blocks: list[NDArray[np.float64]],
    names: tuple[str, ...] = NAMES,
    compression: CompressionType = CompressionType.NONE,
    chunked: bool = True,
    finish: bool = True,
    channels: str | None = '{"source": "rig"}',
    samples_topic: str = "/rig/a/samples",
    log_times: list[int] | None = None,
) -> Path:
    """An MCAP file as another program writes it: one message a block, little else."""
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression, use_chunking=chunked, chunk_size=20_000)
        writer.start("ros2", "rig")
        topics = {}
        for topic, kind in (("/rig/a/channels", STRING), (samples_topic, FLOAT64_MULTI_ARRAY)):
            schema = writer.register_schema(kind.name, "ros2msg", kind.text.encode())
            topics[topic] = writer.register_channel(topic, "cdr", schema)
        if channels is not None:
            writer.add_message(topics["/rig/a/channels"], 0, encode_string(channels), 0)
        for number, rows in enumerate(blocks):
            log_ns = log_times[number] if log_times else number
            message = encode_samples(names, rows)
            writer.add_message(topics[samples_topic], log_ns, message, log_ns)
        if finish:
            writer.finish()
        else:
            writer.flush()
    return path


def write_message(writer: RunWriter, message: bytes, t_s: float, n: int) -> None:
    """Write a message as if it held n samples from t_s [s] on, which the writer never does."""
    writer._write(SAMPLES, t_s, message, None)
    writer._counts[-1].add(n, t_s, t_s)


def write_bag(path: Path, *topics: tuple[str, str, NDArray[np.float64]]) -> None:
    """A bag of (topic, label of the channels, rows), a message each."""
    store = get_typestore(Stores.ROS2_JAZZY)
    block, layout, axis = (
        store.types[f"std_msgs/msg/{name}"]
        for name in ("Float64MultiArray", "MultiArrayLayout", "MultiArrayDimension")
    )
    with BagWriter(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            name: writer.add_connection(name, block.__msgtype__, typestore=store)
            for name in dict.fromkeys(name for name, *_ in topics)
        }
        for name, label, rows in topics:
            n, k = rows.shape
            axes = [axis("sample", n, n * k), axis(label, k, k)]
            message = block(layout(axes, 0), rows.ravel())
            data = store.serialize_cdr(message, block.__msgtype__)
            writer.write(connections[name], 1, data)
