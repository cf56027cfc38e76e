"""Forces of all meshes from few channels: true forces lie in the band, gauges narrow it."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gap_support import NOMINAL, POINTS, a_report, of_shafts, rig, sampled, without

from herringbone_sim.diagnosis.fits import FittedExplanation
from herringbone_sim.diagnosis.search import Search
from herringbone_sim.gap.data.prepared import PreparedCampaign, PreparedRun
from herringbone_sim.gap.gap_by_run import RowErrors, gap_of
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
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

OWN = {"k_m_sp": 1.01 * NOMINAL.k_m_sp, "k_m_rp": 0.99 * NOMINAL.k_m_rp}  # inside the tolerance
AT = 2  # number of the run whose forces are told


def calibrated(machine: GearMachine) -> FittedExplanation:
    """The calibrated gear without effects."""
    return FittedExplanation((), Search(machine).null)


@pytest.fixture(scope="module")
def campaign() -> PreparedCampaign:
    """A rig inside its tolerances, all channels; the last of its runs is held out."""
    return rig(OWN)


@pytest.fixture(scope="module")
def whole(campaign: PreparedCampaign) -> tuple[PreparedRun, ...]:
    return campaign.runs


@pytest.fixture(scope="module")
def machine(whole: tuple[PreparedRun, ...]) -> GearMachine:
    """The gear as three encoders show it."""
    return GearMachine(GearObservations([of_shafts(run) for run in whole]))


@pytest.fixture(scope="module")
def fit(machine: GearMachine) -> FittedExplanation:
    return calibrated(machine)


@pytest.fixture(scope="module")
def forces(machine: GearMachine, fit: FittedExplanation) -> ReconstructedForces:
    return reconstructed_forces(machine, machine.gear.runs[AT].run, fit)


def truth(forces: ReconstructedForces) -> np.ndarray:
    """Forces (n, 12) of the rig at the same phases, without noise."""
    series = sampled(OWN, POINTS[AT])
    at = np.searchsorted(series["phase"], forces.phase - 1e-6)
    np.testing.assert_allclose(series["phase"][at], forces.phase, atol=1e-6)
    return series.columns(tuple(f"F_{m}" for m in forces.meshes))[at]


@pytest.mark.parametrize("kind", [slice(0, 6), slice(6, 12)])
def test_true_forces_lie_in_the_band(forces: ReconstructedForces, kind: slice) -> None:
    """Of 90 %; and it is narrower than the force is large."""
    true, half = truth(forces)[:, kind], forces.half[:, kind]
    inside = np.abs(true - forces.force[:, kind]) <= half
    assert inside.mean() > 0.85
    assert np.median(half) < 0.1 * np.sqrt(np.mean(true**2))


def test_a_gauge_narrows_the_band_of_its_mesh_and_tells_planets_apart(
    whole: tuple[PreparedRun, ...], forces: ReconstructedForces
) -> None:
    meshes = forces.meshes
    others = tuple(m for m in meshes if m != "rp1_L")
    runs = [replace(of_shafts(run), F=without(run.F, meshes, others)) for run in whole]
    machine = GearMachine(GearObservations(runs))
    found = reconstructed_forces(machine, runs[AT], calibrated(machine))
    narrower = np.median(found.half, axis=0) / np.median(forces.half, axis=0)
    assert np.argmin(narrower) == meshes.index("rp1_L")
    assert narrower.min() < 0.6
    assert forces.planets_alike
    assert not found.planets_alike


def test_the_band_is_how_far_a_coefficient_moves_the_forces(
    machine: GearMachine, fit: FittedExplanation
) -> None:
    """States are fitted anew with other sun meshes; what noise alone leaves is taken off.

    On a run without control: under it hidden planets move far at nearly the same chi2.
    """
    run, off = machine.gear.runs[0].run, np.zeros(len(machine.base))
    off[[c.name for c in machine.base].index("k_sp")] = 0.008
    nothing = np.zeros((0, len(off)))
    band, least, moved = (
        reconstructed_forces(
            machine,
            run,
            replace(
                fit,
                score=replace(
                    fit.score,
                    mean=fit.score.mean + step,
                    covariance=np.outer(size, size),
                    leave_one_out_means=nothing,
                ),
            ),
        )
        for step, size in ((0.0 * off, off), (0.0 * off, 0.0 * off), (off, 0.0 * off))
    )
    late = slice(len(band.force) // 2, None)
    told = np.sqrt(np.maximum(band.half**2 - least.half**2, 0.0))[late] / HALF_90
    found = np.abs(moved.force - least.force)[late]
    assert np.corrcoef(told.ravel(), found.ravel())[0, 1] > 0.9
    assert np.sqrt(np.mean(told**2)) == pytest.approx(np.sqrt(np.mean(found**2)), rel=0.2)


def test_more_noise_widens_the_band_of_the_run_that_was_held_out(
    machine: GearMachine, fit: FittedExplanation, forces: ReconstructedForces
) -> None:
    runs = [g.run for g in machine.gear.runs]
    found = forces_of_run(machine, runs, fit, np.array([[3.0], [3.0]]))
    assert found is not None
    assert (found.run, found.role) == ("run_02", "held_out")
    assert np.median(found.half) > 1.2 * np.median(forces.half)


def test_forces_are_told_where_windows_are_used_alone(
    whole: tuple[PreparedRun, ...], fit: FittedExplanation
) -> None:
    everything = GearMachine(GearObservations(whole))
    assert forces_of_run(everything, whole, fit, 1.0) is None
    assert forces_to_dict(None) == {}


def test_a_held_out_run_with_other_channels_is_passed_over(
    machine: GearMachine, whole: tuple[PreparedRun, ...], fit: FittedExplanation
) -> None:
    """It has forces of its own; those of a fit run are told instead."""
    held_out = next(run for run in whole if run.role == "held_out")
    fitted = next(g.run for g in machine.gear.runs if g.run.role == "fit")
    found = forces_of_run(machine, [fitted, held_out], fit, 1.0)
    assert found is not None
    assert (found.run, found.role) == (fitted.name, "fit")


def test_forces_are_told_in_report_table_and_page(
    forces: ReconstructedForces, tmp_path: Path
) -> None:
    told = forces_to_dict(forces)
    assert list(told["meshes"]) == list(forces.meshes)
    first = told["meshes"]["sp1_L"]
    assert first["rms"] == pytest.approx(np.sqrt(np.mean(forces.force[:, 0] ** 2)))
    assert 0.0 < first["contact"] <= 1.0
    assert told["planets_alike"]
    write_forces(tmp_path / "forces.csv", forces)
    with (tmp_path / "forces.csv").open(encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert (head[0], head[1], head[13]) == ("t_s", "F_sp1_L_n", "half_sp1_L_n")
    assert float(rows[5][13]) == pytest.approx(forces.half[5, 0], rel=1e-8)
    page = write_gap_page(a_report(), tmp_path, GapArrays(forces=forces)).read_text(
        encoding="utf-8"
    )
    assert "worked out from its recorded channels by the law of the calibrated gear" in page
    assert page.count("data:image/png;base64,") == 1
    write_forces(tmp_path / "forces.csv", None)  # of a later diagnosis without them
    assert not (tmp_path / "forces.csv").exists()


def test_noise_that_is_not_told_is_at_most_what_is_left(
    machine: GearMachine, fit: FittedExplanation, campaign: PreparedCampaign
) -> None:
    """Taken three times too large, it would lie above what the explanation leaves.

    So it is where noise is told but a rotation lacks its mean.
    """
    raw = tuple(replace(run, detrended=("u_c",)) for run in campaign.runs)
    told, *estimated = (
        gap_of(machine, of, "trajectory", fit, fit, None, RowErrors(np.full((1, 1), 3.0))).runs
        for of in (campaign, replace(campaign, noise_known=False), replace(campaign, runs=raw))
    )
    assert all(one.floor > 2.0 * one.augmented for one in told)
    for one in (run for gap in estimated for run in gap):
        assert one.floor == pytest.approx(one.augmented)
