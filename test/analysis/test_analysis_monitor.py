"""The current motion of a live simulation: no label before it can be told."""

from __future__ import annotations

import numpy as np
from gears import paper

from herringbone_sim.analysis.monitor import EXPONENT_WINDOW, LEAST, RegimeMonitor
from herringbone_sim.core.integrate import State, change, stepper
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters


def labels(model: Model, state: State, cycles: int) -> tuple[list[str], State]:
    """Labels after every 10 mesh cycles, the first 10 being those after a change, and the end."""
    monitor, machine, found = RegimeMonitor(), stepper(model), []
    for _ in range(cycles // 10):
        block = machine.advance(state, 10 * model.parameters.samples_per_cycle)
        monitor.update(block, model)
        found.append(monitor.regime(model).label)
        state = block.end
    return found, state


def test_a_motion_without_a_period_is_settling_until_its_exponent_is_known() -> None:
    """Chaos at K = 0; then control: no label of lost period while the motion comes to rest."""
    chaos, controlled = paper(K=0.0), paper(K=0.38)
    found, end = labels(chaos, stepper(chaos).start(tangents=1), 600)
    early = EXPONENT_WINDOW // 10 - 1
    assert set(found[:early]) == {"settling"}
    assert set(found[early:]) == {"chaotic"}
    found, _ = labels(controlled, change(chaos, controlled, end), 600)
    assert found[: LEAST // 10] == ["settling"] * (LEAST // 10)
    assert set(found) <= {"settling", "P1", "P2", "P4"}
    assert found[-1] == "P1"


def test_a_period_is_told_before_the_exponent() -> None:
    model = paper(K=0.38)
    _, end = labels(model, stepper(model).start(tangents=1), 600)
    found, _ = labels(model, end, 100)
    assert found[-1] == "P1"


def test_without_a_tangent_vector_there_is_no_exponent() -> None:
    """Runge-Kutta 4 integrates none: its growth of 0 is not an exponent."""
    model = build(Parameters(method="rk4", steps_per_cycle=64))
    monitor, machine = RegimeMonitor(), stepper(model)
    state = machine.start(1)
    for _ in range(3):
        block = machine.advance(state, 160)
        monitor.update(block, model)
        state = block.end
    assert np.isnan(monitor.regime(model).exponent)
