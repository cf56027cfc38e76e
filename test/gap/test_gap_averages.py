"""Moving averages by a Gaussian window, against NumPy's convolution."""

from __future__ import annotations

import numpy as np
import pytest

from herringbone_sim.gap.data.gaussian_window import gaussian_window


@pytest.mark.parametrize("stride", [1, 2, 3, 7])
@pytest.mark.parametrize("deviation", [0.7, 2.3])
@pytest.mark.parametrize("more", [0, 1, 5, 40])
def test_averages_at_a_stride_are_every_so_manyth_average(
    stride: int, deviation: float, more: int
) -> None:
    window = gaussian_window(deviation, 1e-3)
    signals = np.random.default_rng(0).normal(size=(3, len(window.mean) + more))
    all_of_them = [np.convolve(signal, window.mean, "valid") for signal in signals]
    found = window.averages(signals, stride)
    np.testing.assert_allclose(found, np.array(all_of_them)[:, ::stride], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(window.average(signals.T).T[:, ::stride], found, atol=1e-12)
