"""What the tests of the model share: gears by a few changed values, and the kernel from Python."""

from __future__ import annotations

import os
import sys
from pathlib import Path

# As the command does, before NumPy is loaded: the matrices are small, and threads on a core that
# another process of the tests works on wait for one another.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("HERRINGBONE_HANG_S", "120")  # a busy machine; seconds are for the benchmark

import numpy as np
import pytest
from gears import UNEVEN, make
from hypothesis import settings

from herringbone_sim import core
from herringbone_sim.core.cache import compiled_from, forget_stale
from herringbone_sim.core.packed import compiled, make_work
from herringbone_sim.core.right_hand_side import right_hand_side
from herringbone_sim.diagnosis.parallel import limit_cores

sys.path.insert(0, str(Path(__file__).parents[1]))  # the benchmarks
settings.register_profile("compiled", deadline=None)
settings.load_profile("compiled")
if "PYTEST_XDIST_WORKER" in os.environ:
    limit_cores(1)  # each process of the tests has one


# The kernel is compiled into functions of the tests too.
forget_stale(Path(__file__).parent, *compiled_from(Path(core.__file__).parents[1]))


@compiled
def _slope(p, w, y, phase, cycle, dy):
    right_hand_side(p, w, y, phase, cycle, dy)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest tests first, so that none of the processes is left alone with one."""
    items.sort(key=lambda item: "test_ways_in.py" not in item.nodeid)


@pytest.fixture(scope="session")
def gear():
    """Builder of models: the nominal rig with some values changed."""
    return make


@pytest.fixture(scope="session")
def uneven():
    """Builder of full models in which no two meshes, planets or sides are alike."""
    return lambda **values: make(**UNEVEN | values)


@pytest.fixture(scope="session")
def slope_of():
    """The kernel's dy/dtau as a function (model, y, phase, cycle=0) -> (n_state,)."""

    def slope(model, y, phase, cycle=0):
        work = make_work(model.layout.n_mesh, model.layout.n_coordinate)
        dy = np.empty(model.layout.n_state)
        _slope(model.packed, work, np.asarray(y, dtype=float), phase, cycle, dy)
        return dy

    return slope
