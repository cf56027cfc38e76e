"""A gear, and loops that are closed after each test."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from loop_support import Run

from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters


@pytest.fixture
def model() -> Model:
    return build(Parameters(delta_T=40.0))


@pytest.fixture
def runs() -> Iterator[list[Run]]:
    made: list[Run] = []
    yield made
    for run in made:
        run.loop.close()
