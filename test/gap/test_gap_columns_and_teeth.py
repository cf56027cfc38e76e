"""Columns are derivatives at any amplitude; a damaged tooth is named where it is.

Derivatives by central differences of the law and of windows of the nominal gear.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace

import numpy as np
import pytest
from gap_support import NOMINAL, rig

from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Locus, active
from herringbone_sim.effects.registry import effect
from herringbone_sim.effects.site import whole_cycles
from herringbone_sim.gap.observations.basis import force_column
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.hypotheses import damaged_teeth
from herringbone_sim.gap.observations.hypotheses.damaged_teeth import mesh_delays
from herringbone_sim.gap.observations.windows.forcing import ForcedWindows
from herringbone_sim.gap.observations.windows.sensor_errors import (
    error_columns,
    with_sensor_errors,
)
from herringbone_sim.gap.observations.windows.shooting import (
    evaluated,
    stacked_residual,
    symmetric_starts,
)
from herringbone_sim.gap.planning.synthetic import SensorNoise, simulate_campaign
from herringbone_sim.gap.residuals.mesh_law import LawChange

FULL = Parameters(model="full", samples_per_cycle=24)
POINT = {"delta_T": 60.0, "K": 0.0, "T_1": 900.0, "Omega": 0.8}


@pytest.mark.parametrize("size", [-0.6, 1.5])
def test_the_column_of_a_stiffness_is_its_derivative_at_any_size(size: float) -> None:
    channels = [name for q in "xvFu" for name in FULL.layout.channels_of(q)]
    runs = simulate_campaign(FULL, [POINT], channels, SensorNoise(), 10).runs
    gear = GearObservations(runs)
    m, ones, h = gear.runs[0].strided, np.ones(12), 1e-4

    def force(a: float) -> np.ndarray:
        return gear.law_of(m, {"kappa": a * ones}, ()).force

    slope = (force(size + h) - force(size - h)) / (2.0 * h)
    kappa = next(f for f in gear.law_functions if f.name == "kappa")
    column = force_column(kappa, m, gear.law_of(m, {"kappa": size * ones}, ()))
    assert column == pytest.approx(slope, rel=1e-4, abs=1e-3 * np.abs(slope).max())


@pytest.mark.parametrize("error", ["gain", "bias"])
def test_the_columns_of_sensor_errors_are_derivatives_beside_a_gain(error: str) -> None:
    sensors = ("u_s_L", "u_s_R", "u_c", "F_rp2_R")
    run = simulate_campaign(FULL, [POINT], sensors, SensorNoise(), 20).runs[0]
    windows = ForcedWindows(run, 0, 4)
    forcing = windows.forcing(LawChange(), windows.masses({}), ())
    starts = symmetric_starts(windows.recorded)
    name, size = f"{error} of F_rp2_R", {"gain": 1e-3, "bias": 1.0}[error]

    def solution(more: Mapping[str, float]):
        errors = {"gain of F_rp2_R": -0.7, "bias of F_rp2_R": 0.0}
        errors = {key: value + more.get(key, 0.0) for key, value in errors.items()}
        s = with_sensor_errors(windows.recorded, errors)
        return s, evaluated(s, starts, forcing)

    after, before = (stacked_residual(solution({name: way * size})[1]) for way in (1.0, -1.0))
    s, now = solution({})
    exact = np.zeros((len(now.states_of_all), len(sensors)))
    column = error_columns(s, now, exact, [name])[name]
    slope = (before - after)[: column.size] / (2.0 * size)
    assert column @ slope / (slope @ slope) == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize(
    ("place", "member"), [(("sp", "2", "L"), "sun"), (("rp", "3", "R"), "ring")]
)
def test_a_tooth_on_one_mesh_is_named_where_it_is(
    place: tuple[str, str, str], member: str
) -> None:
    locus = Locus(*place)
    own = {"depth": 0.3, "position": 10.0, "width": 1.5, "member": member}
    crack = active(effect("tooth_crack"), locus, own)
    gear = GearObservations(rig({}, cycles=80, actives=[crack]).of_role("fit"), stride=2)
    found = next(
        event
        for event in damaged_teeth.proposals(gear, {})
        if (event.effect, event.locus) == ("tooth_crack", locus)
    )
    assert found.middle == pytest.approx(10.0, abs=0.5)


@pytest.mark.parametrize(
    "own",
    [{}, {"mesh_phase": (0.0,) * 6 + (np.pi / 2.0,) * 6}, {"phasing": "geometric"}],
)
@pytest.mark.parametrize(("kind", "member"), [("rp", "ring"), ("sp", "sun"), ("all", "planet")])
@pytest.mark.filterwarnings("ignore")
def test_the_delays_of_the_catalogue_are_tried(own: dict, kind: str, member: str) -> None:
    model = build(NOMINAL.changed(own))
    mask = Locus(kind, "1" if kind == "all" else "all", "L").mask(model.layout)
    wanted = whole_cycles(model, mask, {"member": member})[2]
    gear = SimpleNamespace(model=model)
    ways = [late for _, late in mesh_delays(gear, member)]
    assert any(np.allclose(late[mask > 0], wanted[mask > 0]) for late in ways)
