"""Analysis of the motion of a four-panel figure of the paper, as that of a recorded run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from herringbone_sim.analysis.pipeline import GearData, Options, SegmentResult, analyze_series
from herringbone_sim.analysis.sections import Section
from herringbone_sim.arrays import Array
from herringbone_sim.core.integrate import State, simulate
from herringbone_sim.core.model import Model, by_kind, relative
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.paper.reproduction import POINT_CYCLES, POINT_SETTLE, Point

CYCLES, SAMPLES = 480, 64
RUN = POINT_SETTLE + POINT_CYCLES  # mesh cycles before the end state of a point


def recorded(point: Point) -> SegmentResult:
    """Integrate 480 mesh cycles more of the motion of a figure, and analyse them like a recording.

    The section in the result is that of the point, which has 2000 cycles.

    Raises:
        DivergenceError: the motion diverges.
    """
    p = point.parameters.changed({"samples_per_cycle": SAMPLES})
    model, n = build_with(p, point.effects), len(point.end)
    start = State(point.end, RUN, 0, 0.0, np.zeros((0, n)), np.zeros(0))
    series, _ = simulate(model, CYCLES, start)
    scales = model.scales
    half = by_kind(model.packed.b * scales.b_c)
    gear = GearData(scales.b_c, scales.omega_n, half_backlash_m=lambda _: half)
    options = Options(transient_cycles=0, noise_share=0.0)
    (result,) = analyze_series(series, options=options, gear=gear)
    section = _section(model, point.sections, result.section)
    return replace(result, section=section)


def _section(model: Model, states: Array, like: Section) -> Section:
    """Section in SI units from dimensionless states (n, n_state) at phase 0; times are counts."""
    pairs = [relative(model, y[: model.layout.n_state], 0.0) for y in states]
    scale = model.scales
    return replace(
        like,
        cycles=np.arange(len(states)),
        times=np.arange(len(states), dtype=float),
        x=np.array([x for x, _ in pairs]) * scale.b_c,
        v=np.array([v for _, v in pairs]) * scale.velocity_m_per_s,
    )
