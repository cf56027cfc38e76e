"""Parts of sweeps and kept arrays with altered bytes: read as they were written, or not at all."""

from __future__ import annotations

import contextlib
import io
import time
from pathlib import Path

import numpy as np

from benchmarks.faults.trial import Trial
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.sweeps.array_cache import ArrayCache
from herringbone_sim.sweeps.grid import Axis, Observation, Sweep, with_sweep_steps
from herringbone_sim.sweeps.observe import Table
from herringbone_sim.sweeps.store import open_store

COUNT = 40


def sweep_parts(seed: int, folder: Path) -> Trial:
    """Alter, cut or swap bytes of a Parquet part, or of a kept ``.npz``; read it back."""
    rng = np.random.default_rng(seed)
    began = time.monotonic()
    altered, fault = (_parquet if seed % 2 else _kept)(rng, folder)
    return Trial(fault, seconds=time.monotonic() - began, altered=altered)


def spoilt(content: bytes, rng: np.random.Generator) -> tuple[bytes, str]:
    """Content with some bytes altered, and what was done."""
    bad, said = bytearray(content), []
    for _ in range(int(rng.integers(1, 5))):
        at, kind = int(rng.integers(len(bad))), int(rng.integers(4))
        if kind == 0:
            bad[at] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            bad[at : at + 8] = rng.bytes(8)
        elif kind == 2:
            bad = bad[: max(at, 1)]
        else:
            other = int(rng.integers(len(bad)))
            bad[at], bad[other] = bad[other], bad[at]
        said.append(f"{('bit', 'bytes', 'cut', 'swap')[kind]} at {at}")
    return bytes(bad), ", ".join(said)


def _table(rng: np.random.Generator) -> Table:
    x = np.where(rng.random(COUNT) < 0.1, np.nan, rng.normal(size=COUNT))
    reasons = np.array(["" if np.isfinite(one) else "diverged" for one in x], dtype=object)
    return {
        "index": np.arange(COUNT),
        "delta_T": np.linspace(0.0, 90.0, COUNT),
        "period": rng.integers(0, 9, COUNT).astype(float),
        "exponent": x,
        "points": rng.normal(size=(COUNT, 8)),
        "reason": reasons,
    }


def _parquet(rng: np.random.Generator, folder: Path) -> tuple[int, str]:
    axis = Axis("delta_T", tuple(float(value) for value in np.linspace(0.0, 90.0, COUNT)))
    base = with_sweep_steps(Parameters(planet_angle=(0.0, 120.0, 240.0)), {})
    look = Observation(12, 10, 8, True, "sp_L")
    store = open_store(folder, Sweep(base, (axis,), look, "up", COUNT))
    table = _table(rng)
    store.write(0, table)
    bad, said = spoilt(store.path(0).read_bytes(), rng)
    store.path(0).write_bytes(bad)
    read = store.read_part(0)
    return (0 if read is None else differing(table, read)), f"parquet: {said}"


def _kept(rng: np.random.Generator, folder: Path) -> tuple[int, str]:
    table = {name: values for name, values in _table(rng).items() if name != "reason"}
    ArrayCache(folder).get(["a"], lambda: table)
    (path,) = folder.iterdir()
    bad, said = spoilt(path.read_bytes(), rng)
    path.write_bytes(bad)
    with contextlib.redirect_stderr(io.StringIO()):
        read = ArrayCache(folder).get(["a"], lambda: table)
    return differing(table, read), f"npz: {said}"


def differing(table: Table, read: Table) -> int:
    """Values of a table that are others in what was read."""
    if table.keys() != read.keys():
        return sum(values.size for values in table.values())
    return sum(_apart(table[name], read[name]) for name in table)


def _apart(one: np.ndarray, other: np.ndarray) -> int:
    if one.shape != other.shape or one.dtype != other.dtype:
        return one.size
    same = one == other
    return int((~same & ~(one != one) | (one != one) & ~(other != other)).sum())
