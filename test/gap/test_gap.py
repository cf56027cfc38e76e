"""Campaigns and the residual of the force law: planted differences are found where they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from herringbone_sim.__main__ import main
from herringbone_sim.core.integrate import simulate
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.errors import AnalysisError, RecordingError
from herringbone_sim.gap.residuals.force_residual import force_residual
from herringbone_sim.recording.campaign import read_campaign
from herringbone_sim.recording.writer import RunWriter

ROOT = Path(__file__).resolve().parents[2]
RIG = Parameters(model="full", delta_T=40.0, mesh_phase=(0.0, 0.3, 0.0) * 4)


def test_the_law_that_made_the_forces_leaves_no_residual() -> None:
    series, _ = simulate(build(RIG), 30)
    found = force_residual(build(RIG), series)
    assert found.rms_n.max() < 1e-6 * np.abs(found.force_n).max()


def test_harmonics_of_stiffness_are_shifted_by_their_order_times_the_mesh_phase() -> None:
    rig = build(RIG.changed({"k_amp": (0.25, 0.1, 0.05), "phi_a": [0.4]}))
    series, _ = simulate(rig, 30)
    found = force_residual(rig, series)
    assert found.rms_n.max() < 1e-6 * np.abs(found.force_n).max()


def test_a_stiffer_mesh_is_found_where_it_is_with_its_size() -> None:
    factor = [1.0] * 12
    factor[4] = 1.1  # sp2_R
    series, _ = simulate(build(RIG.changed({"k_factor": factor})), 200)
    found = force_residual(build(RIG), series)
    assert found.meshes[4] == "sp2_R"
    assert found.shares[4] > 0.999
    hit = np.abs(series["x_sp2_R"]) > build(RIG).half_backlash_m[4]
    c, force = build(RIG).damping_n_s_per_m[4], series["F_sp2_R"]
    spring = force[hit] - c * series["v_sp2_R"][hit]
    np.testing.assert_allclose(found.residual_n[hit, 4] / spring, 0.1 / 1.1, rtol=1e-6)


def test_a_recording_without_forces_is_refused() -> None:
    series, _ = simulate(build(RIG), 1)
    keep = tuple(n for n in series.names if not n.startswith("F_"))
    with pytest.raises(AnalysisError, match="x, v, F"):
        force_residual(build(RIG), TimeSeries(series.times, series.columns(keep), keep))


def campaign(folder: Path, **changed: object) -> Path:
    """Two runs of the rig with stiffer ring meshes, as a campaign."""
    runs = []
    for i, role in enumerate(("fit", "held_out")):
        point = {"delta_T": 30.0 + 20 * i, "K": 0.1, "T_1": 300.0, "Omega": 0.9}
        p = Parameters(model="full", **point).changed({"k_factor": [1.0] * 6 + [1.2] * 6})
        model = build(p)
        series, _ = simulate(model, 50)
        writer = RunWriter.create(folder, f"run_{i}", "/rig", {}, model.layout.channels, 0)
        writer.write_samples(series.data)
        writer.close()
        runs.append({"path": f"run_{i}", "role": role, **point, **changed})
    content = {"rig": "mine", "noise": {"kind": "white", "rms_share": 0.01}, "runs": runs}
    (folder / "campaign.yaml").write_text(yaml.safe_dump(content))
    return folder


def test_a_campaign_is_read_and_told_mesh_by_mesh(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = campaign(tmp_path / "rig")
    read = read_campaign(folder)
    assert (read.rig, read.noise_share) == ("mine", 0.01)
    assert [run.role for run in read.runs] == ["fit", "held_out"]
    nominal = str(ROOT / "config" / "rig.yaml")
    assert main(["gap", str(folder), "--nominal", nominal, "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr().out
    assert shown.count("rp") >= 2
    rows = (tmp_path / "out" / "residual.csv").read_text().splitlines()
    assert len(rows) == 1 + 2 * 12
    sun = [float(row.split(",")[3]) for row in rows if ",sp" in row]
    assert max(sun) < 1e-3


@pytest.mark.parametrize("wrong", [{"role": "test"}, {"delta_T": "warm"}])
def test_a_campaign_that_says_nonsense_is_refused(
    tmp_path: Path, wrong: dict[str, object]
) -> None:
    with pytest.raises(RecordingError, match="campaign"):
        read_campaign(campaign(tmp_path / "rig", **wrong))


def test_a_folder_without_campaign_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"campaign\.yaml"):
        read_campaign(tmp_path)
    (tmp_path / "campaign.yaml").write_text("rig: mine\nruns: []\n")
    with pytest.raises(RecordingError, match="no runs"):
        read_campaign(tmp_path)


def test_a_reading_that_lacks_takes_no_mesh_along() -> None:
    model = build(Parameters(model="full", delta_T=40.0))
    series, _ = simulate(model, 3)
    data = series.data.copy()
    data[7, series.names.index("F_sp1_L")] = np.nan
    data[:, series.names.index("v_sp2_L")] = np.nan  # as from a dead sensor
    found = force_residual(model, TimeSeries(series.times, data, series.names))
    assert "sp2_L" not in found.meshes
    assert np.isfinite(found.rms_n).all()
    assert found.shares.sum() == pytest.approx(1.0)
