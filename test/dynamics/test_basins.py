"""Attractors told apart and counted: a map whose basins are known, and the gear."""

from __future__ import annotations

import numpy as np
import pytest
from flows import Cubics, Henon
from gears import paper
from scipy.stats import binom

from herringbone_sim.core.model import build, initial_state, relative
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.attractors import (
    ALIKE,
    AS_A_SET,
    PAIR,
    attractor_of,
    drop_repeats,
    same_attractor,
    same_set_share,
)
from herringbone_sim.dynamics.basins import (
    Basins,
    explore,
    explore_slice,
    gear_sections,
    random_starts,
    slice_starts,
    wilson,
)
from herringbone_sim.dynamics.exponent_methods import motion_kind
from herringbone_sim.dynamics.flow import symmetry
from herringbone_sim.dynamics.growth import Growth


def starts(n, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (n, 2))


@pytest.mark.parametrize(("r", "period"), [(1.8, 1), (2.5, 0)], ids=["P1", "chaos"])
def test_shares_of_four_attractors(r, period):
    """Signs (+ +) and (- -) a quarter each; (+ -) and its mirror image one half together."""
    cubics, y = Cubics(r), starts(200)
    found = explore(cubics.sections, y, cubics.exchange)
    signs = np.sign(y).sum(axis=1)
    groups = [found.labels[signs == s] for s in (-2, 0, 2)]
    assert len(found.attractors) == 3
    assert all(len(set(group)) == 1 for group in groups)
    assert {one.period for one in found.attractors} == {period}
    share, low, high = found.shares()[found.labels[signs == 0][0]]
    assert low < 0.5 < high
    assert share == np.mean(signs == 0)


def test_periods_that_run_in_step_or_in_turn_are_two():
    """Both maps at P2: for equal signs in step or in turn, for opposite ones two mirror pairs."""
    cubics, y = Cubics(2.1), starts(150)
    found = explore(cubics.sections, y, cubics.exchange)
    equal = {found.attractors[i].symmetry for i in found.labels[np.prod(y, axis=1) > 0]}
    opposite = {found.attractors[i].symmetry for i in found.labels[np.prod(y, axis=1) < 0]}
    assert [one.period for one in found.attractors] == [2] * 6
    assert (equal, opposite) == ({ALIKE, AS_A_SET}, {PAIR})


def test_without_the_exchange_mirror_images_are_two():
    cubics = Cubics(1.8)
    assert len(explore(cubics.sections, starts(100)).attractors) == 4


def test_symmetries():
    def cycle(*points):
        return np.tile(np.array(points), (20, 1))

    swap = np.array([1, 0])
    alike = attractor_of(cycle((0.1, 0.1), (0.5, 0.5)), swap)
    turned = attractor_of(cycle((0.1, 0.5), (0.5, 0.1)), swap)
    pair = attractor_of(cycle((0.1, 0.5), (0.2, 0.3)), swap)
    image = attractor_of(cycle((0.3, 0.2), (0.5, 0.1)), swap)
    assert [one.symmetry for one in (alike, turned, pair)] == [ALIKE, AS_A_SET, PAIR]
    assert same_attractor(pair, image, swap)
    assert not same_attractor(pair, image)
    assert not same_attractor(alike, turned, swap)
    assert (turned.period, turned.named("P2")) == (2, "P2, symmetric as a set")
    assert attractor_of(cycle((0.1, 0.5))).named("P1") == "P1"


def test_pieces_of_one_chaos_mix_and_two_do_not():
    def henon(x, n):
        y, points = np.array([x, 0.1]), []
        for _ in range(100 + n):
            y, _ = Henon().advance(y, np.zeros((0, 2)))
            points.append(y)
        return np.array(points[100:])

    one, other = henon(0.1, 100), henon(0.2, 200)
    assert same_set_share(one, other) == pytest.approx(0.5, abs=0.12)
    assert same_set_share(one, other + np.array([0.0, 0.1])) > 0.9
    assert same_set_share(one, one.copy()) < 0.1


def test_a_period_too_long_to_be_seen_is_one_attractor():
    """P37 in sections of 120 points: repeated points are not taken for a set of their own."""
    rng = np.random.default_rng(0)
    cycle, other = rng.normal(size=(2, 37, 3))
    pieces = [np.tile(cycle, (5, 1))[first : first + 120] for first in (0, 11, 30)]
    found = [attractor_of(piece) for piece in pieces]
    assert [one.period for one in found] == [0, 0, 0]
    assert same_attractor(found[0], found[1])
    assert same_attractor(found[0], found[2])
    assert not same_attractor(found[0], attractor_of(np.tile(other + 4.0, (5, 1))[:120]))
    assert attractor_of(np.tile(cycle, (6, 1))).period == 37
    assert np.array_equal(drop_repeats(pieces[0], 1e-6), pieces[0][-37:])


def test_a_failed_run_is_counted_and_attracts_nothing():
    cubics, y = Cubics(1.8), starts(200)
    y[::4] = np.nan
    found = explore(cubics.sections, y, cubics.exchange)
    assert found.failed == 50
    assert found.counts.sum() == 150
    assert set(found.labels[::4]) == {-1}


def test_known_attractors_keep_their_numbers():
    cubics = Cubics(1.8)
    first = explore(cubics.sections, starts(100), cubics.exchange)
    again = explore(cubics.sections, starts(80, 1), cubics.exchange, known=first.attractors)
    assert again.attractors == first.attractors
    assert np.all(np.diff(first.counts) <= 0)


