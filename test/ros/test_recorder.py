"""The recorder with deliveries as the loop makes them: several files, files that vanish."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from gears import make
from support import Bench, values, wait_until

from herringbone_sim.core.model import build
from herringbone_sim.effects.stepper import change, stepper
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.replay import verify
from herringbone_sim.ros.recorder import Recorder
from herringbone_sim.ros.session import Limits
from herringbone_sim.runtime import Change, Delivery

BLOCK = 160


def deliveries(model, count: int, changes: dict[int, dict[str, float]]) -> Iterator[Delivery]:
    """Blocks of 160 samples; some begin with a change."""
    machine = stepper(model, ())
    state = machine.start(tangents=1)
    for number in range(count):
        made = ()
        if number in changes:
            new = stepper(build(machine.model.parameters.changed(changes[number])), ())
            state, machine = change(machine, new, state), new
            made = (Change(state.t, changes[number]),)
        block = machine.advance(state, BLOCK)
        yield Delivery(block, machine.model, made, number == 0)
        state = block.end


class Taken:
    """A recorder, what it said, and what it was given."""

    def __init__(self, folder: Path, limits: Limits) -> None:
        self.said: list[str] = []
        self.model = make(delta_T=20.0)
        self.recorder = Recorder("/sim", lambda _: [0], self.said.append)
        start = stepper(self.model, ()).start()
        self.path = self.recorder.start(folder, "run", self.model, start, limits=limits)

    def put(self, made: Delivery, on_disk: bool = False) -> None:
        self.recorder.put(made)
        if on_disk:
            before = self.recorder.samples
            wait_until(lambda: self.recorder.samples > before)


@pytest.mark.parametrize(
    ("limits", "least"), [(Limits(span_s=0.004), 3), (Limits(size_mb=0.03), 3), (Limits(), 1)]
)
def test_no_sample_is_lost_or_repeated_over_the_files(
    tmp_path: Path, limits: Limits, least: int
) -> None:
    taken = Taken(tmp_path, limits)
    changes = {3: {"K": 0.3}, 8: {"Omega": 1.1, "xi": 0.09}, 9: {"K": 0.1}}
    made = list(deliveries(taken.model, 20, changes))
    for number, one in enumerate(made):
        taken.put(one, on_disk=limits.size_mb > 0 and number % 4 == 0)
    outcome = taken.recorder.stop()
    assert str(outcome) == f"3200 samples written, 0 lost, to {taken.path}"
    found = sorted(taken.path.glob("*.mcap"))
    assert len(found) >= least
    assert least > 1 or len(found) == 1
    run = read_recording(taken.path)
    np.testing.assert_array_equal(run.samples.data, np.concatenate([d.block.rows for d in made]))
    assert run.complete
    assert [made.values for made in run.changes] == list(changes.values())
    verdict = verify(run)
    assert (verdict.identical, verdict.changes) == (True, 3)
    alone = [verify(read_recording(file)) for file in found]
    assert all(one.identical for one in alone)
    assert sum(one.samples for one in alone) == 3200


def test_a_tiny_limit_leaves_no_file_without_samples(tmp_path: Path) -> None:
    taken = Taken(tmp_path, Limits(size_mb=1e-6, span_s=1e-9))
    for one in deliveries(taken.model, 4, {}):
        taken.put(one)
    taken.recorder.stop()
    files = sorted(taken.path.glob("*.mcap"))
    assert [len(read_recording(file).samples) for file in files] == [BLOCK] * 4


@pytest.mark.parametrize("fault", ["unlink", "folder", "moved"])
def test_the_recording_goes_on_in_another_run_where_one_vanishes(
    tmp_path: Path, fault: str
) -> None:
    taken = Taken(tmp_path, Limits())
    made = list(deliveries(taken.model, 6, {4: {"K": 0.3}}))
    taken.put(made[0], on_disk=True)
    if fault == "unlink":
        (taken.path / "run_0.mcap").unlink()
    elif fault == "folder":
        shutil.rmtree(taken.path)
    else:
        taken.path.rename(tmp_path / "moved")
    wait_until(lambda: taken.recorder.error)
    assert "was disturbed" in taken.recorder.error
    assert str(taken.path / "run_0.mcap") in taken.said[0]
    for one in made[1:]:
        taken.put(one)
    wait_until(lambda: taken.recorder.path == tmp_path / "run-2")
    outcome = taken.recorder.stop()
    kept = 6 if fault == "moved" else 5
    assert outcome.lost == BLOCK * (6 - kept)
    assert (outcome.written, outcome.offered) == (BLOCK * kept, BLOCK * 6)
    assert outcome.path == tmp_path / "run-2"
    assert len(outcome.losses) == 1
    assert any("goes on in" in said and "run-2" in said for said in taken.said)
    run = read_recording(tmp_path / "run-2")
    assert run.complete
    np.testing.assert_array_equal(
        run.samples.data, np.concatenate([d.block.rows for d in made[1:]])
    )
    verdict = verify(run)
    assert (verdict.identical, verdict.changes) == (True, 1)
    if fault == "moved":
        assert verify(read_recording(tmp_path / "moved")).identical


def test_a_file_that_is_gone_at_a_border_costs_that_file_alone(tmp_path: Path) -> None:
    taken = Taken(tmp_path, Limits(span_s=1e-9))
    (taken.path / "run_0.mcap").unlink()
    made = list(deliveries(taken.model, 4, {}))
    for one in made:
        taken.put(one)
    outcome = taken.recorder.stop()
    assert (outcome.written, outcome.offered) == (BLOCK * 3, BLOCK * 4)
    run = read_recording(tmp_path / "run-2")
    np.testing.assert_array_equal(
        run.samples.data, np.concatenate([d.block.rows for d in made[1:]])
    )


def test_many_losses_are_told_in_a_line(tmp_path: Path) -> None:
    taken = Taken(tmp_path, Limits())
    for number, one in enumerate(deliveries(taken.model, 6, {})):
        taken.put(one, on_disk=True)
        assert taken.recorder.path is not None
        shutil.rmtree(taken.recorder.path)
        wait_until(lambda number=number: len(taken.said) > 2 * number)
    outcome = taken.recorder.stop()
    assert len(outcome.losses) == 6
    assert "3 before that" in str(outcome)
    assert outcome.written == 0


def test_a_run_that_vanishes_right_before_the_end_is_not_told_as_good(tmp_path: Path) -> None:
    taken = Taken(tmp_path, Limits())
    for one in deliveries(taken.model, 5, {}):
        taken.put(one)
    shutil.rmtree(taken.path)
    outcome = taken.recorder.stop()
    assert (outcome.written, outcome.offered) == (0, 800)
    assert "800 lost (" in str(outcome)
    assert "was deleted" in str(outcome)


def test_where_no_other_run_can_be_made_the_recording_ends_and_says_so(tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    taken = Taken(folder, Limits())
    made = list(deliveries(taken.model, 3, {}))
    taken.put(made[0], on_disk=True)
    shutil.rmtree(folder)
    folder.write_text("in the way")
    wait_until(lambda: taken.recorder.error)
    taken.put(made[1])
    wait_until(lambda: "not a folder" in taken.recorder.error)
    taken.put(made[2])
    with pytest.raises(OSError, match="0 samples written, 480 lost"):
        taken.recorder.stop()


def test_stop_and_diagnostics_tell_that_a_recording_vanished(bench: Bench, tmp_path: Path) -> None:
    node = bench.simulator(record=True, record_dir=str(tmp_path), record_name="one")
    got = bench.listen(DiagnosticArray, "/diagnostics")
    wait_until(lambda: node.recorder.samples > 0)
    shutil.rmtree(tmp_path / "one")
    wait_until(lambda: node.recorder.path == tmp_path / "one-2")
    told = len(got)
    wait_until(lambda: len(got) > told + 1)
    status = got[-1].status[0]
    assert status.level != status.OK
    assert "one_0.mcap was deleted" in status.message
    assert "one-2" in values(status)["recorder"]
    stopped = bench.call("record/stop")
    assert not stopped.success
    assert "one_0.mcap was deleted" in stopped.message
    assert Path(stopped.message.split()[-1]) == tmp_path / "one-2"
    assert verify(read_recording(tmp_path / "one-2")).identical


def test_stop_succeeds_where_a_run_was_moved_and_nothing_is_lost(
    bench: Bench, tmp_path: Path
) -> None:
    node = bench.simulator(record=True, record_dir=str(tmp_path), record_name="one")
    wait_until(lambda: node.recorder.samples > 0)
    (tmp_path / "one").rename(tmp_path / "elsewhere")
    wait_until(lambda: node.recorder.path == tmp_path / "one-2")
    stopped = bench.call("record/stop")
    assert stopped.success
    assert " 0 lost " in stopped.message
    assert "nothing is lost, its" in stopped.message
    assert str(tmp_path / "elsewhere" / "one_0.mcap") in stopped.message


def test_a_reset_goes_on_recording_after_a_recording_vanished(
    bench: Bench, tmp_path: Path
) -> None:
    node = bench.simulator(record=True, record_dir=str(tmp_path), record_name="one")
    wait_until(lambda: node.recorder.samples > 0)
    shutil.rmtree(tmp_path / "one")
    wait_until(lambda: node.recorder.path == tmp_path / "one-2")
    answer = bench.call("reset")
    assert answer.success
    assert "one_0.mcap was deleted" in answer.message
    last = Path(answer.message.split()[-1])
    assert node.recorder.path == last
    assert bench.call("record/stop").success


@pytest.mark.parametrize("limit", [{"record_max_s": 0.05}, {"record_max_mb": 1}])
def test_a_node_parts_its_recording_into_files(
    bench: Bench, tmp_path: Path, limit: dict[str, float]
) -> None:
    node = bench.simulator(
        record=True, record_dir=str(tmp_path), record_name="one", real_time_factor=0.0, **limit
    )
    wait_until(lambda: len(list((tmp_path / "one").glob("*.mcap"))) > 3, 60.0)
    assert bench.set(K=0.4)[0].successful
    reached = node.loop.t_s
    wait_until(lambda: node.loop.t_s > reached + 0.2)
    stopped = bench.call("record/stop")
    assert ", 0 lost," in stopped.message
    run = read_recording(tmp_path / "one")
    assert run.complete
    verdict = verify(run)
    assert (verdict.identical, verdict.changes) == (True, 1)
