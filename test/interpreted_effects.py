"""Forces with effects read by the interpreter, held against those of the compiler."""

from __future__ import annotations

import sys

import numpy as np

from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.evaluate import forces, motion
from herringbone_sim.effects.registry import effect


def main() -> None:
    rig = build(Parameters(model="full", delta_T=40.0, mesh_phase=(0.0, 0.3, 0.0) * 4))
    with np.load(sys.argv[1]) as found:
        data, compiled = found["data"], found["compiled"]
    series = TimeSeries(data[:, 0].copy(), data, rig.layout.channels)
    ones = []
    for name in ("planet_phase", "runout", "ring_flexibility"):
        one = effect(name)
        ones.append(Active(one, tuple(one.start), one.candidates(rig.layout)[0]))
    read = forces(rig, ones, motion(rig, series))
    np.testing.assert_allclose(read, compiled, rtol=1e-12, atol=1e-9)
