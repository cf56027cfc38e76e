"""Services: pause, resume, step, reset, record; and what happens when the motion diverges."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Float64MultiArray
from support import Bench, table, values, wait_until

from herringbone_sim.recording.reader import read_recording
from herringbone_sim.replay import verify


def test_pause_stops_and_resume_goes_on(bench: Bench) -> None:
    node = bench.simulator()
    wait_until(lambda: node.loop.t_s > 0.05)
    assert bench.call("pause").success
    stood = node.loop.call(lambda _, state: state.t)
    assert node.loop.call(lambda _, state: state.t) == stood
    assert bench.call("resume").success
    wait_until(lambda: node.loop.t_s > stood)


def test_step_is_exact_and_refused_unless_paused(bench: Bench) -> None:
    got = bench.listen(Float64MultiArray, "/herringbone_sim/samples")
    node = bench.simulator(start_paused=True, step_cycles=7)
    wait_until(lambda: node.count_subscribers("/herringbone_sim/samples") > 0)
    assert bench.call("step").success
    assert bench.call("step").success
    assert node.loop.state.cycle == 14
    assert node.loop.state.index == 0
    wait_until(lambda: sum(len(table(m)[1]) for m in got) == 14 * 16)
    assert bench.call("resume").success
    refused = bench.call("step")
    assert not refused.success
    assert "pause" in refused.message


def test_a_long_step_delays_nothing_and_is_ended_by_pause(bench: Bench, tmp_path: Path) -> None:
    node = bench.simulator(
        start_paused=True, step_cycles=10**6, record=True, record_dir=str(tmp_path)
    )
    step = bench.begin("step")
    wait_until(lambda: node.loop.t_s > 0.0, 60.0)
    assert bench.call("record/stop").success
    assert bench.set(K=0.1)[0].successful
    again = bench.call("step")
    assert not again.success
    assert "a step is under way" in again.message
    assert not step.done()
    assert bench.call("pause").success
    wait_until(step.done)
    came = step.result()
    assert not came.success
    assert "of 1000000 mesh cycles" in came.message
    assert "interrupted by pause" in came.message
    done = float(came.message.split()[1])
    assert done == pytest.approx(node.loop.state.cycle + node.loop.state.index / 16, rel=1e-6)
    step = bench.begin("step")
    reached = node.loop.t_s
    wait_until(lambda: node.loop.t_s > reached)
    assert bench.call("reset").success
    wait_until(step.done)
    assert "interrupted by reset" in step.result().message
    assert node.loop.t_s == 0.0


def test_reset_starts_again_from_the_initial_state(bench: Bench) -> None:
    node = bench.simulator(initial_x=[0.5], initial_noise=0.1, seed=3)
    first = node.loop.call(lambda model, _: node.loop.model.parameters)
    assert first.seed == 3
    wait_until(lambda: node.loop.t_s > 0.1)
    assert bench.call("pause").success
    assert bench.call("reset").success
    assert node.loop.t_s == 0.0
    again = node.loop.state.y
    from herringbone_sim.core.model import initial_state

    np.testing.assert_array_equal(again, initial_state(node.loop.model))


def test_recording_starts_and_stops_with_the_absolute_path(bench: Bench, tmp_path: Path) -> None:
    bench.simulator(record_dir=str(tmp_path / "deep" / "runs"), record_name="first")
    started = bench.call("record/start")
    assert started.success
    path = Path(started.message.split()[-1])
    assert path == tmp_path / "deep" / "runs" / "first"
    twice = bench.call("record/start")
    assert not twice.success
    assert str(path) in twice.message
    stopped = bench.call("record/stop")
    assert stopped.success
    assert Path(stopped.message.split()[-1]) == path
    assert len(read_recording(path).samples) > 0
    assert not bench.call("record/stop").success
    existing = bench.call("record/start")
    assert not existing.success
    assert "first" in existing.message


@pytest.mark.parametrize("name", ["../out", "/tmp/out", "a/b", ".."])
def test_a_name_does_not_lead_out_of_the_folder(bench: Bench, tmp_path: Path, name: str) -> None:
    bench.simulator(record_dir=str(tmp_path / "runs"), record_name=name)
    refused = bench.call("record/start")
    assert not refused.success
    assert not list(tmp_path.rglob("*.mcap"))


def test_a_folder_that_cant_be_written_does_not_end_the_simulation(
    bench: Bench, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("in the way")
    node = bench.simulator(record=True, record_dir=str(tmp_path / "file"))
    assert not bench.call("record/start").success
    reached = node.loop.t_s
    wait_until(lambda: node.loop.t_s > reached)


def test_a_reset_while_recording_goes_on_in_another_run(bench: Bench, tmp_path: Path) -> None:
    node = bench.simulator(record=True, record_dir=str(tmp_path), record_name="one")
    wait_until(lambda: node.loop.t_s > 0.05)
    answer = bench.call("reset")
    assert answer.success
    second = Path(answer.message.split()[-1])
    wait_until(lambda: node.loop.t_s > 0.02)
    assert bench.call("record/stop").success
    for path in (tmp_path / "one", second):
        run = read_recording(path)
        assert run.samples.times[0] == 0.0
        assert run.complete


def test_divergence_pauses_reports_and_keeps_the_recording(bench: Bench, tmp_path: Path) -> None:
    """RK4 with 4 steps a cycle and xi 2 is far beyond its stability limit."""
    node = bench.simulator(
        method="rk4",
        steps_per_cycle=4,
        samples_per_cycle=4,
        xi=2.0,
        record=True,
        record_dir=str(tmp_path),
        record_name="gone",
        initial_x=[1.0],
    )
    got = bench.listen(DiagnosticArray, "/diagnostics")
    wait_until(lambda: got and values(got[-1].status[0])["fault"])
    fault = values(got[-1].status[0])["fault"]
    assert "t = " in fault
    assert "xi=2.0" in fault
    assert node.loop.paused
    assert not bench.call("resume").success
    assert bench.call("record/stop").success
    assert len(read_recording(tmp_path / "gone").samples) > 1
    assert bench.set(xi=0.07)[0].successful
    assert bench.call("reset").success


def test_a_steered_run_is_repeated_to_the_bit(bench: Bench, tmp_path: Path) -> None:
    node = bench.simulator(model="full", delta_T=30.0, initial_noise=0.05, seed=7)
    wait_until(lambda: node.loop.t_s > 0.05)
    assert bench.set(record_dir=str(tmp_path), record_name="steered")[0].successful
    assert bench.call("record/start").success
    for change in ({"K": 0.3}, {"Omega": 1.1}, {"samples_per_cycle": 20}, {"xi": 0.09, "K": 0.1}):
        reached = node.loop.t_s
        wait_until(lambda t=reached: node.loop.t_s > t + 0.03)
        assert bench.set_whole(**change).successful
    reached = node.loop.t_s
    wait_until(lambda: node.loop.t_s > reached + 0.05)
    assert bench.call("record/stop").success
    verdict = verify(read_recording(tmp_path / "steered"))
    assert verdict.changes == 4
    assert verdict.identical


def test_as_fast_as_possible_loses_no_sample_either(bench: Bench, tmp_path: Path) -> None:
    node = bench.simulator(
        real_time_factor=0.0, record=True, record_dir=str(tmp_path), record_name="fast"
    )
    wait_until(lambda: node.loop.t_s > 2.0, 60.0)
    stopped = bench.call("record/stop")
    assert ", 0 lost," in stopped.message
    run = read_recording(tmp_path / "fast")
    np.testing.assert_allclose(np.diff(run.samples["phase"]), 2 * np.pi / 16, rtol=1e-6)
    assert run.samples.times[0] == 0.0
    assert verify(run).identical


def test_a_burst_of_changes_at_one_sample_is_repeated_to_the_bit(
    bench: Bench, tmp_path: Path
) -> None:
    node = bench.simulator(record=True, record_dir=str(tmp_path), record_name="burst")
    wait_until(lambda: node.loop.t_s > 0.05)
    for k in range(30):
        assert bench.set(Omega=1.0 - 0.1 * (k % 2))[0].successful
    reached = node.loop.t_s
    wait_until(lambda: node.loop.t_s > reached + 0.05)
    assert bench.call("record/stop").success
    run = read_recording(tmp_path / "burst")
    assert len(run.changes) == 30
    assert verify(run).identical


def test_a_slow_mesh_does_not_diverge_while_running(bench: Bench) -> None:
    """Sixteen steps a cycle were far too few at Omega 0.05."""
    node = bench.simulator(real_time_factor=0.0)
    assert bench.set(Omega=0.05)[0].successful
    wait_until(lambda: node.loop.model.parameters.Omega == 0.05)
    reached = node.loop.state.cycle
    wait_until(lambda: node.loop.state.cycle > reached + 200, 60.0)
    assert not node.loop.paused


def test_an_unforeseen_error_ends_neither_recorder_nor_node(bench: Bench, tmp_path: Path) -> None:
    node = bench.simulator(record_dir="~nosuchuser/x")
    refused = bench.call("record/start")
    assert not refused.success
    assert "nosuchuser" in refused.message
    assert bench.set(record_dir=str(tmp_path), record_name="spoilt")[0].successful

    def broken(_: object) -> list[int]:
        raise ValueError("no such row")

    node.recorder._decimate = broken
    assert bench.call("record/start").success
    reached = node.loop.t_s
    wait_until(lambda: "no such row" in node.recorder.error)
    wait_until(lambda: node.loop.t_s > reached + 0.1)
    stopped = bench.call("record/stop")
    assert not stopped.success
    assert "no such row" in stopped.message


def test_a_reset_happens_even_where_the_next_run_cant_be_written(
    bench: Bench, tmp_path: Path
) -> None:
    node = bench.simulator(record=True, record_dir=str(tmp_path), record_name="one")
    wait_until(lambda: node.loop.t_s > 0.05)
    (tmp_path / "file").write_text("in the way")
    assert bench.set(record_dir=str(tmp_path / "file"))[0].successful
    assert bench.call("pause").success
    answer = bench.call("reset")
    assert answer.success
    assert "not recording" in answer.message
    assert node.loop.t_s == 0.0
    assert read_recording(tmp_path / "one").complete
