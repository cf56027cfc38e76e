"""The bench on withheld effects: seeds, seals before diagnosis, going on, the table."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from herringbone_sim.gap.attribution.fit import Fit
from herringbone_sim.gap.sensors.find import SensorCheck
from herringbone_sim.gap.verdict.evidence import Evidence
from herringbone_sim.practice.evidence import evidence_of, evidence_record
from test_practice_score import a_label, a_report

from herringbone_sim.__main__ import main
from herringbone_sim.effects.effect import Locus, active
from herringbone_sim.effects.registry import effect
from herringbone_sim.errors import AnalysisError, ParameterError, RecordingError
from herringbone_sim.gap.attribution.hypothesis import case
from herringbone_sim.gap.residuals.fusion import fuse
from herringbone_sim.practice import bench, trial
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.bench import check_seeds, name_of, read_seals, run_bench
from herringbone_sim.practice.campaign import make_campaign, run_plan
from herringbone_sim.practice.label import label_text, seal
from herringbone_sim.practice.outcome import outcome
from herringbone_sim.practice.plan import draw_plan
from herringbone_sim.practice.rivals import recalibration_alone, sparse_regression
from herringbone_sim.practice.seeds import parse_seeds
from herringbone_sim.practice.stored import read_bench, stored_evidence
from herringbone_sim.practice.table import (
    AIM,
    AT_ONE,
    aimed,
    bench_rows,
    table_markdown,
    write_cases,
)
from herringbone_sim.practice.trial import Setting, plan_of, remade

SETTING = Setting(truth="none")


def test_seeds_as_lists_and_ranges():
    assert parse_seeds("7, 3:6,5") == (3, 4, 5, 7)
    for wrong in ("", "3:3", "a:b", "-1", "1.5"):
        with pytest.raises(ParameterError, match="seeds"):
            parse_seeds(wrong)


def test_each_seed_draws_from_the_lists():
    setting = Setting(
        (20.0, 60.0),
        ("full", "few"),
        (1.0, 3.0),
        ("varied", "quiet"),
        "pair",
        ("white", "encoders"),
        "other",
    )
    plans = [plan_of(setting, seed) for seed in range(40)]
    assert {p.snr_dB for p in plans} == {20.0, 60.0}
    assert {p.channels for p in plans} == {"full", "few"}
    assert {p.d for p in plans} == {1.0, 3.0}
    assert {p.regime for p in plans} == {"varied", "quiet"}
    assert {p.noise.kind for p in plans} == {"white", "encoders"}
    laws = {c.shape["law"] for p in plans for c in p.causes if "law" in c.shape}
    assert laws == {"other"}
    again = plan_of(setting, 11)
    assert (again.d, again.causes) == (plans[11].d, plans[11].causes)
    with pytest.raises(ParameterError, match="one value or more"):
        Setting(d=())
    with pytest.raises(ParameterError, match="noise must be one of"):
        Setting(noise=("pink",))


def test_seeds_of_the_thresholds_are_refused(tmp_path):
    file = tmp_path / "calibration.json"
    file.write_text(json.dumps({"seeds": [[10, 20], [30, 31]], "limit": 0.1}))
    assert check_seeds((9, 20, 29, 31), False, file).text == "not seen while calibrating"
    with pytest.raises(AnalysisError, match=r"2 of the seeds, 19 \.\. 30"):
        check_seeds((19, 30, 40), False, file)
    seen = check_seeds((19, 30, 40), True, file)
    assert seen.seeds == (19, 30)
    assert seen.text == "seen while calibrating"
    file.write_text("{}")
    with pytest.raises(AnalysisError, match="must have seeds"):
        check_seeds((1,), False, file)


def test_a_campaign_is_made_again_from_its_label_and_no_other():
    setting = Setting(truth="mean_stiffness", d=(3.0,))
    plan = plan_of(setting, 8)
    text = label_text(run_plan(plan, ((plan.causes[0].sized(0.07), 3.1),)).label)
    label = json.loads(text)
    made = remade(8, setting, label, seal(label))
    assert label_text(made.label) == text
    prepared = as_prepared(made)
    assert [run.role for run in prepared.runs] == ["fit"] * 5 + ["held_out"] * 3
    force = made.series[2].columns(tuple(f"F_{m}" for m in prepared.meshes.names))
    np.testing.assert_array_equal(prepared.runs[2].F.values, force)
    assert prepared.runs[0].F.sigma[0] == pytest.approx(
        0.01 * np.sqrt(np.mean(prepared.runs[0].F.values[:, 0] ** 2)), rel=1e-3
    )
    label["effects"][0]["size"] *= 1.01
    with pytest.raises(RecordingError, match="as it was sealed"):
        remade(8, setting, label, seal(json.loads(text)))


@contextmanager
def _threads(*_):
    with ThreadPoolExecutor(1) as executor:
        yield executor, 1


def _texts(seed, setting, label, sealed):
    found = a_report("none", {"none": 0.9, "unknown": 0.1})
    return {
        "baselines.json": json.dumps({"always none": found}),
        "case.json": json.dumps({"sources": trial.sources(), "seconds": 2.0}),
        "report.json": json.dumps(found),
    }


FRESH = (900_001, 900_002, 900_003, 900_004)  # no thresholds were set on them


def test_labels_are_sealed_first_and_a_stopped_bench_goes_on(tmp_path, monkeypatch, capsys):
    made, diagnosed, said = [], [], []

    def label(seed, setting):
        made.append(seed)
        return (
            (None, "left the range") if seed == FRESH[2] else (label_text(a_label(seed=seed)), "")
        )

    def diagnosis(seed, setting, label, sealed):
        seals = read_seals(tmp_path)
        assert set(seals) == {
            name_of(s) for s in FRESH if s != FRESH[2]
        }  # all, before the first one
        assert seals[name_of(seed)] == sealed == seal(label)
        assert said
        if len(diagnosed) == 2:
            raise KeyboardInterrupt
        diagnosed.append(seed)
        return _texts(seed, setting, label, sealed)

    monkeypatch.setattr(bench, "pool", _threads)
    monkeypatch.setattr(bench, "truth_of", label)
    monkeypatch.setattr(bench, "trial", diagnosis)
    monkeypatch.setattr(bench, "AHEAD", 1)
    seen = check_seeds(FRESH, False)
    with pytest.raises(KeyboardInterrupt):
        run_bench(tmp_path, FRESH, SETTING, seen, say=said.append)
    assert diagnosed == list(FRESH[:2])
    assert not list(tmp_path.rglob("*.partial"))
    diagnosed.clear()
    run_bench(tmp_path, FRESH, SETTING, seen, say=said.append)
    assert diagnosed == [FRESH[3]]
    assert made == list(FRESH)
    found = read_bench(tmp_path)
    assert (len(found.cases), found.sealed, found.left_out) == (3, 3, 1)
    assert len(found.sources) == 1
    with pytest.raises(AnalysisError, match="choose another"):
        run_bench(tmp_path, FRESH[:1], Setting(), seen, say=said.append)
    assert main(["gap", "bench", "--table", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert "3 campaigns diagnosed of 3 sealed" in told
    assert (tmp_path / "table.csv").is_file()
    changed = tmp_path / "labels" / f"{name_of(FRESH[1])}.json"
    changed.write_text(changed.read_text().replace('"none"', '"runout"'))
    assert main(["gap", "bench", "--table", str(tmp_path)]) == 2


def test_a_diagnosis_that_fails_is_wrong_whatever_the_truth(monkeypatch):
    def breaks(*_, **__):
        raise ValueError("singular")

    monkeypatch.setattr(trial, "diagnose", breaks)
    setting = Setting(truth="none")
    label = json.loads(trial.truth_of(104, setting)[0])
    texts = trial.trial(104, setting, label, seal(label))
    assert list(texts)[-1] == "report.json"
    assert "singular" in json.loads(texts["case.json"])["failure"]
    report = json.loads(texts["report.json"])
    for truth in ((), ("runout",), ("unknown",)):
        one = outcome(a_label(*truth), report)
        assert not any((one.right, one.in_class, one.in_three, one.held))
        assert one.named
        assert one.failed == "ValueError: singular"


def stored(folder, pairs):
    """A bench folder of labels and reports."""
    (folder / "labels").mkdir()
    seals = {}
    for i, (label, report) in enumerate(pairs):
        name = name_of(i)
        (folder / "labels" / f"{name}.json").write_text(label_text(label))
        seals[name] = seal(label)
        place = folder / "reports" / name
        place.mkdir(parents=True)
        (place / "report.json").write_text(json.dumps(report))
        rival = a_report("none", {"none": 1.0}, closure=0.0)
        (place / "baselines.json").write_text(json.dumps({"always none": rival}))
        (place / "case.json").write_text(json.dumps({"sources": "a", "seconds": 9.0 + i}))
    (folder / "seals.json").write_text(json.dumps(seals))
    note = {"setting": {"d": [3.0]}, "seeds": [0, 1], "calibration": None}
    (folder / "bench.json").write_text(json.dumps(note))


def an_effect(name, d, **more):
    label = a_label(name, d=d, **more)
    label["effects"][0] |= {"d": d, "internal": name}
    return label


def test_table_with_targets_baselines_reasons_and_strata(tmp_path):
    right = a_report("runout", {"runout": 1.0}, closure=0.95)
    wrong = a_report("runout", {"runout": 0.8, "stagger": 0.2}, closure=0.2)
    pairs = [(an_effect("runout", 3.0), right)] * 3
    pairs += [(an_effect("stagger", 10.0), wrong), (an_effect("runout", 1.0), right)]
    pairs += [(a_label(), a_report("none", {"none": 1.0}))]
    pairs += [(an_effect("runout", 3.0, snr_dB=20.0), wrong)]
    stored(tmp_path, pairs)
    found = read_bench(tmp_path)
    assert len(aimed(found.cases)) == 5  # neither d = 1 nor 20 dB
    rows = {(row.stratum, row.figure): row for row in bench_rows(found)}
    first = rows[AIM, "right effect first"]
    assert first.result.value == pytest.approx(3 / 4)
    assert (first.met, first.least) == (False, 0.90)
    assert rows[AIM, "false attribution on none"].met is True
    one = rows[AT_ONE, "right effect first"]
    assert (one.result.n, one.least, one.met) == (1, 0.75, True)
    assert rows[f"{AIM}; always none", "right effect first"].result.value == 0.0
    assert rows["snr: 20 dB", "right effect first"].result.value == 1.0
    assert rows["white x not said x full x 3", "right effect first"].result.n == 4
    text = table_markdown(found)
    assert "| white x not said x full x 10 | 1" in text
    assert "stagger -> runout (1)" in text
    assert "MISSED" in text
    assert "; d: 10 (0.000, n = 1)" in text
    assert "a diagnosis took 12 s in the median, 15 s at most" in text
    line = next(one for one in text.splitlines() if one.startswith("| runout"))
    assert [cell.strip() for cell in line.split("|")[2:5]] == ["5", "5", "5"]
    write_cases(found.cases, tmp_path / "cases.csv")
    with (tmp_path / "cases.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [row["reached"] for row in table[:4]] == ["3.0", "3.0", "3.0", "10.0"]
    with pytest.raises(AnalysisError, match="finished campaigns"):
        read_bench(tmp_path / "none")


def a_fit(name, locus, gain):
    one = active(effect(name), locus)
    three = np.array([1.0, 2.0, 3.0])
    return Fit((one,), np.ones(6), np.array([0.1]), 1.5, 1.6, three, three, np.array(gain))


def test_evidence_comes_back_from_plain_data(tmp_path):
    rng = np.random.default_rng(0)
    fits = [a_fit("mean_stiffness", Locus("sp"), rng.normal(size=500)) for _ in range(3)]
    pair = a_fit("stagger", Locus(side="L"), rng.normal(size=500))
    check = SensorCheck(1.0, float("nan"), float("nan"), 1.0, ())
    whole = Evidence(check, (), fits[0], (), tuple(fits[:2]), (pair,), (), 0.5, {"a": 1.0}, None)
    text = json.dumps(evidence_record(whole))
    assert len(text) < 10_000
    stored(tmp_path, [(a_label("stagger"), a_report("none", {"none": 1.0}))] * 2)
    (tmp_path / "reports" / name_of(1) / "evidence.json").write_text(text)
    [(name, label, back)] = stored_evidence(tmp_path)
    assert (name, label["truth"]) == (name_of(1), ["stagger"])
    assert back.fits[1].actives == fits[1].actives
    assert back.by_force == {"a": 1.0}
    assert np.isnan(back.check.after)
    for i, one in enumerate((*fits[:2], pair)):
        for j, other in enumerate((*fits[:2], pair)):
            held = (*back.fits, *back.pairs)
            assert held[i].gain @ held[j].gain == pytest.approx(one.gain @ other.gain)
    np.testing.assert_array_equal(back.pairs[0].per_run, pair.per_run)
    with pytest.raises(AnalysisError, match="diagnose again"):
        evidence_of({"is": "os:system", "has": {}})


def test_rivals_name_a_profile_and_tell_their_closure():
    campaign = as_prepared(make_campaign(draw_plan(12, "profile_error", 10.0)))
    cases = [case(run, fuse(run)) for run in campaign.of_role("fit")[:2]]
    held = [case(run, fuse(run)) for run in campaign.of_role("held_out")[:1]]
    nominal = SimpleNamespace(chi2=9.0, factors=np.ones(6))
    evidence = SimpleNamespace(cases=tuple(cases), nominal=nominal)
    assert recalibration_alone("rig", evidence, held)["verdict"] == "unknown"
    report = sparse_regression("rig", evidence, held)
    assert report["verdict"] == "profile_error"
    assert report["gap"]["closure"] > 0.5


ORPHAN = """
import os, signal
from herringbone_sim.practice.pool import pool
if __name__ == "__main__":
    with pool(1) as (executor, _):
        print(executor.submit(os.getpid).result(), flush=True)
        signal.pause()
"""


def test_workers_end_with_a_bench_that_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "orphan.py"
    script.write_text(ORPHAN, encoding="utf-8")
    parent = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    worker = int(parent.stdout.readline())
    assert _alive(worker)
    parent.kill()
    parent.wait()
    until = time.monotonic() + 30.0
    while _alive(worker) and time.monotonic() < until:
        time.sleep(0.05)
    assert not _alive(worker)


def _alive(process: int) -> bool:
    """Whether a process runs; one that ended and was not collected has no command line."""
    try:
        return bool(Path(f"/proc/{process}/cmdline").read_bytes())
    except OSError:
        return False
