"""The loop against a clock that the test owns; Decimator and Pace beside it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import pairwise

import numpy as np
import pytest

from herringbone_sim.core.integrate import Stepper
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters, ParameterWarning
from herringbone_sim.errors import HerringboneError, ParameterError
from herringbone_sim.runtime import (
    Delivery,
    Loop,
    Stepped,
    WallTime,
    check_pace,
    loop,
    sample_period_s,
)

pytestmark = pytest.mark.filterwarnings("ignore::herringbone_sim.core.parameters.ParameterWarning")


class WallClock:
    """Time that passes only where the loop sleeps, or when the test says so."""

    def __init__(self) -> None:
        self.now = 0.0
        self.slept: list[float] = []

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now += seconds


class Run:
    """A loop whose deliveries are kept; closed by the fixture."""

    def __init__(self, model: Model, **options: object) -> None:
        self.clock = WallClock()
        self.got: list[Delivery] = []
        self.left: list[float] = []
        self.faults: list[str] = []
        self.hook = lambda delivery: None
        self.loop = Loop(
            model,
            self._take,
            wall=WallTime(self.clock, self.clock.sleep),
            fail=self.faults.append,
            **options,
        )

    def _take(self, delivery: Delivery) -> None:
        self.got.append(delivery)
        self.left.append(self.clock.now)
        self.hook(delivery)
        time.sleep(0.001)

    def until(self, blocks: int) -> None:
        limit = time.monotonic() + 120.0  # a kernel may have to be compiled
        while len(self.got) < blocks:
            assert time.monotonic() < limit
            time.sleep(0.002)

    @property
    def rows(self) -> np.ndarray:
        return np.vstack([d.block.rows for d in self.got])


@pytest.fixture
def model() -> Model:
    return build(Parameters(delta_T=40.0))


@pytest.fixture
def runs() -> Iterator[list[Run]]:
    made: list[Run] = []
    yield made
    for run in made:
        run.loop.close()


def test_blocks_leave_in_time_at_every_factor(model: Model, runs: list[Run]) -> None:
    for factor in (1.0, 0.01, 1.3e-4):
        run = Run(model, real_time_factor=factor)
        runs.append(run)
        run.loop.start()
        run.until(10)
        run.loop.close()
        assert run.got[9].block.end.t / run.left[9] == pytest.approx(factor, rel=0.02)
        assert max(run.clock.slept) <= 0.1 + 1e-9


def test_a_run_does_not_depend_on_how_it_was_paced(model: Model, runs: list[Run]) -> None:
    for factor in (1.0, 0.0, 0.003):
        runs.append(Run(model, real_time_factor=factor))
        runs[-1].loop.start()
        runs[-1].until(20)
        runs[-1].loop.close()
    stepper = Stepper(model)
    for run in runs:
        whole = stepper.advance(stepper.start(tangents=1), len(run.rows)).rows
        np.testing.assert_array_equal(run.rows, whole)


def test_overload_slips_and_never_bursts(model: Model, runs: list[Run]) -> None:
    run = Run(model, real_time_factor=1.0)
    runs.append(run)

    def stall(delivery: Delivery) -> None:
        if len(run.got) == 5:
            run.clock.now += 3.0

    run.hook = stall
    run.loop.start()
    run.until(12)
    run.loop.close()
    assert run.loop.pace.overruns == 1
    lengths = [len(d.block.rows) for d in run.got]
    assert len(set(lengths)) == 1
    assert run.got[-1].block.end.t < run.clock.now - 2.5


def test_changes_act_once_in_order_and_are_told_with_their_time(
    model: Model, runs: list[Run]
) -> None:
    run = Run(model, real_time_factor=1.0)
    runs.append(run)
    run.loop.start()
    parameters = model.parameters
    for K in (0.1, 0.2, 0.3):
        run.until(len(run.got) + 3)
        parameters = parameters.changed({"K": K})
        run.loop.submit(build(parameters), {"K": K})
    run.until(len(run.got) + 3)
    run.loop.close()
    told = [(c.t_s, c.values["K"]) for d in run.got for c in d.changes]
    assert [K for _, K in told] == [0.1, 0.2, 0.3]
    column = run.rows[:, 2]
    for t_s, K in told:
        at = int(np.flatnonzero(run.rows[:, 0] == t_s)[0])
        assert column[at] == K
        assert column[at - 1] == pytest.approx(K - 0.1)


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


def test_divergence_pauses_and_names_time_and_parameters(runs: list[Run]) -> None:
    p = Parameters(method="rk4", steps_per_cycle=4, samples_per_cycle=4, xi=2.0, initial_x=(1.0,))
    run = Run(build(p), real_time_factor=0.0, paused=True)
    runs.append(run)
    run.loop.start()
    came = run.loop.step(100_000)
    assert "diverged" in came.cut
    assert came.t_s == run.loop.t_s
    assert came.cycles < 100_000
    assert run.loop.paused
    assert "t = " in run.faults[0]
    assert "xi=2.0" in run.faults[0]


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


def test_a_call_that_came_too_late_is_not_made_after_all(model: Model, runs: list[Run]) -> None:
    run = Run(model)
    runs.append(run)
    inside, go_on = threading.Event(), threading.Event()
    made: list[str] = []

    def hold(_: Delivery) -> None:
        inside.set()
        go_on.wait(10.0)

    run.loop.start()
    run.until(1)
    run.hook = hold
    assert inside.wait(10.0)
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


def test_a_kernel_that_fails_to_compile_is_compiled_no_more(
    model: Model, runs: list[Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def begins_at_once(begun: Callable[[], None]) -> Iterator[None]:
        begun()
        yield

    def fail(_: Model) -> None:
        raise MemoryError("no memory")

    monkeypatch.setattr(loop, "on_compiling", begins_at_once)
    monkeypatch.setattr(loop, "warm_up", fail)
    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    run = Run(model)
    runs.append(run)
    run.loop.start()
    run.loop.close()
    assert "no memory" in run.faults[0]
    assert not run.loop.compiling


def test_a_broken_sink_is_reported(model: Model, runs: list[Run]) -> None:
    run = Run(model)
    runs.append(run)
    run.hook = lambda _: 1 / 0
    threading.excepthook, kept = lambda _: None, threading.excepthook
    try:
        run.loop.start()
        limit = time.monotonic() + 10.0
        while not run.faults and time.monotonic() < limit:
            time.sleep(0.01)
    finally:
        run.loop.close()
        threading.excepthook = kept
    assert "ZeroDivisionError" in run.faults[0]


def test_a_pace_that_is_too_slow_is_refused_with_what_would_do(model: Model) -> None:
    least = sample_period_s(model) / 0.1
    check_pace(model, least * 1.001)
    check_pace(model, 0.0)
    with pytest.raises(ParameterError, match="samples_per_cycle"):
        check_pace(model, least * 0.999)


def test_warned_gear_still_runs() -> None:
    with pytest.warns(ParameterWarning, match=r"104 / 3 = 34\.667"):
        Parameters()


def test_deliveries_are_contiguous(model: Model, runs: list[Run]) -> None:
    run = Run(model, real_time_factor=0.0)
    runs.append(run)
    run.loop.start()
    run.until(6)
    run.loop.close()
    for before, after in pairwise(run.got):
        assert before.block.end is after.block.start


def test_a_slower_factor_does_not_sleep_out_the_old_block(model: Model, runs: list[Run]) -> None:
    """A block made at factor 1 or 0 must not be waited for at 0.001: that took 20 s."""
    for before in (1.0, 0.0):
        run = Run(model, real_time_factor=before)
        runs.append(run)
        run.loop.start()
        run.until(4)
        run.loop.set_factor(1e-3)
        run.clock.slept.clear()
        at, made = run.clock.now, len(run.got)
        run.until(made + 8)
        run.loop.close()
        assert run.clock.now - at < 0.1 * (len(run.got) - made + 1)


def test_blocks_stay_short_when_computing_is_slow(model: Model, runs: list[Run]) -> None:
    """At factor 1000 a block of 20 ms would take seconds to compute."""
    run = Run(model, real_time_factor=1000.0)
    runs.append(run)
    advance = run.loop._stepper.advance

    def slow(state: object, n: int) -> object:
        run.clock.now += n * 1e-5
        return advance(state, n)

    run.loop._stepper.advance = slow
    run.loop.start()
    run.until(6)
    run.loop.close()
    assert all(len(d.block.rows) * 1e-5 <= 0.06 for d in run.got[1:])


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
