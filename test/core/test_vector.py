"""Many numbers at a time: arithmetic as NumPy's, lane by lane."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from herringbone_sim.core.lanes.series import sine_cosine
from herringbone_sim.core.lanes.vector import (
    LANES,
    absolute,
    bits,
    choose,
    fma,
    load,
    nearest,
    root,
    store,
    without,
)

plain = njit(error_model="numpy")


@plain
def arithmetic(a, out):
    x, y = load(a, 0, 0), load(a, 0, 1)
    store(out, 0, 0, x + y)
    store(out, 0, 1, x - 2.0)
    store(out, 0, 2, 2.0 * y)
    store(out, 0, 3, x / y)
    store(out, 0, 4, fma(x, y, 1.0))
    store(out, 0, 5, absolute(x))
    store(out, 0, 6, nearest(y))
    store(out, 0, 7, root(absolute(x)))


@plain
def masks(a, out):
    x, y = load(a, 0, 0), load(a, 0, 1)
    both = (x > 0.0) & (y < 0.5)
    store(out, 0, 0, choose(both, x, y))
    store(out, 0, 1, choose(without(both) | (x == y), 1.0, 0.0))
    return bits(both)


@plain
def angles(a, sine, cosine):
    for row in range(a.shape[0]):
        s, c = sine_cosine(load(a, row, 0))
        store(sine, row, 0, s)
        store(cosine, row, 0, c)


@pytest.fixture
def pair():
    a = np.random.default_rng(0).uniform(-3.0, 3.0, size=(1, 2, LANES))
    a[0, :, 3] = 1.25
    return a


def test_arithmetic_is_numpys(pair):
    x, y = pair[0]
    out = np.zeros((1, 8, LANES))
    arithmetic(pair, out)
    expected = [x + y, x - 2, 2 * y, x / y, x * y + 1, np.abs(x), np.rint(y), np.sqrt(np.abs(x))]
    assert out[0] == pytest.approx(np.array(expected), rel=1e-15, abs=5e-16)


def test_fma_rounds_once():
    a = np.zeros((1, 2, LANES))
    a[0] = 1.0 + 2.0**-30
    out = np.zeros((1, 8, LANES))
    arithmetic(a, out)
    exact = 2.0 + 2.0**-29 + 2.0**-60
    assert np.all(out[0, 4] == exact)


def test_masks_select_lane_by_lane(pair):
    x, y = pair[0]
    both = (x > 0) & (y < 0.5)
    assert 0 < both.sum() < LANES
    out = np.zeros((1, 2, LANES))
    assert masks(pair, out) == sum(1 << int(lane) for lane in np.flatnonzero(both))
    assert np.array_equal(out[0, 0], np.where(both, x, y))
    assert np.array_equal(out[0, 1], np.where(~both | (x == y), 1.0, 0.0))


def test_nan_compares_as_false():
    out = np.zeros((1, 2, LANES))
    assert masks(np.full((1, 2, LANES), np.nan), out) == 0


def test_one_number_is_taken_as_sixteen_are(pair):
    """Arrays without a last axis: the same to the bit as the lane of the same numbers."""
    lanes, one = np.zeros((1, 8, LANES)), np.zeros((1, 8))
    arithmetic(pair, lanes)
    arithmetic(pair[:, :, 5].copy(), one)
    assert np.array_equal(one, lanes[:, :, 5])
    found = np.zeros((1, 2, LANES)), np.zeros((1, 2))
    assert masks(pair[:, :, 5].copy(), found[1]) == masks(pair, found[0]) >> 5 & 1
    assert np.array_equal(found[1], found[0][:, :, 5])


@pytest.mark.parametrize("reach", [1.0, 10.0, 700.0])
def test_sine_and_cosine_to_the_last_bits(reach):
    a = np.random.default_rng(1).uniform(-reach, reach, size=(4000, 1, LANES))
    a[0, 0] = np.pi / 4 * np.arange(LANES)
    sine, cosine = np.zeros_like(a), np.zeros_like(a)
    angles(a, sine, cosine)
    assert np.abs(sine - np.sin(a)).max() < 4e-16
    assert np.abs(cosine - np.cos(a)).max() < 4e-16
