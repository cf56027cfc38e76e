"""Every node test has a ROS domain of its own, on this machine alone."""

from __future__ import annotations

import itertools
import os
import warnings
from collections.abc import Iterator

import pytest
from support import Bench

from herringbone_sim.core.parameters import ParameterWarning

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
DOMAINS = itertools.cycle(range(1 + os.getpid() % 50, 100))


@pytest.fixture
def domain() -> int:
    return next(DOMAINS)


@pytest.fixture
def bench(domain: int) -> Iterator[Bench]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ParameterWarning)
        made = Bench(domain)
        yield made
        made.close()
