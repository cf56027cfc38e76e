"""Steps, pauses and resets of the loop, against a clock that the test owns."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import pytest
from loop_support import Run

from herringbone_sim.core.model import Model, build
from herringbone_sim.errors import HerringboneError, ParameterError
from herringbone_sim.runtime import (
    Delivery,
    Stepped,
)


def test_another_sample_grid_waits_for_phase_0(model: Model, runs: list[Run]) -> None:
    run = Run(model, real_time_factor=0.0013)
    runs.append(run)
    run.loop.start()
    run.until(5)
    new = build(model.parameters.changed({"samples_per_cycle": 20}))
    run.loop.submit(new, {"samples_per_cycle": 20})
    run.until(len(run.got) + 60)
    run.loop.close()
    (t_s,) = [c.t_s for d in run.got for c in d.changes]
    at = int(np.flatnonzero(run.rows[:, 0] == t_s)[0])
    steps = np.diff(run.rows[:, 1])
    assert run.rows[at, 1] / (2 * np.pi) == pytest.approx(round(run.rows[at, 1] / (2 * np.pi)))
    np.testing.assert_allclose(steps[:at], 2 * np.pi / 16, rtol=1e-9)
    np.testing.assert_allclose(steps[at:], 2 * np.pi / 20, rtol=1e-9)


def test_pause_step_resume_lose_and_repeat_no_sample(model: Model, runs: list[Run]) -> None:
    run = Run(model, real_time_factor=1.0, paused=True)
    runs.append(run)
    run.loop.start()
    for cycles in (1, 3, 400):
        assert run.loop.step(cycles).cut == ""
    assert run.loop.state.cycle == 404
    run.loop.resume()
    with pytest.raises(HerringboneError, match="call pause first"):
        run.loop.step(1)
    run.until(len(run.got) + 3)
    run.loop.pause()
    run.loop.close()
    np.testing.assert_allclose(np.diff(run.rows[:, 1]), 2 * np.pi / 16, rtol=1e-9)


def test_reset_starts_again_at_t_0_and_says_so(model: Model, runs: list[Run]) -> None:
    run = Run(model, real_time_factor=1.0)
    runs.append(run)
    run.loop.start()
    run.until(3)
    run.loop.call(lambda *_: run.loop.reset())
    run.until(len(run.got) + 3)
    run.loop.close()
    (again,) = [d for d in run.got if d.restarted]
    np.testing.assert_array_equal(again.block.rows[0], run.got[0].block.rows[0])


def test_an_error_in_a_call_reaches_the_caller_and_the_loop_goes_on(
    model: Model, runs: list[Run]
) -> None:
    run = Run(model)
    runs.append(run)
    run.loop.start()

    def fail(*_: object) -> None:
        raise ParameterError("no")

    with pytest.raises(ParameterError, match="no"):
        run.loop.call(fail)
    run.until(len(run.got) + 2)


def held(run: Run) -> threading.Event:
    """Start a loop and hold it inside a block, until the event is set."""
    inside, go_on = threading.Event(), threading.Event()

    def hold(_: Delivery) -> None:
        inside.set()
        go_on.wait(10.0)

    run.loop.start()
    run.until(1)
    run.hook = hold
    assert inside.wait(10.0)
    return go_on


def test_a_call_that_came_too_late_is_not_made_after_all(model: Model, runs: list[Run]) -> None:
    run = Run(model)
    runs.append(run)
    made: list[str] = []
    go_on = held(run)
    with pytest.raises(HerringboneError, match=r"did not come to it within 0\.01 s"):
        run.loop.call(lambda *_: made.append("late"), timeout_s=0.01)
    run.hook = lambda _: None
    go_on.set()
    run.loop.call(lambda *_: made.append("in time"))
    assert made == ["in time"]


def test_a_timeout_of_what_is_called_is_its_own(model: Model, runs: list[Run]) -> None:
    """Such as that of a disk on the network."""
    run = Run(model)
    runs.append(run)
    run.loop.start()

    def fail(*_: object) -> None:
        raise TimeoutError("the disk")

    with pytest.raises(TimeoutError, match="the disk"):
        run.loop.call(fail)


def test_step_counts_cycles_when_the_sample_grid_changes(model: Model, runs: list[Run]) -> None:
    run = Run(model, paused=True)
    runs.append(run)
    run.loop.start()
    assert run.loop.step(2).cut == ""
    for grid in (64, 10, 16):
        before = run.loop.state.cycle
        values = {"samples_per_cycle": grid}
        run.loop.submit(build(model.parameters.changed(values)), values)
        assert run.loop.step(3).cut == ""
        assert run.loop.state.cycle == before + 3
        assert run.loop.state.index == 0


def long_step(run: Run) -> Future[Stepped]:
    """A step of far more cycles than a test can wait for, well under way."""
    run.loop.start()
    came = ThreadPoolExecutor(1).submit(run.loop.step, 10**6)
    run.until(len(run.got) + 3)
    return came


@pytest.mark.parametrize("end", ["pause", "resume", "reset"])
def test_a_long_step_is_cut_short_and_tells_what_it_did(
    model: Model, runs: list[Run], end: str
) -> None:
    run = Run(model, paused=True)
    runs.append(run)
    step = long_step(run)
    ends: dict[str, Callable[[], object]] = {
        "pause": run.loop.pause,
        "resume": run.loop.resume,
        "reset": lambda: run.loop.call(lambda *_: run.loop.reset()),
    }
    ends[end]()
    came = step.result(10.0)
    assert came.cut == f"interrupted by {end}"
    stood = next(i for i, d in enumerate(run.got) if d.block.end.t == came.t_s)
    rows = sum(len(d.block.rows) for d in run.got[: stood + 1])
    assert came.cycles == pytest.approx(rows / 16, abs=1e-9)
    assert run.loop.paused == (end != "resume")


def test_one_step_at_a_time_and_none_after_the_end(model: Model, runs: list[Run]) -> None:
    run = Run(model, paused=True)
    runs.append(run)
    step = long_step(run)
    with pytest.raises(HerringboneError, match="a step is under way"):
        run.loop.step(1)
    run.loop.close()
    assert step.result(10.0).cut == "the simulation ended"
    for ask in (lambda: run.loop.step(1), lambda: run.loop.call(lambda *_: 0)):
        with pytest.raises(HerringboneError, match="has ended"):
            ask()


def test_a_reset_drops_what_was_changed_while_paused(model: Model, runs: list[Run]) -> None:
    run = Run(model, paused=True)
    runs.append(run)
    run.loop.start()
    assert run.loop.step(5).cut == ""
    run.loop.submit(build(model.parameters.changed({"K": 0.3})), {"K": 0.3})
    while run.loop.model.parameters.K != 0.3:
        time.sleep(0.002)
    run.loop.call(lambda *_: run.loop.reset())
    assert run.loop.step(1).cut == ""
    assert run.got[-1].restarted
    assert run.got[-1].changes == ()
    assert run.got[-1].block.rows[0, 0] == 0.0
    assert run.got[-1].block.rows[0, 2] == 0.3


def test_a_step_asked_for_during_a_block_has_its_own_length(model: Model, runs: list[Run]) -> None:
    """That block, begun before the pause, is no part of it."""
    run = Run(model, real_time_factor=0.0)
    runs.append(run)
    go_on = held(run)
    run.loop.pause()
    came = ThreadPoolExecutor(1).submit(run.loop.step, 1)
    time.sleep(0.2)
    run.hook = lambda _: None
    go_on.set()
    assert came.result(10.0) == Stepped(1.0, run.loop.t_s)
