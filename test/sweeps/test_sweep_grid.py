"""What a sweep is, written down and read again."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from sweep_support import axis, gear, small

from herringbone_sim.errors import ParameterError
from herringbone_sim.sweeps.chains import job_of
from herringbone_sim.sweeps.grid import (
    Axis,
    Observation,
    Sweep,
    axis_from_text,
    with_sweep_steps,
)
from herringbone_sim.sweeps.grid_json import sweep_from_json
from herringbone_sim.sweeps.store import differences


@pytest.mark.parametrize("start", ["fixed", "up", "ramp_down"])
def test_a_sweep_comes_back_from_json(start: str) -> None:
    sweep = small(start, k_amp=(0.2, 0.1), seed=3)
    assert sweep_from_json(sweep.to_json()) == sweep


def test_the_first_axis_is_the_slowest() -> None:
    sweep = small()
    grid = np.array([sweep.values_at(i)["K"] for i in range(sweep.size)]).reshape(sweep.shape)
    assert np.array_equal(grid, np.tile(sweep.axes[1].values, (3, 1)))
    assert sweep.parameters_at(7).delta_T == 75.0
    assert sweep.axes[1].values[3] == sweep.parameters_at(7).K


@pytest.mark.parametrize("start", ["fixed", "up", "down"])
@pytest.mark.parametrize("chunk", [1, 3, 5, 100])
def test_parts_cover_the_grid_once(start: str, chunk: int) -> None:
    sweep = small(start, chunk)
    parts = [sweep.part(number) for number in range(sweep.n_parts)]
    assert [index for part in parts for index in part] == list(range(12))
    if sweep.chained:
        assert all(len(part) % sweep.width == 0 for part in parts)


def test_axes_are_read_from_text() -> None:
    assert axis_from_text("K=0:0.6:4") == axis("K", 0.0, 0.6, 4)
    assert axis_from_text(" Omega = 0.5,1 ") == Axis("Omega", (0.5, 1.0))


@pytest.mark.parametrize(
    "text", ["K", "K=", "K=0:1", "K=a:b:3", "K=1:0:5", "K=0:nan:3", "K=0:1:0", "speed=0:1:3"]
)
def test_what_is_no_axis_is_refused(text: str) -> None:
    with pytest.raises(ParameterError):
        axis_from_text(text)


@pytest.mark.parametrize("count", ["1000001", "100000000000", "9" * 400])
def test_an_axis_that_is_too_long_is_refused_before_it_is_made(count: str) -> None:
    with pytest.raises(ParameterError, match=r"K takes up to 1000000 values, got") as refused:
        axis_from_text(f"K=0:1:{count}")
    assert len(str(refused.value)) < 300


@pytest.mark.parametrize("name", ["k_amp", "model", "order", "n_planets"])
def test_only_numbers_that_leave_the_model_its_size_make_an_axis(name: str) -> None:
    with pytest.raises(ParameterError, match=f"{name} makes no axis"):
        Axis(name, (1.0, 2.0))


def test_sweeps_that_can_not_be_are_refused() -> None:
    base, K = gear(), axis("K", 0.0, 1.0, 2)
    for axes, more in (((), {}), ((K, K), {}), ((K,), {"start": "left"}), ((K,), {"chunk": 0})):
        with pytest.raises(ParameterError):
            Sweep(base, axes, **more)
    with pytest.raises(ParameterError, match="mesh must be one of sp_L"):
        Sweep(base, (K,), Observation(mesh="sp1_L"))
    with pytest.raises(ParameterError, match="points <= cycles"):
        Observation(cycles=10, points=11)


def test_the_steps_of_a_sweep_leave_what_the_user_set() -> None:
    base = gear(order=20, steps_per_cycle=32, samples_per_cycle=4)
    kept = with_sweep_steps(base, {"order": 20})
    assert (kept.order, kept.steps_per_cycle, kept.samples_per_cycle) == (20, 8, 1)


def test_rk4_keeps_its_own_steps() -> None:
    base = gear(method="rk4", steps_per_cycle=200, samples_per_cycle=300)
    assert with_sweep_steps(base, {"method": "rk4"}).steps == 300
    assert with_sweep_steps(base, {"steps_per_cycle": 200}).steps == 200


def test_differences_name_what_differs() -> None:
    told = "; ".join(differences(small(), small(xi=0.1, chunk=2)))
    assert "xi: 0.07, 0.1" in told
    assert "chunk: 4, 2" in told
    assert "T_1" not in told


@pytest.mark.parametrize("indices", [range(0, 1), range(3, 6), range(5, 7), range(4, 12)])
def test_what_is_cut_out_keeps_its_values(indices: range) -> None:
    sweep = small()
    cut, first = sweep.cut(indices)
    assert [cut.values_at(i - first) for i in indices] == [sweep.values_at(i) for i in indices]


@pytest.mark.parametrize("start", ["fixed", "up", "ramp_down"])
def test_a_task_takes_no_more_along_than_it_needs(start: str) -> None:
    sweep = Sweep(gear(), (axis("K", 0.0, 1.0, 100_000),), start=start, chunk=16)
    assert len(pickle.dumps(job_of(sweep, 3000))) < 5_000
