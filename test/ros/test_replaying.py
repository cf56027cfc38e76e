"""A recording sent by ``replay --publish``: its end, its clock, its start, its round."""

from __future__ import annotations

import fcntl
import os
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray
from support import Bench, table, wait_until

from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.recording.writer import RunWriter

N, STEP_S = 2000, 1e-3


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Two seconds of samples, a thousand a second, that are their own numbers."""
    names = build(Parameters()).layout.channels
    writer = RunWriter.create(tmp_path, "sent", "/sim", {}, names, 0)
    rows = np.zeros((N, len(names)))
    rows[:, 0] = STEP_S * np.arange(N)
    rows[:, 1] = 2 * np.pi * np.arange(N) / 16
    rows[:, 5] = np.arange(N)
    writer.write_samples(rows)
    writer.close()
    return tmp_path / "sent"


def start(bench: Bench, run: Path, *options: str) -> subprocess.Popen[str]:
    environment = {**os.environ, "ROS_DOMAIN_ID": str(bench.domain), "PYTHONWARNINGS": "ignore"}
    command = [sys.executable, "-m", "herringbone_sim", "replay", str(run), "--publish"]
    return subprocess.Popen(
        [*command, "--node-name", "replayed", *options],
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def listen(bench: Bench) -> list[Float64MultiArray]:
    return bench.listen(Float64MultiArray, "/replayed/samples", 1000)


def times(got: list[Float64MultiArray]) -> np.ndarray:
    return np.concatenate([table(message)[1][:, 0] for message in list(got)])


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)], ids=["term", "int"]
)
def test_a_signal_ends_it_in_a_line(bench: Bench, run: Path, number: int, code: int) -> None:
    got = listen(bench)
    player = start(bench, run, "--speed", "0.01")
    wait_until(lambda: got, 60.0)
    player.send_signal(number)
    output, errors = player.communicate(timeout=30)
    assert "Traceback" not in output + errors
    assert player.returncode == code, errors
    assert f"of {N} samples sent" in output
    assert "ended by SIG" in output


def test_it_says_at_once_what_it_does_and_a_log_stays_short(bench: Bench, run: Path) -> None:
    player = start(bench, run, "--speed", "1")
    output, errors = player.communicate(timeout=60)
    assert player.returncode == 0, errors
    assert "sent: sending 1.999 s on /replayed/samples" in output
    assert f"{N} of {N} samples sent" in output
    assert len(output.splitlines()) < 6
    assert "%" not in errors


def test_a_terminal_sees_it_go_on(bench: Bench, run: Path) -> None:
    terminal, end = os.openpty()
    fcntl.ioctl(end, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    environment = {**os.environ, "ROS_DOMAIN_ID": str(bench.domain), "PYTHONWARNINGS": "ignore"}
    command = [sys.executable, "-m", "herringbone_sim", "replay", str(run), "--publish"]
    player = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=end)
    assert player.wait(60) == 0
    os.close(end)
    assert "2.00k/2.00k" in os.read(terminal, 100_000).decode()
    os.close(terminal)


def test_a_round_begins_again_until_it_is_ended(bench: Bench, run: Path) -> None:
    got = listen(bench)
    player = start(bench, run, "--speed", "4", "--loop", "--start", "1.5")
    wait_until(lambda: got and (np.diff(times(got)) < 0).sum() >= 2, 60.0)
    assert player.poll() is None
    player.send_signal(signal.SIGTERM)
    assert player.wait(30) == 143
    sent = times(got)
    assert sent.min() == pytest.approx(1.5)
    assert sent[np.flatnonzero(np.diff(sent) < 0)] == pytest.approx((N - 1) * STEP_S)


def test_a_start_leaves_out_what_is_before_it(bench: Bench, run: Path) -> None:
    got = listen(bench)
    player = start(
        bench, run, "--start-offset", "1.25", "--speed", "0.2"
    )  # slow: listeners may be late
    output, errors = player.communicate(timeout=60)
    assert player.returncode == 0, errors
    assert "750 of 750 samples sent" in output
    time.sleep(0.5)
    assert times(got).min() >= 1.25 - 1e-9


def test_its_clock_is_the_time_of_the_recording(bench: Bench, run: Path) -> None:
    clock = bench.listen(Clock, "/clock", 100)
    player = start(bench, run, "--clock", "50", "--start", "0.5", "--speed", "0.5")
    assert player.wait(60) == 0
    wait_until(lambda: len(clock) > 50)
    stamps = np.array([m.clock.sec + 1e-9 * m.clock.nanosec for m in clock])
    assert stamps.min() >= 0.5
    assert stamps.max() <= (N - 1) * STEP_S + 1e-9
    assert (np.diff(stamps) >= 0).all()


def test_two_clocks_are_refused(bench: Bench, run: Path) -> None:
    bench.client.create_publisher(Clock, "/clock", 10)
    player = start(bench, run, "--clock", "--speed", "0.05")  # 40 s: discovery may be late
    _, errors = player.communicate(timeout=60)
    assert player.returncode == 2
    assert "/clock" in errors
    assert "Traceback" not in errors


def test_a_second_clock_ends_it_while_it_is_sent(bench: Bench, run: Path) -> None:
    got = listen(bench)
    player = start(bench, run, "--clock", "--speed", "0.05")
    wait_until(lambda: got, 60.0)
    bench.client.create_publisher(Clock, "/clock", 10)
    _, errors = player.communicate(timeout=60)
    assert player.returncode == 2
    assert "another node publishes /clock" in errors


@pytest.mark.parametrize(
    "options",
    [("--start", "3"), ("--start", "-1"), ("--start", "nan"), ("--clock", "0"), ("--speed", "0")],
    ids=" ".join,
)
def test_what_cannot_be_is_one_line(bench: Bench, run: Path, options: tuple[str, str]) -> None:
    player = start(bench, run, *options)
    _, errors = player.communicate(timeout=60)
    assert player.returncode == 2
    assert options[0].strip("-") in errors
    assert "Traceback" not in errors
