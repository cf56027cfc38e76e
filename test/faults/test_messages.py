"""Random and malformed messages and requests, seeded: the node refuses and answers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.faults import at_node

SEEDS = 20


@pytest.fixture
def running(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(at_node, "HANG_S", 10.0)  # a request that DDS lost is waited for so long
    yield
    at_node.target().close()
    at_node.target.cache_clear()


@pytest.mark.usefixtures("running")
def test_no_message_ends_the_node(tmp_path: Path) -> None:
    trials = [at_node.messages(seed, tmp_path) for seed in range(SEEDS)]
    failures = {i: one.failures() for i, one in enumerate(trials) if one.failures()}
    assert failures == {}
    assert all(one.peak_bytes > 0 for one in trials)
