"""Diagrams in the plane: ticks, limits, placing, the bounded bifurcation, the lanes."""

from __future__ import annotations

from unittest.mock import MagicMock

import numpy as np
import pytest
from mirror_support import REDUCED, make_block

from herringbone_sim.core.layout import Layout
from herringbone_sim.views.mirror.block import contact_states
from herringbone_sim.views.mirror.palette import mesh_colours
from herringbone_sim.views.mirror.plane import Axes, Bifurcation, limits_for, smooth, ticks
from herringbone_sim.views.mirror.planes import Planes


def test_ticks_are_round_and_inside() -> None:
    assert ticks((0.0, 1.0)) == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
    assert ticks((-7.3, 12.1)) == pytest.approx([-5.0, 0.0, 5.0, 10.0])


def test_y_grows_upwards_in_a_box_that_grows_downwards() -> None:
    axes = Axes((0.0, 2.0), (-1.0, 1.0), width=200.0, height=100.0)
    corners = np.array([[0.0, -1.0], [2.0, 1.0], [1.0, 0.0]])
    assert axes.place(corners) == pytest.approx(np.array([[0, 100], [200, 0], [100, 50]]))
    assert axes.vertical(1.0)[:, 0] == pytest.approx([100.0, 100.0])
    assert axes.horizontal(0.5)[:, 1] == pytest.approx([25.0, 25.0])


def test_limits_stay_until_the_data_leave_or_shrink() -> None:
    wide = limits_for(np.array([-1.0, 1.0, np.nan]))
    assert wide[0] < -1.0 < 1.0 < wide[1]
    assert limits_for(np.array([-0.8, 0.9]), wide) == wide
    assert limits_for(np.array([-1.5, 0.9]), wide)[0] < -1.5
    assert limits_for(np.array([-0.01, 0.01]), wide)[1] < 0.1
    assert limits_for(np.array([]))[0] < limits_for(np.array([]))[1]


def test_constant_data_have_room() -> None:
    low, high = limits_for(np.array([3.0, 3.0]), least_span=0.1)
    assert low < 3.0 < high
    assert high - low >= 0.1


