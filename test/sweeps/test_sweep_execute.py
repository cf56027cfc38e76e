"""Sweeps over cores, processes and a Dask cluster; killed and gone on with; values that fail."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from sweep_support import ROOT, assert_same, axis, gear, run, small

from herringbone_sim.__main__ import main
from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.integrate import simulate
from herringbone_sim.core.model import build
from herringbone_sim.errors import AnalysisError
from herringbone_sim.sweeps import cluster, execute
from herringbone_sim.sweeps.grid import Observation, Sweep
from herringbone_sim.sweeps.store import Store, load_result, load_store, open_store

# Chaos, and heat that leaves no backlash, in one grid.
HOSTILE = Sweep(
    gear(), (axis("delta_T", 0.0, 330.0, 4), axis("K", 0.0, 0.3, 2)), Observation(5, 5, 5), chunk=3
)


def test_values_are_those_of_the_model_itself(tmp_path: Path) -> None:
    sweep = small()
    found = run(tmp_path, sweep, workers=1)
    series, _ = simulate(build(sweep.parameters_at(7)), 22)
    assert found["points"][1, 3] == pytest.approx(series["x_sp_L"][12:] / 1e-4, rel=1e-6)
    batch = run_batch([build(sweep.parameters_at(7))], None, 12, 10, 10, True)
    assert found["exponent"][1, 3] == batch.exponents[0]
    assert found["within"][1, 3] == batch.within[0]
    assert found["ring_drive"][1, 3] == batch.contact[0, 2:, 2].mean()


@pytest.mark.parametrize("start", ["fixed", "down"])
def test_results_do_not_depend_on_workers_or_chunks(tmp_path: Path, start: str) -> None:
    first = run(tmp_path / "a", small(start, 12), workers=1)
    assert_same(first, run(tmp_path / "b", small(start, 1), workers=2))
    assert_same(first, run(tmp_path / "c", small(start, 5), workers=3))


def test_failures_are_nan_with_their_reason(tmp_path: Path) -> None:
    found = run(tmp_path, HOSTILE, workers=1)
    failed = found.reasons != ""
    assert failed.tolist() == [[False] * 2, [False] * 2, [True] * 2, [True] * 2]
    assert "can't be negative" in found.reasons[3, 0]
    for column in found.columns.values():
        assert np.isnan(column[failed]).all()
    assert np.isfinite(found["exponent"][~failed]).all()
    (failure,) = found.failures()
    assert failure.count == 4
    assert failure.ranges == {"delta_T": (220.0, 330.0), "K": (0.0, 0.3)}
    assert failure.reason == found.reasons[2, 0]
    assert str(failure).startswith("4 failed at delta_T = 220 to 330, K = 0 to 0.3: delta_T = 220")


def test_a_motion_that_diverges_is_nan_with_its_reason(tmp_path: Path) -> None:
    sweep = Sweep(gear(b_c=1e-9, delta_T=0.0), (axis("T_1", 220.0, 1e7, 2),), Observation(5, 5, 5))
    found = run(tmp_path, sweep, workers=1)
    assert found.reasons.tolist() == ["", "diverged"]
    assert np.isnan(found["asymmetry"]).tolist() == [False, True]


def test_a_run_that_is_whole_computes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = run(tmp_path, small(), workers=1)
    monkeypatch.setattr(execute, "observe_parts", None)
    assert_same(first, run(tmp_path, small(), workers=1))


@pytest.mark.parametrize("start", ["up", "down", "ramp_up"])
def test_chains_go_on_from_any_part(tmp_path: Path, start: str) -> None:
    whole = run(tmp_path / "a", small(start), workers=1)
    run(tmp_path / "b", small(start), workers=1)
    cut = open_store(tmp_path / "b", small(start))
    for part in (0, 1) if start == "down" else (1, 2):
        cut.path(part).unlink()
    assert_same(whole, run(tmp_path / "b", small(start), workers=1))


def _hear_interrupts() -> None:
    """As on a terminal: a job in the background is born deaf to them."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.parametrize(("sign", "code"), [(signal.SIGKILL, -9), (signal.SIGINT, 130)])
