"""The node as users start it: a process, its signals, its files, the other programs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from std_msgs.msg import Float64MultiArray
from support import Bench, table, wait_until

from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.recover import recover


def start(domain: int, *options: str, module: str = "herringbone_sim") -> subprocess.Popen[str]:
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "PYTHONWARNINGS": "ignore"}
    verb = ["run"] if module == "herringbone_sim" else []
    words = [word for option in options for word in ("-p", option)]
    return subprocess.Popen(
        [sys.executable, "-m", module, *verb, "--ros-args", *words],
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )


def size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def test_a_killed_run_keeps_all_but_the_last_half_second(domain: int, tmp_path: Path) -> None:
    node = start(domain, "record:=true", f"record_dir:={tmp_path}", "record_name:=cut")
    file = tmp_path / "cut" / "cut_0.mcap"
    wait_until(lambda: size(file) > 10_000_000, 60.0)
    before = time.monotonic()
    held = len(read_recording(tmp_path / "cut").samples)
    time.sleep(max(0.0, before + 1.0 - time.monotonic()))
    node.kill()
    node.wait()
    cut = read_recording(tmp_path / "cut")
    assert not cut.complete
    assert len(cut.samples) > held
    report = recover(tmp_path / "cut")
    assert report is not None
    mended = read_recording(tmp_path / "cut")
    assert mended.complete
    np.testing.assert_array_equal(mended.samples.data, cut.samples.data[: len(mended.samples)])
    assert len(mended.samples) == len(cut.samples)


def test_an_interrupted_node_finishes_its_recording(domain: int, tmp_path: Path) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        name = f"end{number}"
        node = start(domain, "record:=true", f"record_dir:={tmp_path}", f"record_name:={name}")
        wait_until(lambda n=name: size(tmp_path / n / f"{n}_0.mcap") > 1_000_000, 60.0)
        node.send_signal(number)
        output, _ = node.communicate(timeout=30)
        assert node.returncode == 0, output
        assert " 0 lost" in output
        assert read_recording(tmp_path / name).complete


def test_an_interrupt_ends_a_step_that_answers_and_the_node(bench: Bench) -> None:
    node = start(bench.domain, "start_paused:=true", "step_cycles:=1000000")
    samples = bench.listen(Float64MultiArray, "/herringbone_sim/samples")
    step = bench.begin("step")
    wait_until(lambda: len(samples) > 1)
    node.send_signal(signal.SIGINT)
    output, _ = node.communicate(timeout=60)
    assert node.returncode == 0, output
    assert "Traceback" not in output
    # rclpy says this of a callback that it had not begun when its executor was destroyed.
    of_rclpy = "never retrieved: cannot use Destroyable because destruction was requested"
    assert "never retrieved" not in output.replace(of_rclpy, "")
    wait_until(step.done)
    assert "of 1000000 mesh cycles" in step.result().message
    assert "the simulation ended" in step.result().message


def test_a_start_does_not_judge_the_gear(domain: int) -> None:
    node = start(domain, "start_paused:=true")
    assert node.stdout is not None
    output = next(line for line in node.stdout if "running the reduced model" in line)
    time.sleep(2.0)
    node.send_signal(signal.SIGINT)
    output += node.communicate(timeout=60)[0]
    assert node.returncode == 0, output
    assert "assembled" not in output


def test_wrong_parameters_end_with_one_clear_line(domain: int) -> None:
    node = start(domain, "delta_T:=400.0")
    output, _ = node.communicate(timeout=60)
    assert node.returncode == 2
    assert "half-backlash" in output
    assert "Traceback" not in output


def test_the_control_experiment_finds_an_edge_over_the_public_interface(bench: Bench) -> None:
    bench.simulator(delta_T=50.0, xi=0.1, projection="torque", thermal_rp="sun", gamma=1.2e-5)
    control = start(
        bench.domain, "step:=0.02", "dwell:=0.3", module="herringbone_sim.examples.chaos_control"
    )
    output, _ = control.communicate(timeout=120)
    assert control.returncode == 0, output
    assert "P from K =" in output


def test_a_recording_is_published_over_the_same_topics(bench: Bench, tmp_path: Path) -> None:
    node = bench.simulator(record=True, record_dir=str(tmp_path), record_name="sent")
    wait_until(lambda: node.loop.t_s > 0.3)
    assert bench.call("record/stop").success
    assert bench.call("pause").success
    time.sleep(0.5)
    got = bench.listen(Float64MultiArray, "/replayed/samples", 1000)
    run = read_recording(tmp_path / "sent")
    environment = {**os.environ, "ROS_DOMAIN_ID": str(bench.domain), "PYTHONWARNINGS": "ignore"}
    command = [sys.executable, "-m", "herringbone_sim", "replay", str(tmp_path / "sent")]
    command += ["--publish", "--speed", "0.1", "--node-name", "replayed"]
    subprocess.run(command, env=environment, check=True, timeout=60)
    wait_until(lambda: got)
    time.sleep(0.5)
    rows = np.vstack([table(message)[1] for message in got])
    assert len(rows) > 0.5 * len(run.samples)
    at = int(np.searchsorted(run.samples.times, rows[0, 0]))
    np.testing.assert_array_equal(rows[:10], run.samples.data[at : at + 10])
