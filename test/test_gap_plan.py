"""``gap plan``: what sensors would tell agrees with what recordings with effects leave."""

from __future__ import annotations

import json

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gap_support import NOMINAL, POINTS, noisy, prepared, sampled

from herringbone_sim.__main__ import main
from herringbone_sim.cli.gap_plan import noise_of, point_of
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.diagnosis.information import information
from herringbone_sim.diagnosis.search import Search
from herringbone_sim.effects.written import parse_effect
from herringbone_sim.errors import ParameterError
from herringbone_sim.gap.observations.gear import Gear
from herringbone_sim.gap.observations.machine import GearMachine
from herringbone_sim.gap.planning.plan import Plan, plan
from herringbone_sim.gap.planning.sensed import Noise, known_sensors, sensed
from herringbone_sim.gap.planning.summary import by_worth

pytestmark = pytest.mark.filterwarnings("ignore::herringbone_sim.core.parameters.ParameterWarning")
SHAFTS = ("u_s_L", "u_s_R", "u_c")
ONE_MESH = ("x_sp1_L", "v_sp1_L", "F_sp1_L")
TWO = POINTS[:2]


@pytest.fixture(scope="module")
def of_mesh() -> Plan:
    """One mesh with displacement, rate and force, at two points of 30 mesh cycles."""
    return plan(NOMINAL, TWO, ONE_MESH, Noise(), 30)


@pytest.mark.parametrize(
    "sensors, effect, size",
    [
        (ONE_MESH, "thermal_stiffness:rate=4e-4", 0.2),
        (ONE_MESH, "runout@sp/all/all:amplitude=2e-6,phase=0.3,member=sun", 0.4),
        (SHAFTS, "thermal_stiffness:rate=4e-4", 0.2),
        (SHAFTS, "backlash_offset@sp/1/L:offset=2e-6", 0.4),
    ],
)
def test_the_squares_of_a_plan_are_those_of_recordings(
    sensors: Sequence[str], effect: str, size: float
) -> None:
    """Beside the nominal law; size: parameter over the moderate one of the catalogue's curves."""
    one = parse_effect(effect)
    planned = Search(GearMachine(Gear(sensed(NOMINAL, TWO, sensors, Noise(), 50).runs)))
    planned = planned.onwards(planned.machine)
    every = planned.machine.hypotheses()
    there = [h for h in every if h.effect == one.effect.id and h.locus == one.locus]
    found = information(planned.campaign, there, there)
    runs = []
    for i, point in enumerate(TWO):
        series = noisy(sampled({}, point, 50, (one,)), 0.01, i)
        names = tuple(n for n in series.names if n in ("t", "phase", *sensors))
        runs.append(prepared(TimeSeries(series.times, series.columns(names), names), point))
    null = Search(GearMachine(Gear(runs))).null
    told = float(null.energy.sum()) - null.count
    print(effect, sensors, size**2 * found.squares, told, null.count)


def test_own_curve_leaves_nothing(of_mesh: Plan) -> None:
    del of_mesh
