"""A diagnosis in the viewer: what stands in the three columns, and that the file is one."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gap_support import NOMINAL, rig

from herringbone_sim.cli.gap import mirror_gap
from herringbone_sim.effects.effect import Locus, active
from herringbone_sim.effects.registry import effects
from herringbone_sim.gap.attribution.effect_forces import fused_run
from herringbone_sim.gap.calibrated_fit import Calibrated
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.diagnose import Diagnosis
from herringbone_sim.gap.report import Report
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.gap.run_comparison import mesh_shares, run_views
from herringbone_sim.gap.verdict.augmented import Augmented
from herringbone_sim.gap.verdict.decide import NamedExplanation, Verdict
from herringbone_sim.gap.verdict.next_experiment import NextExperiment
from herringbone_sim.gap.verification.residual_gap import Gap, RunGap
from herringbone_sim.views.mirror.gap_blueprint import RunLayout, blueprint
from herringbone_sim.views.mirror.target import MirrorTarget


@pytest.fixture(scope="module")
def campaign() -> PreparedCampaign:
    return rig({"k_m_sp": 1.1 * NOMINAL.k_m_sp}, cycles=60)


@pytest.fixture(scope="module")
def found(campaign: PreparedCampaign) -> Diagnosis:
    """A verdict with the planted cause, put together by hand."""
    stiff = active(effects()["mean_stiffness"], Locus("sp"), {"factor": 1.1})
    cases = tuple(fused_run(run, fuse(run)) for run in campaign.of_role("fit"))
    name, option = "mean_stiffness", NamedExplanation((stiff,))
    best = {name: (option, 0)}
    verdict = Verdict(name, (name,), {name: 1.0}, best, (), "force_law", option, None, ())
    gap = Gap("force_law", tuple(RunGap(r.name, r.role, 3.0, 1.1, 1.0) for r in campaign.runs))
    # Damping goes with the root of the stiffness, Eq. (11).
    factors = np.array([1.0, 1.0, 1.1**0.5, 1.0, 1.0, 1.0])
    model = Augmented(factors, np.ones(3), (stiff,))
    calibrated = Calibrated(cases, np.ones(6), None)
    report = Report("rig", verdict, [], gap, [], NextExperiment({}, ""))
    return Diagnosis(None, campaign.runs, calibrated, model, report)


def test_columns_hold_what_their_names_say(campaign: PreparedCampaign, found: Diagnosis) -> None:
    views = run_views(found)
    assert [view.run.role for view in views] == ["fit", "fit", "held_out"]
    for view in views:
        before, after = view.reduced_chi2["nominal"], view.reduced_chi2["augmented"]
        assert before[:6].min() > 1.5 * after[:6].max()
        assert after.max() < 1.3
        np.testing.assert_array_equal(
            view.force["measured"], view.run.F.values[-len(view.times) :]
        )
        assert set(view.planes) == {"measured", "nominal", "augmented"}
        assert view.notes == ()


def test_the_augmented_model_moves_as_the_rig_does_where_it_is_periodic(
    campaign: PreparedCampaign, found: Diagnosis
) -> None:
    for view in (run_views(found)[i] for i in (0, 2)):
        sizes = {name: np.std(plane[:, :, 0], axis=0) for name, plane in view.planes.items()}
        off = {name: np.mean(np.abs(s / sizes["measured"] - 1.0)) for name, s in sizes.items()}
        assert off["augmented"] < 0.02
        assert off["augmented"] < 0.5 * off["nominal"]


def test_shares_are_of_the_nominal_residual(campaign: PreparedCampaign, found: Diagnosis) -> None:
    of = mesh_shares(run_views(found))
    assert sum(share or 0.0 for share in of["nominal"].values()) == pytest.approx(1.0)
    assert sum(of["nominal"][f"sp{i}_{s}"] or 0.0 for i in (1, 2, 3) for s in "LR") > 0.95
    assert sum(share or 0.0 for share in of["augmented"].values()) < 0.1


def test_there_are_no_shares_of_noise(found: Diagnosis) -> None:
    """A mesh just above its noise under the augmented model would be any multiple of nothing."""
    n = len(run_views(found)[0].meshes)
    chi2 = {"nominal": np.full(n, 0.9), "augmented": np.full(n, 1.01)}
    views = [replace(view, reduced_chi2=chi2) for view in run_views(found)]
    for shares in mesh_shares(views).values():
        assert set(shares.values()) == {None}


def test_the_file_is_one_that_the_viewer_takes(
    campaign: PreparedCampaign, found: Diagnosis, tmp_path: Path
) -> None:
    from herringbone_sim.views.mirror.sink import rerun_binary

    path = tmp_path / "out" / "gap.rrd"
    assert mirror_gap(MirrorTarget("save", "", path), found) == f"mirrored to {path}"
    done = subprocess.run(
        [rerun_binary(), "rrd", "print", str(path)], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    for entity in (
        "/verdict",
        "/gear/nominal/spots",
        "/gear/augmented/spots",
        "/run_00/force/measured/sp",
        "/run_02/residual/augmented/rp",
        "/run_01/plane/augmented/sp",
    ):
        assert entity in done.stdout


def test_a_run_without_motion_has_no_portrait_and_stops_no_overview() -> None:
    still = RunLayout("run_00", "fit", {}, (), ())
    blueprint(False, [still])


def test_a_viewer_that_is_not_there_is_said(campaign: PreparedCampaign, found: Diagnosis) -> None:
    said = mirror_gap(MirrorTarget("connect", "127.0.0.1:9", Path("gap.rrd")), found)
    assert said.startswith("not mirrored: no viewer answers at 127.0.0.1:9")


def test_a_drawing_that_fails_never_costs_the_report(
    campaign: PreparedCampaign,
    found: Diagnosis,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(*_: object) -> None:
        raise ValueError("math domain error")

    monkeypatch.setattr("herringbone_sim.views.mirror.gap.mirror", fail)
    said = mirror_gap(MirrorTarget("save", "", tmp_path / "gap.rrd"), found)
    assert said == "not mirrored: math domain error"
