"""Commands end; in how many seconds a busy machine ends them is for the benchmark to say."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.faults import trial, verbs


@pytest.fixture(autouse=True)
def busy_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (trial, verbs):
        monkeypatch.setattr(module, "HANG_S", 120.0)