def test_bifurcation_is_bounded_and_forgets_only_at_the_same_value() -> None:
    store = Bifurcation()
    store.add(np.array([0.25]), np.array([7.0]), np.array([1]))
    for k in np.linspace(0.0, 0.5, 300):
        store.add(np.full(500, k), np.arange(500.0), np.zeros(500, dtype=np.int64))
    store.add(np.full(10_000, 0.5), np.zeros(10_000), np.zeros(10_000, dtype=np.int64))
    points = store.points()
    assert len(points) <= 20_000
    assert len(np.unique(points[:, 0])) > 100
    newest = points[points[:, 0] == 0.1 // 1e-9 * 1e-9]
    assert set(newest[:, 1]) <= set(np.arange(450.0, 500.0))


def test_bifurcation_keeps_its_points_when_the_bins_widen() -> None:
    store = Bifurcation()
    store.add(np.array([0.0, 0.1, -0.1]), np.array([1.0, 2.0, 3.0]), np.array([0, 1, 2]))
    touched = store.add(np.array([387.0]), np.array([4.0]), np.array([0]))
    assert touched == set(range(store.n_pages))
    expected = {(0.0, 1.0, 0.0), (0.1, 2.0, 1.0), (-0.1, 3.0, 2.0), (387.0, 4.0, 0.0)}
    assert set(map(tuple, store.points().tolist())) == expected


def test_pages_that_are_not_touched_stay() -> None:
    store = Bifurcation()
    store.add(np.linspace(0.0, 1.0, 50), np.zeros(50), np.zeros(50, dtype=np.int64))
    before = [store.page(i) for i in range(store.n_pages)]
    touched = store.add(np.array([0.5]), np.array([9.0]), np.array([0]))
    assert len(touched) == 1
    for i, page in enumerate(before):
        assert (i in touched) == (len(store.page(i)) != len(page))


def test_nan_is_no_section_point() -> None:
    store = Bifurcation()
    store.add(np.array([0.1, 0.2]), np.array([np.nan, 1.0]), np.array([0, 0]))
    assert len(store.points()) == 1


def test_spline_passes_through_the_samples_and_follows_a_circle() -> None:
    angle = np.linspace(0, 2 * np.pi, 17)
    samples = np.column_stack((np.cos(angle), np.sin(angle)))
    curve = smooth(samples, 4)
    assert curve[::4] == pytest.approx(samples)
    inner = curve[4:-4]
    assert np.hypot(inner[:, 0], inner[:, 1]) == pytest.approx(np.ones(len(inner)), abs=2e-3)


def test_contact_states() -> None:
    states = contact_states(np.array([-2.0, -1.0, 0.0, 1.0, 2.0]), 1.0)
    assert states.tolist() == [2, 1, 1, 1, 0]


def test_each_mesh_has_a_colour_of_its_own() -> None:
    for layout in (Layout(1, numbered=False), Layout(3, numbered=True)):
        colours = mesh_colours(layout)
        assert set(colours) == set(layout.meshes)
        assert len(set(colours.values())) == layout.n_mesh


def test_both_branches_of_a_hysteresis_stay_in_the_bifurcation() -> None:
    store = Bifurcation()
    for rising, level in ((True, 1.0), (False, -1.0)):
        for k in np.linspace(0.0, 0.4, 20)[:: 1 if rising else -1]:
            store.add(np.full(90, k), np.full(90, level), np.zeros(90, dtype=np.int64), rising)
    points = store.points()
    for k in np.unique(points[:, 0]):
        assert set(points[points[:, 0] == k, 1]) == {1.0, -1.0}


def test_a_new_axis_has_the_direction_of_its_own_parameter() -> None:
    """K rises, then delta_T falls: the first points over delta_T are those of a fall."""
    block = make_block()
    planes = Planes(MagicMock(), REDUCED, None, "sp_L", block.names)
    directions = []
    for column, value in (("K", 0.1), ("K", 0.2), ("delta_T", 40.0), ("delta_T", 45.0)):
        block.rows[:, block.names.index(column)] = value
        planes._follow_steered(block)
        directions.append((planes.steered, planes._rising))
    assert directions[1:] == [("K", True), ("delta_T", False), ("delta_T", True)]


DEGENERATE = {
    "one point at rest": [0.0],
    "many at rest": [0.0, 0.0, -0.0],
    "the least there is": [5e-324],
    "one far out": [1e200],
    "both ends of what there is": [-1.7e308, 1.7e308],
    "infinite": [np.inf, -np.inf, 0.0],
    "no number": [np.nan],
    "none": [],
}


@pytest.mark.parametrize("kind", DEGENERATE)
@pytest.mark.parametrize("least_span", [0.0, 0.1])
def test_any_values_have_an_axis_with_ticks(kind: str, least_span: float) -> None:
    limits = limits_for(np.array(DEGENERATE[kind]), least_span=least_span)
    for again in (limits, limits_for(np.array(DEGENERATE[kind]), limits, least_span)):
        assert again[0] < again[1]
        assert np.isfinite(again[1] - again[0])
        at = ticks(again)
        assert 1 <= len(at) <= 20
        assert np.isfinite(at).all()


@pytest.mark.parametrize(
    "limits", [(0.0, 0.0), (1.0, -1.0), (np.nan, 1.0), (0.0, np.inf), (-1.7e308, 1.7e308)]
)
def test_what_is_no_range_has_no_ticks(limits: tuple[float, float]) -> None:
    assert len(ticks(limits)) == 0


@pytest.mark.parametrize("x", [0.0, 5e-324, 1e-300, 1.7e308, np.nan, np.inf])
def test_any_parameter_has_a_bin(x: float) -> None:
    kept = Bifurcation()
    kept.add(np.array([x]), np.array([1.0]), np.array([0]))
    kept.add(np.array([1.0]), np.array([2.0]), np.array([0]))
    kept.add(np.array([x]), np.array([3.0]), np.array([0]))
    points = kept.points()
    assert len(points) == (3 if np.isfinite(x) else 1)
