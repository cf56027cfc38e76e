"""Gears for the tests: the nominal rig, the paper's, and one in which nothing is alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from herringbone_sim.core.integrate import State, Stepper
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.recording.parameter_file import load_parameters

PAPER = Path(__file__).resolve().parents[1] / "config" / "paper.yaml"
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
ONE_HARMONIC = {"phasing": "in_phase", "planet_angle": (), "k_amp": (0.25,), "e_amp": (1.0,)}
CONSTANT = {"k_amp": (), "e_m": 0.0, "e_offset": (0.0,)}
LINEAR = {"b": 0.0, "b_offset": (0.0,), "delta_T": 0.0}


def make(**values):
    """Model of the nominal rig with some values changed; the rig itself can't be assembled."""
    return build(Parameters(**values))


def paper(**values):
    """Model of the paper's gear with some values changed; it can't be assembled either."""
    return build(load_parameters(PAPER).changed(values))


def samples(model, cycles, state=None):
    stepper = Stepper(model)
    n = round(cycles * model.parameters.samples_per_cycle)
    return stepper.advance(state or stepper.start(), n)


def state_at(y):
    return State(np.array(y), 0, 0, 0.0, np.zeros((0, len(y))), np.zeros(0))


def after(model, cycles, y):
    return samples(model, cycles, state_at(y)).end.y


def dimensionless(model, row):
    """(x, v) (2 n_mesh,) of a row of samples."""
    n, s = model.layout.n_mesh, model.scales
    scaled = [row[5 : 5 + n] / s.b_c, row[5 + n : 5 + 2 * n] / s.velocity_m_per_s]
    return np.concatenate(scaled)
