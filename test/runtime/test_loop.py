"""The pace of the loop, changes and faults, against a clock that the test owns."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise

import numpy as np
import pytest
from loop_support import Run

from herringbone_sim.core.integrate import Stepper
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters, ParameterWarning
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import ParameterError
from herringbone_sim.runtime import (
    Delivery,
    check_pace,
    loop,
    sample_period_s,
)

CRACK = "tooth_crack@sp/all/L:depth=0.3,member=sun"


def wait_until(true: Callable[[], object], timeout: float = 10.0) -> None:
    limit = time.monotonic() + timeout
    while not true():
        assert time.monotonic() < limit, "waited in vain"
        time.sleep(0.002)


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


def test_effects_that_fail_to_compile_are_dropped(
    model: Model, runs: list[Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A change behind or after them acts with the effects in force; they compile once."""
    run = Run(model)
    runs.append(run)
    run.loop.start()
    run.until(3)
    errors = iter([MemoryError("no memory")])

    def fail_once(_: Model) -> None:
        for error in errors:
            raise error

    monkeypatch.setattr(loop, "warm_up", fail_once)
    monkeypatch.setattr(Stepper, "is_compiled", property(lambda _: False))
    run.loop.submit(model, {"effects": CRACK}, read_effects(CRACK))
    behind = {"K": 0.1}
    run.loop.submit(build(model.parameters.changed(behind)), behind)
    wait_until(lambda: run.faults and not run.loop._preparing)
    wait_until(lambda: run.loop.model.parameters.K == 0.1)
    values = {"K": 0.2}
    run.loop.submit(build(model.parameters.changed(values)), values)
    wait_until(lambda: run.loop.model.parameters.K == 0.2)
    assert len(run.faults) == 1
    assert "no memory" in run.faults[0]
    assert run.loop.actives == ()


def test_effects_that_the_gear_cannot_have_change_nothing(model: Model, runs: list[Run]) -> None:
    run = Run(model)
    runs.append(run)
    run.loop.start()
    with pytest.raises(ParameterError, match="planet"):
        run.loop.submit(model, {}, read_effects("tooth_crack@sp/7/L"))
    values = {"K": 0.2}
    run.loop.submit(build(model.parameters.changed(values)), values)
    wait_until(lambda: run.loop.model.parameters.K == 0.2)


def test_a_change_after_the_end_is_ignored(
    model: Model, runs: list[Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run(model)
    runs.append(run)
    run.loop.start()
    run.until(3)
    run.loop.close()
    monkeypatch.setattr(Stepper, "is_compiled", property(lambda _: False))
    run.loop.submit(model, {"effects": CRACK}, read_effects(CRACK))
    assert run.loop.actives == ()


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


@pytest.mark.parametrize("Omega", [0.8, 0.9, 1.0, 1.1])
@pytest.mark.parametrize("factor", [1e-4, 7e-5, 3e-5, 1e-5])
def test_what_is_said_to_do_for_a_slow_pace_does(Omega: float, factor: float) -> None:
    gear = Parameters(Omega=Omega)
    with pytest.raises(ParameterError) as refused:
        check_pace(build(gear), factor)
    words = str(refused.value).split()
    check_pace(build(gear), float(words[words.index("or") - 1]))
    check_pace(build(gear.changed({"samples_per_cycle": int(words[-1])})), factor)
