"""Forces with effects read by the interpreter, held against those of the compiler."""

from __future__ import annotations

import sys

import numpy as np

from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.assemble import by_laws
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.evaluate import forces, motion
from herringbone_sim.effects.law_stepper import LawStepper
from herringbone_sim.effects.registry import effect
from herringbone_sim.effects.written import read_effects


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


TEXT = "tooth_friction:mu=0.08; damping_law:share=0.4,power=0,depth=1e-5; ring_flexibility@rp"


def run_by_laws() -> np.ndarray:
    """Samples, end, tangents and contact of a gear run by its laws, and its map, as one row."""
    model = build(Parameters(xi=0.07, delta_T=90.0))
    machine = LawStepper(by_laws(model, read_effects(TEXT)))
    start = machine.start(tangents=2)
    block = machine.advance(start, 32)
    y, tangents = machine.advance_cycles(start.y, start.tangents, 3, 1)
    parts = [block.rows, block.end.y, block.end.tangents, block.contact, y, tangents]
    assert block.switches > 2
    return np.concatenate([part.ravel() for part in parts])
