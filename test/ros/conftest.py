"""Every node test has a ROS domain of its own, on this machine alone."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator

import pytest
from support import Bench

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
# Processes that share the tests have different ones. Only odd: a test may take the next one too.
WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
OWN = range(1 + 2 * WORKER, 99, 2 * int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")))
DOMAINS = itertools.islice(itertools.cycle(OWN), os.getpid() % len(OWN), None)


@pytest.fixture
def domain() -> int:
    return next(DOMAINS)


@pytest.fixture
def bench(domain: int) -> Iterator[Bench]:
    made = Bench(domain)
    yield made
    made.close()
