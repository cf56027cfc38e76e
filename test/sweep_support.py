"""What the tests of the sweeps share: small sweeps of the paper's gear."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.sweeps.execute import run_stores
from herringbone_sim.sweeps.grid import Axis, Observation, Sweep, with_sweep_steps
from herringbone_sim.sweeps.store import Result, load_result, open_store

ROOT = Path(__file__).resolve().parents[1]


def gear(**values: object) -> Parameters:
    """A reading of the paper's gear with the steps of a sweep and some values changed."""
    reading = {"gamma": 1.2e-5, "thermal_rp": "sun", "projection": "torque"}
    return with_sweep_steps(Parameters(), {}).changed(reading | values)


def axis(name: str, low: float, high: float, count: int) -> Axis:
    return Axis(name, tuple(float(value) for value in np.linspace(low, high, count)))


def small(start: str = "fixed", chunk: int = 4, mesh: str = "sp_L", **values: object) -> Sweep:
    """12 values of K and delta_T, short."""
    axes = (axis("delta_T", 60.0, 90.0, 3), axis("K", 0.0, 0.3, 4))
    return Sweep(gear(**values), axes, Observation(12, 10, 10, True, mesh), start, chunk)


def run(folder: Path, sweep: Sweep, **how: object) -> Result:
    """The result of a sweep that is run, or gone on with, in a folder."""
    store = open_store(folder, sweep)
    run_stores([store], **how)
    assert not store.missing()
    return load_result(store)


def assert_same(one: Result, other: Result) -> None:
    """Equal to the bit, NaN where NaN is."""
    assert one.columns.keys() == other.columns.keys()
    for name, column in one.columns.items():
        assert np.array_equal(column, other[name], equal_nan=True), name
    assert one.reasons.tolist() == other.reasons.tolist()
