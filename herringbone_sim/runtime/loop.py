"""Real-time loop: integrates a model at the pace of a clock and delivers blocks of samples.

One thread owns the state. Other threads submit changes and commands, which act between two blocks
and so at a sample; each delivery says at which time its changes took effect.
If a block is too late, the loop goes on from the current time and does not hurry to catch up.

Over 300 lines: the thread and all calls that change its state share one lock.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeoutError
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from herringbone_sim.core.cache import on_compiling
from herringbone_sim.core.integrate import Block, State, Stepper, warm_up
from herringbone_sim.core.model import Model
from herringbone_sim.core.parameters import live_names
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.sensors import Clock, Sensors
from herringbone_sim.effects.stepper import change, stepper
from herringbone_sim.effects.written import effects_text
from herringbone_sim.errors import HerringboneError
from herringbone_sim.runtime.delivery import Change, Delivery
from herringbone_sim.runtime.pace import (
    WALL_TIME,
    Pace,
    WallTime,
    block_length,
    check_pace,
)
from herringbone_sim.runtime.stepping import Step, Stepped

LATE_S = 0.1  # delay of a block that counts as an overrun
IDLE_S = 0.05  # longest single wait

T = TypeVar("T")


@dataclass(frozen=True)
class _Wanted:
    """A submitted change: the stepper to continue with, its effects, and the changed values.

    ``given``: whether the effects were submitted with it, not taken from the change before.
    """

    machine: Stepper
    actives: tuple[Active, ...]
    values: Mapping[str, Any]
    given: bool


class Loop:
    """Integrates a model at the pace of a clock in a separate thread.

    The first start on a computer compiles the kernel in that thread; calls are answered meanwhile.

    Args:
        model: model to integrate.
        deliver: called in the loop's thread with every ``Delivery``; must not block for long.
        actives: effects of the gear and of its sensors.
        real_time_factor: simulation time over wall time; 0: as fast as possible.
        paused: whether to start paused.
        wall: clock and wait; tests replace it.
        fail: called with a text when the motion diverges, or an exception ends the loop.
    """

    def __init__(
        self,
        model: Model,
        deliver: Callable[[Delivery], None],
        *,
        actives: Sequence[Active] = (),
        real_time_factor: float = 1.0,
        paused: bool = False,
        wall: WallTime = WALL_TIME,
        fail: Callable[[str], None] = print,
    ) -> None:
        check_pace(model, real_time_factor)
        self.pace = Pace()
        self._deliver = deliver
        self._clock = wall.now
        self._stop = threading.Event()
        self._sleep = wall.sleep or self._stop.wait
        self._fail = fail
        self._lock = threading.Condition()
        self._factor = real_time_factor
        self._paused = paused
        self._step: Step | None = None
        self._pending: list[_Wanted] = []
        self._last = tuple(actives)
        # Effects that could not be compiled last, and those in force then.
        self._failed: tuple[tuple[Active, ...], tuple[Active, ...]] = ((), ())
        self._preparing = 0
        self._preparer = ThreadPoolExecutor(1, "effects")
        self._calls: deque[Callable[[], None]] = deque()
        self._untold: tuple[bool, tuple[Change, ...]] = (False, ())
        self._begin(stepper(model, actives), tuple(actives))
        self._anchor: tuple[float, float] | None = None
        self._rate = 0.0
        self._ready = self._over = False
        self._compiling = False
        self._thread = threading.Thread(target=self._run, name="integrator", daemon=True)

    def _begin(self, machine: Stepper, actives: tuple[Active, ...]) -> None:
        self._stepper, self._actives = machine, actives
        self._sensors = Sensors(machine, actives)
        self._state = machine.start(tangents=1)

    @property
    def paused(self) -> bool:
        return self._paused

    @property
    def model(self) -> Model:
        """The model in force."""
        return self._stepper.model

    @property
    def actives(self) -> tuple[Active, ...]:
        """Effects in force."""
        return self._actives

    @property
    def clock(self) -> Clock:
        """Reading of the sensors' clock."""
        return self._sensors.clock

    @property
    def state(self) -> State:
        """State of the run; may be a block behind, except within ``call`` or before ``start``."""
        return self._state

    @property
    def t_s(self) -> float:
        """Simulation time [s] reached."""
        return self._state.t

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """End the thread after its last block; wait for it unless the kernel is being compiled."""
        self._stop.set()
        with self._lock:
            self._preparer.shutdown(wait=False, cancel_futures=True)
            self._lock.notify_all()
        compiling = self._thread.is_alive() and not self._ready
        if self._thread.is_alive() and not compiling:
            self._thread.join()

    def submit(
        self, model: Model, values: Mapping[str, Any], actives: Sequence[Active] | None = None
    ) -> None:
        """Continue with another model of the same layout from the next sample on.

        Changes act in the order of submission. A new number of steps or samples per mesh cycle
        waits for phase 0, and new effects for their kernel to be loaded or compiled; if that
        fails, those before it stay. After ``close`` there is no next sample, and nothing is done.

        Args:
            model: model to continue with.
            values: changed values by name, passed on in ``Delivery.changes``.
            actives: effects from then on; None: those submitted last that did not fail.

        Raises:
            ParameterError: effects that the gear can't have.
        """
        with self._lock:
            if self._stop.is_set():
                return
            chosen = self._last if actives is None else tuple(actives)
            machine = stepper(model, chosen)
            Sensors(machine, chosen)
            self._last = chosen
            wanted = _Wanted(machine, chosen, values, actives is not None)
            others = self._ready or not machine.alike(self._stepper)
            later = self._preparing or (others and not machine.is_compiled)
            if later:
                self._preparer.submit(self._prepare, wanted)
                self._preparing += 1
            else:
                self._pending.append(wanted)
                self._lock.notify_all()

    def _prepare(self, wanted: _Wanted) -> None:
        try:
            failed, in_force = self._failed
            if failed and wanted.actives is failed and not wanted.given:
                machine = stepper(wanted.machine.model, in_force)
                wanted = replace(wanted, machine=machine, actives=in_force)
            self._load(wanted.machine)
        except Exception as error:
            with self._lock:
                in_force = self._pending[-1].actives if self._pending else self._actives
                self._failed = wanted.actives, in_force
                if self._last is wanted.actives:
                    self._last = in_force
            self._fail(f"the effects can't be compiled: {type(error).__name__}: {error}")
            raise
        else:
            with self._lock:
                self._pending.append(wanted)
                self._lock.notify_all()
        finally:
            with self._lock:
                self._preparing -= 1

    @property
    def ready(self) -> bool:
        """Whether the kernel is loaded, so that the loop integrates unless paused."""
        return self._ready

    @property
    def compiling(self) -> bool:
        """Whether a kernel is being compiled, as the cache does not hold it."""
        return self._compiling

    def _load(self, machine: Stepper) -> None:
        def begun() -> None:
            self._compiling = True

        try:
            with on_compiling(begun):
                warm_up(machine.model)
        finally:
            self._compiling = False

    def set_factor(self, real_time_factor: float) -> None:
        with self._lock:
            self._factor = real_time_factor
            self._anchor = None

    def pause(self) -> None:
        """Pause before the next block; this ends a step that is under way."""
        self._hold(True, "pause")

    def resume(self) -> None:
        """Leave the pause; this ends a step that is under way."""
        self._hold(False, "resume")

    def _hold(self, paused: bool, command: str) -> None:
        with self._lock:
            self._paused = paused
            self._anchor = None
            if self._step:
                self._step.cut = f"interrupted by {command}"
            self._lock.notify_all()

    def step(self, cycles: int) -> Stepped:
        """Advance a paused loop by a number of mesh cycles, wait for it, and return the result.

        ``pause``, ``resume``, ``reset``, ``close`` and divergence end it early.

        Raises:
            HerringboneError: the loop runs, or has ended, or another step is under way.
        """
        with self._lock:
            self._check_standing()
            if not self._paused:
                raise HerringboneError("step needs a paused simulation: call pause first")
            if self._step:
                done = self._step.done(self.model, self._state)
                raise HerringboneError(
                    f"a step is under way, {done:g} of {self._step.cycles} mesh cycles are done: "
                    "wait for it, or end it with pause"
                )
            self._step = step = Step(cycles, self.model, self._state)
            self._lock.notify_all()
        return step.ended.result()

    def _check_standing(self) -> None:
        if self._over:
            raise HerringboneError("the integrator has ended: start the simulation anew")

    def _end_step(self, cut: str = "") -> None:
        with self._lock:
            step, self._step = self._step, None
            if step:
                step.cut = step.cut or cut
                step.end(self.model, self._state)

    def call(self, do: Callable[[Model, State], T], timeout_s: float = 30.0) -> T:
        """Run do(model, state) in the loop's thread between two blocks, and return its result.

        Before the kernel is loaded the calling thread runs it at once. An exception of ``do`` is
        raised here. After the timeout ``do`` is cancelled, or, if it has begun, waited for. The
        loop's thread must not use this: it would wait for itself.

        Args:
            do: called with the model and the state in force.
            timeout_s: longest wait for the loop to begin ``do`` [s].

        Raises:
            HerringboneError: the loop has ended, or did not begin ``do`` in time.
        """
        answer: Future[T] = Future()

        def run() -> None:
            if not answer.set_running_or_notify_cancel():
                return
            try:
                answer.set_result(do(self.model, self._state))
            except Exception as error:
                answer.set_exception(error)

        with self._lock:
            self._check_standing()
            if self._ready:
                self._calls.append(run)
                self._lock.notify_all()
            else:
                run()
        try:
            return answer.result(timeout_s)
        except FutureTimeoutError as error:
            if not answer.cancel():  # ``do`` is running, or raised a timeout itself
                return answer.result()
            raise HerringboneError(
                f"the simulation did not come to it within {timeout_s:g} s: try again"
            ) from error

    def reset(self) -> None:
        """Return to the initial state at t = 0; to be used within ``call``. A pause persists."""
        self._end_step("interrupted by reset")
        self._begin(self._stepper, self._actives)
        self._anchor = None
        self._untold = (True, ())

    def _run(self) -> None:
        try:
            self._load(self._stepper)
            with self._lock:
                self._ready = True
            while not self._stop.is_set():
                self._turn()
        except Exception as error:
            self._paused = True
            self._fail(f"the integrator stopped: {type(error).__name__}: {error}")
            raise
        finally:
            self._end()

    def _end(self) -> None:
        """Mark the loop as ended, end a step under way, and run the waiting calls."""
        with self._lock:
            self._over = True
            self._end_step("the simulation ended")
            while self._calls:
                self._calls.popleft()()

    def _turn(self) -> None:
        while self._calls:
            self._calls.popleft()()
        with self._lock:
            self._take_changes()
            if self._step and self._step.cut:
                self._end_step()
            if self._paused and not self._step:
                if not self._calls:
                    self._lock.wait(IDLE_S)
                return
            n, factor, step = self._block_length(), self._factor, self._step
        began = self._clock()
        block = self._stepper.advance(self._state, n)
        took = self._clock() - began
        self._rate = len(block.rows) / took if took > 0.0 else 0.0
        self._keep_pace(block, factor)
        restarted, changes = self._untold
        self._untold = (False, ())
        clock, shown = self.clock, self._sensors.show(block)
        made = Delivery(shown, self.model, changes, restarted, self._actives, clock)
        self._deliver(made)
        with self._lock:
            self._account(block, step)

    def _take_changes(self) -> None:
        """Apply the submitted changes.

        The tangent vector starts anew: in long symmetric chaos rounding removes its component
        along left-right differences for good, so that it would miss their growth.
        """
        while self._pending:
            wanted = self._pending[0]
            if self._off_grid(wanted.machine.model):
                return
            self._pending.pop(0)
            if self._step:
                self._step.changed(self.model, wanted.machine.model)
            self._state = change(self._stepper, wanted.machine, self._state)
            shown = self._sensors.shown_s(self._state.t)
            self._stepper, self._actives = wanted.machine, wanted.actives
            self._sensors = self._sensors.followed(wanted.machine, wanted.actives, self._state.t)
            self._anchor = None
            made = Change(shown, dict(wanted.values))
            self._untold = (self._untold[0], (*self._untold[1], made))

    def _off_grid(self, model: Model) -> bool:
        """Whether a model changes the grid of steps or samples at another phase than 0."""
        same = model.parameters.steps == self.model.parameters.steps
        same &= model.parameters.samples_per_cycle == self.model.parameters.samples_per_cycle
        return not same and self._state.index != 0

    def _block_length(self) -> int:
        n = block_length(self.model, self._factor, self._rate)
        if self._pending:
            p = self.model.parameters
            n = min(n, (p.steps - self._state.index) // (p.steps // p.samples_per_cycle))
        return min(n, self._step.left) if self._step else n

    def _keep_pace(self, block: Block, factor: float) -> None:
        """Wait until the end of a block is due at a real-time factor, or the factor changes."""
        now = self._clock()
        if factor == 0.0 or self._step:
            return
        anchor = self._anchor or (now, block.start.t)
        due = anchor[0] + (block.end.t - anchor[1]) / factor
        if now > due + LATE_S:
            self.pace.overruns += 1
            anchor = (now, block.end.t)
        self._anchor = anchor if factor == self._factor else None
        while due > now and factor == self._factor and not self._stop.is_set():
            self._sleep(min(due - now, IDLE_S))
            now = self._clock()

    def _account(self, block: Block, step: Step | None) -> None:
        """Take over the state after a block, which counts for the step it was computed for."""
        self.pace.samples += len(block.rows)
        self.pace.note(self._clock(), block.end.t - block.start.t)
        self._state = block.end
        if self._step and self._step is step:
            self._step.left -= len(block.rows)
        elif self._step:  # asked for while this block, from before the pause, was under way
            self._step.begin(self.model, self._state)
        if block.diverged:
            self._paused = True
            self._end_step("the motion diverged on the way")
            p = self.model.parameters
            live = ", ".join(f"{name}={getattr(p, name)!r}" for name in live_names())
            self._fail(
                f"the motion diverged at t = {block.rows[-1, 0]:.9g} s: paused; reset after "
                f"changing parameters ({live}, method={p.method}, steps={p.steps}"
                f"{', effects ' + effects_text(self._actives) if self._actives else ''})"
            )
        if self._step and self._step.left <= 0:
            self._end_step()
