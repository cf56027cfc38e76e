"""Gears for the tests of the model: the nominal rig, and one in which nothing is alike."""

from __future__ import annotations

import warnings

import numpy as np

from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters, ParameterWarning

UNEVEN = {
    "model": "full",
    "I_s_factor": (1.1, 0.95),
    "I_p_factor": (1.0, 0.9, 1.2, 0.97, 1.05, 1.1),
    "k_factor": tuple(np.linspace(0.8, 1.25, 12)),
    "c_factor": tuple(np.linspace(1.3, 0.7, 12)),
    "e_factor": tuple(np.linspace(0.9, 1.1, 12)),
    "e_offset": tuple(np.linspace(-1e-5, 2e-5, 12)),
    "b_offset": tuple(np.linspace(2e-5, 0.0, 12)),
    "phi_a": tuple(np.linspace(0.0, 1.0, 12)),
    "phi_b": tuple(np.linspace(-1.0, 0.5, 12)),
    "k_amp": (0.25, 0.1, 0.05),
    "e_amp": (1.0, -0.4, 0.2),
    "phasing": "geometric",
    "planet_angle": (0.0, 117.0, 242.0),
    "initial_x": (0.3, -0.2, 0.1, 0.4),
    "initial_noise": 0.2,
}


def make(**values):
    """Model of the nominal rig with some values changed; the rig itself can't be assembled."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ParameterWarning)
        return build(Parameters(**values))
