"""Which samples ``~/state`` takes: resolved cycles or a section, never an alias."""

from __future__ import annotations

import math

import numpy as np
import pytest

from herringbone_sim.core.integrate import Stepper
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.ros.streams import Decimator, coprime
from herringbone_sim.runtime import Delivery


def picks(samples_per_cycle: int, speed: float, rate: float, start: int = 0) -> np.ndarray:
    """Sample numbers, from a start on, that are sent of 2000 mesh cycles."""
    model = build(Parameters(samples_per_cycle=samples_per_cycle))
    stepper = Stepper(model)
    state = stepper.advance(stepper.start(tangents=1), start).end
    block = stepper.advance(state, 2000 * samples_per_cycle)
    decimate = Decimator(rate)
    decimate.speed = speed
    return start + np.array(decimate(Delivery(block, model, (), False)))


@pytest.mark.parametrize("per_cycle", [1, 7, 16, 24])
@pytest.mark.parametrize("speed", [1.0, 0.1, 1e-2, 1e-3])
@pytest.mark.parametrize("rate", [10.0, 100.0, 1000.0])
def test_state_resolves_the_cycle_or_is_a_section(
    per_cycle: int, speed: float, rate: float
) -> None:
    sent = picks(per_cycle, speed, rate, start=5)
    apart = set(np.diff(sent))
    assert len(apart) == 1
    (apart_samples,) = apart
    section = np.all(sent % per_cycle == 0)
    assert section or per_cycle / apart_samples >= min(8, per_cycle)
    sample_rate = 5094.4 * per_cycle * speed
    assert sample_rate / apart_samples <= max(rate, sample_rate / per_cycle) * 1.01 or section
    assert sample_rate / apart_samples <= rate * 1.01 or apart_samples == 1


def test_a_section_shows_every_point_of_a_short_period() -> None:
    for period in (2, 3, 4, 5, 6, 7, 8):
        cycles = picks(16, 1.0, 50.0) // 16
        assert len(set(cycles % period)) == period


def test_coprime_is_the_next_number_without_small_factors() -> None:
    assert [coprime(x) for x in (0.3, 1.0, 1.5, 12.0, 50.9)] == [1, 1, 11, 13, 53]
    assert all(math.gcd(coprime(x), 210) == 1 for x in np.linspace(1, 500, 97))
