"""Series and maps with known answers for the tests of the analysis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.timeseries import TimeSeries

Array = NDArray[np.float64]
HEAD = ("t", "phase", "K", "delta_T", "T_1")
MESH_HZ = 100.0


def series_of(columns: Mapping[str, Array]) -> TimeSeries:
    return TimeSeries(
        np.asarray(columns["t"]), np.stack(list(columns.values()), axis=1), tuple(columns)
    )


def harmonic_series(
    cycles: float,
    orders: Mapping[float, float],
    per_cycle: int = 16,
    first_phase: float = 0.0,
    **settings: Array | float,
) -> TimeSeries:
    """x = sum of amplitude sin(order phase), v its exact rate, mesh frequency 100 Hz."""
    n = round(cycles * per_cycle) + 1
    t = np.arange(n) / per_cycle / MESH_HZ
    phase = first_phase + 2 * np.pi * MESH_HZ * t
    x = sum(a * np.sin(order * phase) for order, a in orders.items())
    omega = 2 * np.pi * MESH_HZ
    v = sum(a * order * omega * np.cos(order * phase) for order, a in orders.items())
    head = {"K": 0.0, "delta_T": 50.0, "T_1": 220.0} | settings
    columns = {"t": t, "phase": phase} | {k: np.broadcast_to(h, n) for k, h in head.items()}
    return series_of(columns | {"x_sp_L": np.asarray(x), "v_sp_L": np.asarray(v)})


def mapped_series(points: Array, per_cycle: int = 16) -> TimeSeries:
    """A motion whose section at phase 0 is ``points`` (m, 2): x and v move smoothly between."""
    m = len(points)
    turns = np.arange((m - 1) * per_cycle + 1) / per_cycle
    before = np.minimum(turns.astype(int), m - 2)
    share = (turns - before)[:, None]
    weight = share**3 * (10 - 15 * share + 6 * share**2)
    state = points[before] * (1 - weight) + points[before + 1] * weight
    columns = {"t": turns / MESH_HZ, "phase": 2 * np.pi * turns}
    columns |= {name: np.zeros_like(turns) for name in ("K", "delta_T", "T_1")}
    return series_of(columns | {"x_sp_L": state[:, 0], "v_sp_L": state[:, 1]})


def logistic(n: int, r: float = 4.0) -> Array:
    x = np.empty(n)
    x[0] = 0.3
    for i in range(1, n):
        x[i] = r * x[i - 1] * (1 - x[i - 1])
    return x[:, None]


def henon(n: int) -> Array:
    z = np.zeros((n + 50, 2))
    for i in range(1, n + 50):
        z[i] = 1 - 1.4 * z[i - 1, 0] ** 2 + z[i - 1, 1], 0.3 * z[i - 1, 0]
    return z[50:]


def circle(n: int) -> Array:
    """Quasi-periodic points on a bent ring."""
    angle = np.arange(n) * np.pi * (np.sqrt(5) - 1)
    return np.stack((np.cos(angle), np.sin(angle), 0.3 * np.cos(2 * angle)), axis=1)


def steps(counts: Sequence[int], values: Sequence[float], total: int) -> Array:
    """Values held for so many rows each, the last one to the end."""
    held = np.repeat(np.asarray(values, dtype=float), counts)[:total]
    return np.concatenate((held, np.full(total - len(held), values[-1])))
