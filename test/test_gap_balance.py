"""The torque balance beside the force law: what settles it, and what may hide a force sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_support import rig
from herringbone_sim.gap.attribution.fit import Fit, fit
from herringbone_sim.gap.verdict.balance import balance_evidence

from herringbone_sim.effects.effect import Active, Locus, active
from herringbone_sim.effects.registry import effect
from herringbone_sim.gap.attribution.hypothesis import Case, case, name_of
from herringbone_sim.gap.residuals.fusion import fuse

FACTOR = 1.2
GAIN = active(effect("sensor_gain"), values={"gain": FACTOR, "channels": ("F",)})
STIFFER = active(effect("mean_stiffness"), Locus(), {"factor": FACTOR})
BODIES = (effect("torque_ripple"), effect("tooth_friction"))


def silent(text: str) -> None:
    del text


def cases_of(*actives: Active, gain: float = 1.0) -> tuple[Case, ...]:
    runs = rig({}, actives=actives).of_role("fit")
    shown = [replace(run, F=replace(run.F, values=gain * run.F.values)) for run in runs]
    return tuple(case(run, fuse(run)) for run in shown)


def fits_of(cases: tuple[Case, ...]) -> tuple[Fit, ...]:
    actives = ((), (GAIN,), (STIFFER,))
    return tuple(fit(cases, np.ones(6), some) for some in actives)


@pytest.mark.parametrize(("amplitude", "factor"), [(0.0, 1.2), (0.5, 1.2), (1.5, 1.06)])
def test_a_ripple_does_not_hide_a_wrong_force_sensor(amplitude: float, factor: float) -> None:
    ripple = active(effect("torque_ripple"), values={"order": 5, "amplitude": amplitude})
    cases = cases_of(ripple, gain=factor)
    fits = fits_of(cases)
    found = balance_evidence(cases, fits, BODIES, silent)
    assert found.left(fits[1]) < 0.1 * found.left(fits[2])
    if amplitude:
        assert found.fits[1].actives[0].effect.id == "torque_ripple"
        assert found.fits[1].actives[0].theta[0] == pytest.approx(amplitude, rel=0.05)


def test_a_stiffer_mesh_is_not_settled_by_a_gain() -> None:
    cases = cases_of(STIFFER)
    fits = fits_of(cases)
    found = balance_evidence(cases, fits, BODIES, silent)
    assert found.by_force[name_of((GAIN,))] > 10.0 * max(found.excess, 0.01)
    assert found.left(fits[2]) < found.left(fits[1])


@pytest.mark.parametrize("count", [0, 1])
def test_the_balance_is_silent_where_no_run_can_be_left_out(count: int) -> None:
    cases = cases_of()[:count]
    assert balance_evidence(cases, (), BODIES, silent).fits == ()