def test_wilson_interval_covers_the_share_as_often_as_it_says():
    """Brown, Cai and DasGupta, Stat. Sci. 16 (2001) 101: near 95 % on the average over shares."""
    n = 50
    intervals = np.array([wilson(count, n) for count in range(n + 1)])
    covered = [
        binom.pmf(np.arange(n + 1), n, p)[(intervals[:, 0] <= p) & (p <= intervals[:, 1])].sum()
        for p in np.linspace(0.01, 0.99, 99)
    ]
    assert np.mean(covered) == pytest.approx(0.95, abs=0.01)
    assert min(covered) > 0.83
    assert wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert wilson(10, 10) == pytest.approx((0.7225, 1.0), abs=1e-4)


def test_starts_of_a_gear(gear):
    model = gear()
    drawn = random_starts(model, 300, np.random.default_rng(0), reach=0.5)
    x = np.array([np.concatenate(relative(model, y, 0.0)) for y in drawn])
    assert np.abs(x).max() <= 0.5 + 1e-12
    assert np.abs(x.mean(axis=0)).max() < 0.08
    assert x.std(axis=0) == pytest.approx(np.full(8, 0.5 / 3**0.5), rel=0.15)
    axis, plane = slice_starts(model, 4, reach=1.0)
    assert axis == pytest.approx([-0.75, -0.25, 0.25, 0.75])
    assert np.array([relative(model, y, 0.0)[0] for y in plane[:2]]) == pytest.approx(
        np.array([[-1.125, -0.375] * 2, [-0.625, 0.125] * 2])
    )
    exchange = symmetry(model)
    assert plane[0][exchange] == pytest.approx(plane[12])


def test_hot_gear_has_one_motion():
    """delta_T = 85: P1 with left and right alike, from every start."""
    model = paper(delta_T=85.0)
    drawn = random_starts(model, 12, np.random.default_rng(1))
    found = explore(gear_sections(model, 1000), drawn, symmetry(model))
    assert [(one.period, one.symmetry) for one in found.attractors] == [(1, "left = right")]


def test_gear_with_many_motions():
    """delta_T = 70: P2 from rest, as published, and seldom from elsewhere."""
    model = paper(delta_T=70.0)
    rest = initial_state(model)[None]
    drawn = random_starts(model, 20, np.random.default_rng(1))
    found = explore(gear_sections(model, 3000), np.vstack([rest, drawn]), symmetry(model))
    assert found.attractors[found.labels[0]].named("P2") == "P2, left = right"
    assert found.attractors[0].symmetry != ALIKE
    assert found.shares()[0, 0] > 0.5
    assert np.mean(found.labels == found.labels[0]) < 0.3


@pytest.mark.parametrize("n", [4, 5])
def test_a_slice_of_equal_halves_is_mirrored_not_run_twice(gear, n):
    """The same labels as from all its starts, from little more than half of the runs."""
    model = gear(delta_T=70.0)
    ran = []

    def sections_of(starts):
        ran.append(len(starts))
        motion = np.sign(starts[:, :1] + starts[:, 1:2]) * np.ones((1, 8))
        return np.repeat(motion[:, None], 100, axis=1)

    _, found = explore_slice(model, sections_of, n)
    assert sum(ran) == n * ((n + 1) // 2)
    _, starts = slice_starts(model, n)
    whole = explore(sections_of, starts, symmetry(model), known=found.attractors)
    assert np.array_equal(found.labels, whole.labels.reshape(n, n))
    _, uneven = explore_slice(gear(I_s_factor=(1.0, 1.1)), sections_of, n)
    assert uneven.labels.shape == (n, n)
    assert uneven.shares().sum(axis=0)[0] == pytest.approx(1.0)


def growth(*exponents):
    noise = np.random.default_rng(0).normal(scale=0.01, size=(400, len(exponents)))
    return Growth(np.array(exponents) + noise - noise.mean(axis=0), 1.0, np.zeros(2))


def test_kinds_of_motion():
    turn = np.exp(1j * np.arange(200) * (5**0.5 - 1) * np.pi)
    torus = np.column_stack([turn.real, turn.imag])
    assert motion_kind(torus, growth(0.0, 0.0)) == "quasi-periodic"
    assert motion_kind(torus, growth(0.08, 0.0)) == "chaotic"
    assert motion_kind(torus, growth(0.08, 0.05)) == "hyperchaotic"
    assert motion_kind(torus, growth(-0.1, -0.2)) == "a long period"
    assert motion_kind(np.tile(torus[:3], (20, 1)), growth(-0.1, -0.2)) == "P3"


def test_sections_do_not_hang_on_the_number_of_threads(gear):
    model = gear(delta_T=20.0)
    starts = random_starts(model, 11, np.random.default_rng(3))
    one = gear_sections(model, 50, 20)(starts)
    for workers in (2, 3, 40):
        np.testing.assert_array_equal(gear_sections(model, 50, 20, workers)(starts), one)


def test_starts_that_all_diverge_have_no_shares():
    assert Basins((), np.full(5, -1)).shares().shape == (0, 3)


def test_a_slice_of_odd_size_is_sorted_by_the_whole_plane():
    """Its middle row, which is its own mirror image, counts once."""

    def sections_of(starts):
        apart = np.round(starts[:, 2] - starts[:, 3], 6) != 0
        larger = starts[:, 2] + starts[:, 3] > -0.1
        kind = np.where(apart, np.where(larger, 1.0, 2.0), 0.0)
        return np.tile(kind[:, None, None], (1, 50, 8))

    _, basins = explore_slice(build(Parameters()), sections_of, 3)
    assert list(basins.counts) == [4, 3, 2]
