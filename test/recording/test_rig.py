"""Made-up rigs: recordings by the data sheet's rules, and labels that the campaign can't tell."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from herringbone_sim.__main__ import main
from herringbone_sim.core.layout import HEAD
from herringbone_sim.core.mesh import backlash
from herringbone_sim.core.model import build, errors_at
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Active, Locus, active
from herringbone_sim.effects.evaluate import forces, motion
from herringbone_sim.effects.gear import laws
from herringbone_sim.effects.registry import effect
from herringbone_sim.errors import RecordingError
from herringbone_sim.gap.data.mesh_excitation import waves
from herringbone_sim.gap.residuals.force_residual import force_residual
from herringbone_sim.recording.campaign import read_campaign
from herringbone_sim.recording.hidden_effects import hidden_effects
from herringbone_sim.recording.reader import read_recording
from herringbone_sim.recording.rig import RigPlan, make_campaign, make_run, within_tolerance

NOMINAL = Parameters(model="full", samples_per_cycle=24)
POINT = {"delta_T": 40.0, "K": 0.2, "T_1": 400.0, "Omega": 0.9}
EXACT = RigPlan(NOMINAL, cycles=20, transient=5, noise_share=0.0, bits=0, tolerance=0.0)
STIFF = active(effect("mean_stiffness"), Locus("sp"), {"factor": 1.2})


def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def test_an_exact_rig_obeys_the_nominal_law() -> None:
    series = make_run(EXACT, NOMINAL, POINT, rng())
    found = force_residual(build(NOMINAL.changed(POINT)), series)
    assert found.rms_n.max() < 1e-9 * np.abs(found.force_n).max()
    assert series.times[0] == 0.0
    np.testing.assert_array_equal(series["K"], 0.2)


def test_chosen_channels_are_those_of_the_whole_recording() -> None:
    whole = make_run(EXACT, NOMINAL, POINT, rng())
    few = make_run(replace(EXACT, channels=("u_c", "u_s_L")), NOMINAL, POINT, rng())
    assert few.names == (*HEAD, "u_s_L", "u_c")
    np.testing.assert_array_equal(few["u_c"], whole["u_c"])
    with pytest.raises(RecordingError, match="got 'u_x'"):
        replace(EXACT, channels=("u_x",))


def test_a_planted_effect_is_in_the_forces_with_its_size() -> None:
    series = make_run(replace(EXACT, actives=(STIFF,)), NOMINAL, POINT, rng())
    model = build(NOMINAL.changed(POINT))
    found = force_residual(model, series)
    assert found.shares[:6].sum() > 0.999999
    moved = motion(model, series)
    np.testing.assert_allclose(forces(model, [STIFF], moved), moved.force, rtol=0, atol=1e-3)


def test_displacements_hold_the_nominal_error() -> None:
    own, factors = within_tolerance(NOMINAL, 0.02, rng())
    series = make_run(EXACT, own, POINT, rng())
    rig, nominal = build(own.changed(POINT)), build(NOMINAL.changed(POINT))
    assert abs(factors["e_sp"] - 1.0) > 1e-4
    sheet, built = ([errors_at(m, phase) for phase in series["phase"]] for m in (nominal, rig))
    e = np.array([a[0][0] - b[0][0] for a, b in zip(sheet, built, strict=True)]) * 1e-4
    rate = np.array([a[1][0] - b[1][0] for a, b in zip(sheet, built, strict=True)])
    k = waves(rig, series["phase"], 0.0).k[:, 0]
    spring = k * backlash(series["x_sp1_L"] + e, float(rig.half_backlash_m[0]))
    v = series["v_sp1_L"] + rate * rig.scales.velocity_m_per_s
    wanted = spring + rig.damping_n_s_per_m[0] * v
    np.testing.assert_allclose(series["F_sp1_L"], wanted, rtol=0, atol=1e-6 * wanted.max())
    unaware = k * backlash(series["x_sp1_L"], float(rig.half_backlash_m[0]))
    assert np.abs(unaware - spring).max() > 1e-3 * wanted.max()


def test_noise_and_converter_have_the_size_asked_for() -> None:
    clean = make_run(EXACT, NOMINAL, POINT, rng())
    noisy = make_run(replace(EXACT, noise_share=0.05), NOMINAL, POINT, rng())
    rough = make_run(replace(EXACT, bits=8), NOMINAL, POINT, rng())
    for name in ("F_rp2_R", "x_sp1_L", "u_c"):
        rms = np.sqrt(np.mean(clean[name] ** 2))
        assert np.std(noisy[name] - clean[name]) / rms == pytest.approx(0.05, rel=0.15)
        assert len(np.unique(rough[name])) <= 2**8 / 2 + 1
    assert np.array_equal(noisy["phase"], clean["phase"])


def test_a_sensor_effect_is_in_the_recording() -> None:
    gain = active(effect("sensor_gain"), Locus("rp", "1", "L"), {"gain": 1.5})
    shown = make_run(replace(EXACT, actives=(gain,)), NOMINAL, POINT, rng())
    true = make_run(EXACT, NOMINAL, POINT, rng())
    np.testing.assert_allclose(shown["F_rp1_L"], 1.5 * true["F_rp1_L"])


def test_hidden_effects_are_of_all_kinds_and_can_be_laid_out() -> None:
    model = build(NOMINAL)
    drawn = [hidden_effects(seed, model) for seed in range(150)]
    assert {len(one) for one in drawn} == {0, 1, 2}
    assert hidden_effects(3, model) == drawn[3]
    names = {one.effect.id for several in drawn for one in several}
    assert len(names) == 23
    for several in drawn:
        assert laws(model, several).kernel.n_active <= 2
        assert all(differs(one) for one in several)


def differs(one: Active) -> bool:
    sizes = [i for i, p in enumerate(one.effect.parameters) if p.neutral is not None]
    neutral = one.effect.neutral
    return not sizes or any(one.theta[i] != neutral[i] for i in sizes)


def test_the_command_writes_a_campaign_and_its_label_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, labels = tmp_path / "mine", tmp_path / "truth"
    asked = ["rig", "make", "--out", str(out), "--labels", str(labels), "--cycles", "5"]
    size = ["--runs", "2", "--held-out", "1", "--snr", "60"]
    assert main([*asked, *size, "--effect", "mean_stiffness@sp/2/L:factor=1.3"]) == 0
    campaign = read_campaign(out)
    assert [run.role for run in campaign.runs] == ["fit", "held_out"]
    assert campaign.noise_share == pytest.approx(1e-3)
    assert len(read_recording(campaign.runs[1].path).samples) == 120
    told = [file.read_bytes() for file in out.rglob("*") if file.is_file()]
    assert not any(b"stiffness" in text for text in told)
    text = (labels / "mine.json").read_bytes()
    assert hashlib.sha256(text).hexdigest() in capsys.readouterr().out
    label = json.loads(text)
    assert label["truth"] == ["mean_stiffness"]
    assert label["effects"][0]["locus"] == {"mesh": "sp", "planet": "2", "side": "L"}
    assert label["effects"][0]["parameters"]["factor"]["value"] == 1.3


def test_the_present_folder_gives_its_name_to_rig_and_label(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine").mkdir()
    monkeypatch.chdir(tmp_path / "mine")
    size = ["--runs", "2", "--held-out", "1", "--cycles", "5"]
    assert main(["rig", "make", "--out", ".", *size]) == 0
    assert [file.name for file in (tmp_path / "labels").iterdir()] == ["mine.json"]
    assert read_campaign(Path()).rig == "mine"


def test_a_later_day_is_the_same_rig_at_other_points(tmp_path: Path) -> None:
    plan = RigPlan(NOMINAL, runs=2, held_out=1, cycles=2, seed=5)
    first, later = (
        make_campaign(tmp_path / f"day_{day}", replace(plan, later=day), "rig") for day in (0, 1)
    )
    assert later["tolerance"] == first["tolerance"]
    assert later["operating_points"] != first["operating_points"]
    with pytest.raises(RecordingError, match="from 1 on"):
        replace(plan, later=-1)


@pytest.mark.parametrize(
    ("more", "rule"),
    [
        (["--effect", "squeak"], "no effect 'squeak'"),
        (["--effect", "runout@sp/1/L/x"], "write it like"),
        (["--effect", "runout:amplitude"], "write it like"),
        (["--effect", "runout", "--hidden"], "leave one out"),
        (["--held-out", "9"], "held_out below runs"),
    ],
)
def test_the_command_refuses_what_it_cannot_make(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], rule: str
) -> None:
    assert main(["rig", "make", "--out", str(tmp_path / "mine"), *more]) == 2
    assert rule in capsys.readouterr().err


def test_labels_never_lie_in_the_campaign(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    inside = ["--labels", str(tmp_path / "mine" / "labels")]
    assert main(["rig", "make", "--out", str(tmp_path / "mine"), *inside]) == 2
    assert "outside the campaign" in capsys.readouterr().err


def test_the_effects_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rig", "effects"]) == 0
    shown = capsys.readouterr().out
    assert "tooth_crack (mesh)" in shown
    assert "depth [-] 0 .. 0.95" in shown


def test_a_campaign_whose_label_could_not_be_written_is_not_begun(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, labels = tmp_path / "mine", tmp_path / "truth"
    labels.mkdir()
    (labels / "mine.json").write_text("{}", encoding="utf-8")
    assert main(["rig", "make", "--out", str(out), "--labels", str(labels), "--cycles", "5"]) == 2
    assert "mine.json exists" in capsys.readouterr().err
    assert not out.exists()
