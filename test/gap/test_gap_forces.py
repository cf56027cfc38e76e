"""Forces of all meshes from few channels: true forces lie in the band, gauges narrow it."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gap_support import NOMINAL, POINTS, of_shafts, rig, sampled, without

from herringbone_sim.diagnosis.examine import FittedExplanation
from herringbone_sim.diagnosis.search import Score
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.gear import Gear
from herringbone_sim.gap.observations.machine import GearMachine
from herringbone_sim.gap.observations.reconstructed_forces import (
    HALF_90,
    ReconstructedForces,
    forces_of_run,
    reconstructed_forces,
)
from herringbone_sim.gap.verification.serialise import forces_to_dict
from herringbone_sim.views.figures.gap import GapArrays
from herringbone_sim.views.pages.gap.page import write_gap_page
from herringbone_sim.views.tables.forces import write_forces

pytestmark = pytest.mark.filterwarnings("ignore::herringbone_sim.core.parameters.ParameterWarning")
OWN = {"k_m_sp": 1.01 * NOMINAL.k_m_sp, "k_m_rp": 0.99 * NOMINAL.k_m_rp}  # inside the tolerance
AT = 2  # number of the run: teeth touch and part


def explained(
    machine: GearMachine,
    values: dict[str, float] | None = None,
    sd: dict[str, float] | None = None,
) -> FittedExplanation:
    """The calibrated gear with its tolerances as known beforehand, or with some values."""
    mean = np.array([(values or {}).get(c.name, 0.0) for c in machine.base])
    size = [c.sd if sd is None else sd.get(c.name, 0.0) for c in machine.base]
    nothing = np.zeros((0, len(mean)))
    covariance = np.diag(np.square(size))
    score = Score(machine.base, mean, covariance, nothing, nothing, 0.0, 0.0, 1.0, {})
    return FittedExplanation((), score)


@pytest.fixture(scope="module")
def whole() -> PreparedRun:
    """A run of a rig inside its tolerances, all channels."""
    return rig(OWN).runs[AT]


@pytest.fixture(scope="module")
def machine(whole: PreparedRun) -> GearMachine:
    """The gear as three encoders show it."""
    return GearMachine(Gear([of_shafts(whole)]))


@pytest.fixture(scope="module")
def forces(machine: GearMachine) -> ReconstructedForces:
    return reconstructed_forces(machine, machine.gear.runs[0].run, explained(machine))


def truth(forces: ReconstructedForces) -> np.ndarray:
    """Forces (n, 12) of the rig at the same phases, without noise."""
    series = sampled(OWN, POINTS[AT])
    at = np.searchsorted(series["phase"], forces.phase - 1e-6)
    np.testing.assert_allclose(series["phase"][at], forces.phase, atol=1e-6)
    return series.columns(tuple(f"F_{m}" for m in forces.meshes))[at]


@pytest.mark.parametrize("kind", [slice(0, 6), slice(6, 12)])
def test_true_forces_lie_in_the_band(forces: ReconstructedForces, kind: slice) -> None:
    """And the band tells something: it is narrower than the force is large."""
    true, size = truth(forces)[:, kind], forces.half[:, kind]
    inside = np.abs(true - forces.force[:, kind]) <= size
    print(inside.mean(), np.median(size) / np.sqrt(np.mean(true**2)))
    assert inside.mean() > 0.8
    assert np.median(size) < 0.2 * np.sqrt(np.mean(true**2))


def test_a_gauge_narrows_the_band_of_its_mesh_and_tells_planets_apart(
    whole: PreparedRun, forces: ReconstructedForces
) -> None:
    meshes = whole.model.layout.meshes
    gauge = without(whole.F, meshes, tuple(m for m in meshes if m != "rp1_L"))
    run = replace(of_shafts(whole), F=gauge)
    machine = GearMachine(Gear([run]))
    found = reconstructed_forces(machine, run, explained(machine))
    before, after = (np.median(one.half, axis=0) for one in (forces, found))
    j = meshes.index("rp1_L")
    print(before, after)
    assert after[j] < 0.8 * before[j]
    assert after[j] / before[j] < (after / before)[meshes.index("rp2_R")]
    assert forces.planets_alike
    assert not found.planets_alike


def test_the_band_is_how_far_a_coefficient_moves_the_forces(
    machine: GearMachine, forces: ReconstructedForces
) -> None:
    """States are fitted anew under each stiffness; what noise and start add is taken off."""
    run, sd = machine.gear.runs[0].run, 0.004
    band, least = (
        reconstructed_forces(machine, run, explained(machine, sd={"k_sp": one}), 1e-6)
        for one in (sd, 0.0)
    )
    moved = reconstructed_forces(machine, run, explained(machine, values={"k_sp": sd}))
    late = slice(len(forces.force) // 2, None)
    told = np.sqrt(np.maximum(band.half**2 - least.half**2, 0.0))[late] / HALF_90
    found = np.abs(moved.force - forces.force)[late]
    print(told.shape, np.corrcoef(told.ravel(), found.ravel()))
    print(np.sqrt(np.mean(told**2)), np.sqrt(np.mean(found**2)))
    assert np.sqrt(np.mean(told**2)) == pytest.approx(np.sqrt(np.mean(found**2)), rel=0.3)


def test_more_noise_widens_the_band(machine: GearMachine, forces: ReconstructedForces) -> None:
    run = machine.gear.runs[0].run
    fitted = replace(run, name="earlier", role="fit")
    found = forces_of_run(machine, [fitted, run], explained(machine), np.array([[3.0], [3.0]]))
    assert found is not None
    assert (found.run, found.role) == ("run_02", "held_out")
    assert np.median(found.half) > 1.5 * np.median(forces.half)


def test_forces_are_told_where_windows_are_used_alone(whole: PreparedRun) -> None:
    machine = GearMachine(Gear([whole]))
    assert forces_of_run(machine, [whole], explained(machine)) is None
    assert forces_to_dict(None) == {}


def test_forces_are_told_in_report_table_and_page(
    forces: ReconstructedForces, tmp_path: Path
) -> None:
    told = forces_to_dict(forces)
    assert list(told["meshes"]) == list(forces.meshes)
    first = told["meshes"]["sp1_L"]
    assert first["rms"] == pytest.approx(np.sqrt(np.mean(forces.force[:, 0] ** 2)))
    assert 0.0 < first["contact"] < 1.0
    write_forces(tmp_path / "forces.csv", forces)
    with (tmp_path / "forces.csv").open(encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert (head[0], head[1], head[13]) == ("t_s", "F_sp1_L_n", "half_sp1_L_n")
    assert float(rows[5][13]) == pytest.approx(forces.half[5, 0], rel=1e-8)
    page = write_gap_page({}, tmp_path, GapArrays(forces=forces)).read_text(encoding="utf-8")
    assert "worked out from its recorded channels by the law of the calibrated gear" in page
    assert page.count("data:image/png;base64,") == 1
