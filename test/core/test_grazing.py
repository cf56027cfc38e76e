"""Orbits that touch the border of the backlash, or miss it by a hair."""

from __future__ import annotations

import numpy as np
import pytest
from gears import make, samples
from hypothesis import given, settings
from hypothesis import strategies as st


def graze(gear, b, **more):
    """3/4 of a cycle that swings once towards the back side: -0.35 sin(tau) under a load."""
    free = {"delta_T": 0.0, "initial_v": (-0.35,), "samples_per_cycle": 4, "b": b}
    return samples(gear(**free | more), 0.75)


def test_an_orbit_that_just_touches_the_border(gear):
    """The border is bisected to the last bit: on both sides of it, and of a reference, the
    motion is the same, as the force there is zero."""
    touch, miss = 0.2, 0.5
    while (middle := 0.5 * (touch + miss)) not in (touch, miss):
        if graze(gear, middle).switches:
            touch = middle
        else:
            miss = middle
    fine = {"order": 24, "steps_per_cycle": 128}
    assert miss == pytest.approx(0.42345632, abs=1e-8)
    states = [graze(gear, b, **more).end.y for b in (touch, miss) for more in ({}, fine)]
    assert np.ptp(states, axis=0).max() < 1e-12
    assert graze(gear, miss + 1e-13, **fine).switches == 0
    assert graze(gear, touch - 1e-13, **fine).switches > 0


@settings(max_examples=40)
@given(exponent=st.floats(-14.0, -1.0), sign=st.sampled_from([-1.0, 1.0]))
def test_near_grazing_the_step_does_not_matter(exponent, sign):
    b = 0.4234563182159026 + sign * 10.0**exponent
    coarse, fine = graze(make, b), graze(make, b, order=24, steps_per_cycle=128)
    assert np.abs(coarse.end.y - fine.end.y).max() < 1e-10
