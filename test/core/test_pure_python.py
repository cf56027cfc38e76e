"""The kernel read by the interpreter gives what its compiled form gives.

Compiled functions are the same text under another set of rules for types, division and slices;
this holds the two against each other, and lets coverage see into the kernel. Where products are
fused the interpreter rounds twice: Runge-Kutta agrees to the bit, series nearly.
"""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import interpreted
import numpy as np
import pytest

HERE = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def both(tmp_path_factory):
    """(compiled, interpreted) results of all cases; processes that share the tests make them
    once.
    """
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    results = folder / "compiled.npz", folder / "interpreted.npz"
    with (folder / "both.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not results[1].exists():
            run_cases(results[0], "0")
            run_cases(results[1], "1")
    return tuple(dict(np.load(one)) for one in results)


def run_cases(out, disabled):
    """Save what comes of all cases, compiled or read by the interpreter.

    Coverage follows the interpreter only: it would slow down the compiler.
    """
    path = os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"NUMBA_DISABLE_JIT": disabled, "PYTHONPATH": path}
    if disabled == "0":
        environment = {k: v for k, v in environment.items() if not k.startswith("COV")}
    command = [sys.executable, str(HERE / "interpreted.py"), str(out)]
    subprocess.run(command, env=environment, check=True, timeout=1500)


@pytest.mark.parametrize("part", ["rows", "end", "tangents", "counts"])
@pytest.mark.parametrize("case", interpreted.CASES)
def test_interpreted_and_compiled_kernel_agree(both, case, part):
    compiled, read = (found[f"{case}_{part}"] for found in both)
    if part == "counts" or interpreted.CASES[case][0].get("method") == "rk4":
        assert np.array_equal(compiled, read)
    else:
        np.testing.assert_allclose(compiled, read, rtol=1e-9, atol=1e-9)


def test_interpreted_and_compiled_search_agree(both):
    assert np.array_equal(both[0]["leaving"], both[1]["leaving"])


@pytest.mark.parametrize(("name", "within"), [("cycles_reduced", 1e-9), ("cycles_rk4", 0.0)])
def test_interpreted_and_compiled_cycles_agree(both, name, within):
    compiled, read = (found[name] for found in both)
    np.testing.assert_allclose(compiled, read, rtol=within, atol=within)


@pytest.mark.parametrize("case", interpreted.LANES_CASES)
def test_interpreted_and_compiled_lanes_agree(both, case):
    compiled, read = (found[f"lanes_{case}"] for found in both)
    assert np.array_equal(np.isnan(compiled), np.isnan(read))
    assert np.nanmax(np.abs(compiled - read)) < 1e-8


@pytest.mark.parametrize("case", interpreted.EFFECT_CASES)
def test_interpreted_and_compiled_effects_agree(both, case):
    compiled, read = (found[f"effects_{case}"] for found in both)
    np.testing.assert_allclose(compiled, read, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("case", interpreted.EFFECT_BATCHES)
def test_interpreted_and_compiled_lanes_with_effects_agree(both, case):
    compiled, read = (found[f"effect_lanes_{case}"] for found in both)
    np.testing.assert_allclose(compiled, read, atol=1e-6)


@pytest.mark.parametrize("where", ["columns", "column_lanes"])
@pytest.mark.parametrize("case", interpreted.COLUMN_CASES)
def test_interpreted_and_compiled_columns_agree(both, case, where):
    compiled, read = (found[f"{where}_{case}"] for found in both)
    assert np.abs(compiled - read).max() < 1e-6 * np.abs(compiled).max()