def test_a_killed_sweep_goes_on(tmp_path: Path, sign: signal.Signals, code: int) -> None:
    over = ["--over=delta_T=0:100:8", "--over=K=0:0.6:8", "--workers=1", "--chunk=1"]
    gear_of = [f"--parameters={ROOT / 'config/paper.yaml'}", "--transient=60", "--cycles=40"]
    command = ["sweep", *gear_of, *over, "--out", str(tmp_path / "killed")]
    process = subprocess.Popen(
        [sys.executable, "-m", "herringbone_sim", *command],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=_hear_interrupts,
    )
    wait_for(tmp_path / "killed" / "fixed", 5)
    process.send_signal(sign)
    told, _ = process.communicate()
    assert process.returncode == code
    assert ("the same command goes on from there" in told) is (code == 130)
    parts = sorted((tmp_path / "killed" / "fixed" / "parts").glob("*.parquet"))
    assert 5 <= len(parts) < 64
    before = {path: path.stat().st_mtime_ns for path in parts}
    assert main(command) == 0
    assert {path: path.stat().st_mtime_ns for path in parts} == before
    store = load_store(tmp_path / "killed" / "fixed")
    assert_same(load_result(store), run(tmp_path / "whole", store.sweep, workers=1))


def test_a_dask_worker_that_dies_loses_nothing(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="the package needs dask[distributed]")
    axes = (axis("delta_T", 0.0, 100.0, 8), axis("K", 0.0, 0.6, 8))
    sweep = Sweep(gear(), axes, Observation(100, 50, 50), chunk=1)
    store = open_store(tmp_path / "dask", sweep)
    left: list[int] = []
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as local:
        victim = next(iter(local.workers.values())).pid
        killer = threading.Thread(target=kill_after, args=(victim, store, left))
        killer.start()
        execute.run_stores([store], scheduler=local.scheduler_address)
        killer.join()
        chain = run(tmp_path / "chain", small("down"), scheduler=local.scheduler_address)
    assert left[0] > 0
    assert_same(chain, run(tmp_path / "here", small("down"), workers=1))
    assert_same(load_result(store), run(tmp_path / "local", sweep, workers=1))


@pytest.mark.parametrize("address", ["nonsense", "tcp://127.0.0.1", "foo://here:1", "tcp://a:b"])
def test_what_is_no_address_is_told_at_once(tmp_path: Path, address: str) -> None:
    pytest.importorskip("distributed", reason="the package needs dask[distributed]")
    with pytest.raises(AnalysisError, match="no Dask scheduler answers"):
        run(tmp_path, small(), scheduler=address)


@pytest.mark.parametrize("listening", [False, True])
def test_a_scheduler_that_is_not_there_is_told_and_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, listening: bool
) -> None:
    """Nobody there, or somebody who does not speak as Dask does."""
    distributed = pytest.importorskip("distributed", reason="the package needs dask[distributed]")
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    monkeypatch.setattr(distributed, "Client", None)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        if listening:
            other.listen()
        with pytest.raises(AnalysisError, match="no Dask scheduler answers"):
            run(tmp_path, small(), scheduler=f"tcp://127.0.0.1:{other.getsockname()[1]}")


def kill_after(pid: int, store: Store, left: list[int]) -> None:
    """Kill a process once three parts are written; what was missing then goes into ``left``."""
    wait_for(store.folder, 3)
    os.kill(pid, signal.SIGKILL)
    left.append(len(store.missing()))


def wait_for(folder: Path, parts: int) -> None:
    """Until so many parts are written; ten minutes at most: it may compile first."""
    until = time.monotonic() + 600.0
    while len(list((folder / "parts").glob("*.parquet"))) < parts and time.monotonic() < until:
        time.sleep(0.005)
