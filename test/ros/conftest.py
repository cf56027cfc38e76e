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
WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
# Fifty a worker, so that two never meet; a process starts anywhere among its own.
DOMAINS = itertools.chain.from_iterable(
    itertools.repeat(range(1 + 50 * (WORKER % 2), 50 + 50 * (WORKER % 2)))
)


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
