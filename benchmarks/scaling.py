"""Sweeps over 1 and 2 workers, as threads and as Dask processes, and what a million values cost.

    python benchmarks/scaling.py [--size 32] [--repeats 5]

The sweep is the paper's gear over delta_T x K, size x size values, 300 + 100 mesh cycles with
exponents each. Seconds are medians over repeats in which the rows take turns; efficiency is
against one worker of the same kind. Memory is that of this process while it runs a sweep through
threads and keeps nothing but the parts under way; the disk holds the table with the points of
one mesh and without.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.core.parameters import ParameterWarning
from herringbone_sim.recording.parameter_file import load_parameters
from herringbone_sim.sweeps.execute import run_stores
from herringbone_sim.sweeps.grid import Axis, Observation, Sweep, with_sweep_steps
from herringbone_sim.sweeps.store import open_store

PAPER = Path(__file__).resolve().parents[1] / "config" / "paper.yaml"
MILLION = 1e6
ROWS = [("threads", 1), ("threads", 2), ("Dask processes", 1), ("Dask processes", 2)]


def sweep_of(size: int, mesh: str = "", chunk: int = 64) -> Sweep:
    """delta_T x K, size x size values."""
    axes = tuple(
        Axis(name, tuple(float(value) for value in np.linspace(0.0, high, size)))
        for name, high in (("delta_T", 100.0), ("K", 0.6))
    )
    look = Observation(mesh=mesh)
    return Sweep(with_sweep_steps(load_parameters(PAPER), {}), axes, look, chunk=chunk)


@contextmanager
def workers_of(kind: str, count: int) -> Iterator[dict[str, Any]]:
    """Arguments of ``run_stores``, the kernel loaded wherever it will run."""
    if kind == "threads":
        yield {"workers": count}
        return
    from distributed import LocalCluster

    look = {"n_workers": count, "threads_per_worker": 1, "dashboard_address": ":0"}
    with LocalCluster(processes=True, **look) as cluster:
        how: dict[str, Any] = {"scheduler": cluster.scheduler_address}
        timed(sweep_of(4, chunk=1), how)
        yield how


def timed(sweep: Sweep, how: dict[str, Any]) -> float:
    """Seconds of wall time of one sweep into a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        store = open_store(folder, sweep)
        start = time.perf_counter()
        run_stores([store], **how)
        return time.perf_counter() - start


def bytes_a_value(sweep: Sweep) -> float:
    """Bytes of the table on disk for each value."""
    with tempfile.TemporaryDirectory() as folder:
        store = open_store(folder, sweep)
        run_stores([store])
        parts = (Path(folder) / "parts").iterdir()
        return sum(path.stat().st_size for path in parts) / sweep.size


def resident_kib() -> int:
    """Resident set size of this process [KiB], as Linux tells it."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    (line,) = [one for one in status.splitlines() if one.startswith("VmRSS:")]
    return int(line.split()[1])


def print_efficiency(size: int, repeats: int) -> float:
    """Print the rows; returns the seconds a value costs one thread."""
    sweep = sweep_of(size)
    seconds: dict[tuple[str, int], list[float]] = {row: [] for row in ROWS}
    timed(sweep_of(8), {"workers": 1})
    for _ in range(repeats):
        for row in ROWS:
            with workers_of(*row) as how:
                seconds[row].append(timed(sweep, how))
    print(f"{'workers':>16} {'seconds':>8} {'values/s':>9} {'ms/value':>9} {'efficiency':>11}")
    for kind, count in ROWS:
        took, alone = (float(np.median(seconds[kind, n])) for n in (count, 1))
        rate = sweep.size / took
        shown = f"{took:8.2f} {rate:9.0f} {1e3 * count / rate:9.2f} {alone / took / count:11.0%}"
        print(f"{count:>2} {kind:13} {shown}")
    return float(np.median(seconds["threads", 1])) / sweep.size


def print_memory(size: int) -> None:
    """Print the resident memory after a sweep, and after one with four times the values."""
    for times in (1, 2):
        sweep = replace(sweep_of(size * times), observation=Observation(20, 20, 20, False))
        timed(sweep, {"workers": 2})
        print(f"resident after {sweep.size:6} values: {resident_kib() / 1024:.0f} MiB")


def main() -> None:
    """Print efficiency, memory, and the cost of a million values."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--size", type=int, default=32, help="values an axis")
    parser.add_argument("--repeats", type=int, default=5, help="timed sweeps of each row")
    options = parser.parse_args()
    warnings.simplefilter("ignore", ParameterWarning)
    os.environ["PYTHONWARNINGS"] = "ignore"  # of the Dask processes
    cost = print_efficiency(options.size, options.repeats)
    print_memory(2 * options.size)
    print(f"a million values: {cost * MILLION / 3600:.2f} core hours")
    for mesh, what in (("", "without"), ("sp_L", "with")):
        size = bytes_a_value(sweep_of(options.size, mesh, chunk=256)) * MILLION / 2**30
        print(f"on disk {what} section points: {size:.2f} GiB")


if __name__ == "__main__":
    main()
