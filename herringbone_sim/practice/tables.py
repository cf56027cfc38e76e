"""Curves as tables for the compiled kernel: piecewise cubics on an even grid over 0..1."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from herringbone_sim.arrays import Array
from herringbone_sim.practice.rig_model import N_TABLE

GRID: Array = np.linspace(0.0, 1.0, N_TABLE)
HALFWAY = 2e-5  # deflection [m] f at which z = f / (f + HALFWAY) is 1/2
LARGEST = 0.96  # z at the end of a table by deflection: f = 0.48 mm


def table(values: Array) -> Array:
    """Return the table (2, n) of a curve: values, and slopes times the grid step.

    The slopes are those of a monotonicity-preserving cubic interpolation.
    """
    grid = np.linspace(0.0, 1.0, len(values))
    slopes = PchipInterpolator(grid, values).derivative()(grid)
    return np.stack([values, slopes / (len(values) - 1)])


def deflections() -> Array:
    """Return the deflections (N_TABLE,) [m] at the nodes of a table by deflection."""
    z = LARGEST * GRID
    nodes: Array = HALFWAY * z / (1.0 - z)
    return nodes


def wave(parts: Any, count: int) -> tuple[Array, Array]:
    """Return cosines, sines (count,) of terms (order, a, angle): a cos(order phase - angle)."""
    cos, sin = np.zeros((2, count))
    for order, amplitude, angle in parts:
        cos[int(order) - 1] += amplitude * np.cos(angle)
        sin[int(order) - 1] += amplitude * np.sin(angle)
    return cos, sin
