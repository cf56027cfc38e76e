"""Maps in several processes: what comes back is what one process would have made."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from herringbone_sim.diagnosis import parallel
from herringbone_sim.diagnosis.parallel import MAX_JOBS, forked_map


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two processes, wherever this runs."""
    monkeypatch.setattr(parallel, "cores", lambda: 2)


def process_of(item: int) -> int:
    """The process that does an item, which takes as long as a fork: 20 ms."""
    time.sleep(0.02)
    return os.getpid()


def test_results_come_in_the_order_of_the_items_from_two_processes() -> None:
    count = 2 * MAX_JOBS + 3  # jobs of two or three items
    assert forked_map(lambda i: i * i, range(count)) == [i * i for i in range(count)]
    processes = set(forked_map(process_of, range(20)))
    assert len(processes) == 2
    assert os.getpid() in processes


def test_a_map_inside_a_map_and_one_in_a_thread_stay_in_their_process() -> None:
    inner = forked_map(lambda i: (process_of(i), forked_map(process_of, range(3))), range(6))
    assert all(set(of_item) == {process} for process, of_item in inner)
    made: list[list[int]] = []
    thread = threading.Thread(target=lambda: made.append(forked_map(process_of, range(4))))
    thread.start()
    thread.join()
    assert set(made[0]) == {os.getpid()}


def test_an_exception_is_raised_wherever_it_arose() -> None:
    def refuse_late(i: int) -> int:
        time.sleep(0.01)
        if i == 7:
            raise ValueError(f"no {i}")
        return i

    for _ in range(4):  # in this process or the other one
        with pytest.raises(ValueError, match="no 7"):
            forked_map(refuse_late, range(20))
    assert forked_map(process_of, range(2))  # the next map is not disturbed


def test_what_a_killed_process_did_not_send_is_done_here() -> None:
    here = os.getpid()

    def killed_elsewhere(i: int) -> int:
        time.sleep(0.01)
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        return i

    assert forked_map(killed_elsewhere, range(10)) == list(range(10))


def test_results_that_cannot_be_sent_are_made_here() -> None:
    made = forked_map(lambda i: (process_of(i), lambda: i), range(6))
    assert [function() for _, function in made] == list(range(6))
    assert {process for process, _ in made} == {os.getpid()}


def test_without_further_processes_one_does_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """No file stays open, whether a process could not be forked or a map succeeded."""
    before = os.listdir("/proc/self/fd")

    def no_fork() -> int:
        raise BlockingIOError("no process left")

    with monkeypatch.context() as patched:
        patched.setattr(os, "fork", no_fork)
        assert set(forked_map(process_of, range(3))) == {os.getpid()}
    forked_map(process_of, range(3))
    assert os.listdir("/proc/self/fd") == before


def test_forked_processes_end_with_their_parent() -> None:
    """The parent ends in its first job; the other process begins no more than one after that."""
    script = """
import os, sys, time
from herringbone_sim.diagnosis import parallel
parallel.cores = lambda: 2
here = os.getpid()
def job(i):
    time.sleep(0.1)
    if os.getpid() == here:
        os._exit(0)
    sys.stdout.write("."), sys.stdout.flush()
parallel.forked_map(job, range(50))
"""
    ended = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60.0
    )
    assert len(ended.stdout) <= 2
    assert not ended.stderr


def test_a_map_succeeds_where_the_system_reaps_the_processes() -> None:
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    try:
        assert forked_map(lambda i: i, range(8)) == list(range(8))
    finally:
        signal.signal(signal.SIGCHLD, before)
