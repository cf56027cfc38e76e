"""The bench on withheld effects: seeds, seals before diagnosis, going on, the table."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_practice_score import a_label, a_report

from herringbone_sim.__main__ import main
from herringbone_sim.diagnosis.evidence import Candidate, Evidence
from herringbone_sim.diagnosis.judge import HALF_90
from herringbone_sim.diagnosis.parallel import cores
from herringbone_sim.errors import AnalysisError, ParameterError, RecordingError
from herringbone_sim.practice import bench, seeds, trial
from herringbone_sim.practice.arrays import as_prepared
from herringbone_sim.practice.baselines import rivals
from herringbone_sim.practice.bench import name_of, read_seals, run_bench
from herringbone_sim.practice.campaign import run_plan
from herringbone_sim.practice.label import label_text, seal
from herringbone_sim.practice.outcome import RELATIVE_ERROR, outcome
from herringbone_sim.practice.pool import pool
from herringbone_sim.practice.seeds import check_seeds, parse_seeds
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
from herringbone_sim.practice.true_effects import size_errors
from herringbone_sim.sweeps import cluster

SETTING = Setting(truth="none")


def test_seeds_as_lists_and_ranges():
    assert parse_seeds("7, 3:6,5") == (3, 4, 5, 7)
    for wrong in ("", "3:3", "9:7,5", "a:b", "-1", "1.5"):
        with pytest.raises(ParameterError, match="seeds"):
            parse_seeds(wrong)
    for many in ("0:10000000000", "5,0:1000000", f"0:{'9' * 400}"):
        with pytest.raises(ParameterError, match="up to 1000000 seeds"):
            parse_seeds(many)


def test_each_seed_draws_from_the_lists():
    setting = Setting(
        (20.0, 60.0),
        ("full", "few"),
        (1.0, 3.0),
        ("varied", "quiet"),
        "pair",
        ("white", "encoders"),
        "other",
        (10, 24),
    )
    plans = [plan_of(setting, seed) for seed in range(40)]
    assert {p.snr_dB for p in plans} == {20.0, 60.0}
    assert {p.channels for p in plans} == {"full", "few"}
    assert {p.d for p in plans} == {1.0, 3.0}
    assert {p.regime for p in plans} == {"varied", "quiet"}
    assert {p.noise.kind for p in plans} == {"white", "encoders"}
    assert {p.samples_per_cycle for p in plans} == {10, 24}
    laws = {c.shape["law"] for p in plans for c in p.causes if "law" in c.shape}
    assert laws == {"other"}
    again = plan_of(setting, 11)
    assert (again.d, again.causes) == (plans[11].d, plans[11].causes)
    with pytest.raises(ParameterError, match="one value or more"):
        Setting(d=())
    with pytest.raises(ParameterError, match="noise must be one of"):
        Setting(noise=("pink",))
    with pytest.raises(ParameterError, match="4 or more"):
        Setting(samples_per_cycle=(2,))


def test_seeds_of_the_thresholds_are_refused(tmp_path, monkeypatch):
    file = tmp_path / "calibration.json"
    monkeypatch.setattr(seeds, "FILE", file)
    file.write_text(json.dumps({"seeds": [[10, 20], [30, 31]], "limit": 0.1}))
    assert check_seeds((9, 20, 29, 31), False).seeds == ()
    with pytest.raises(AnalysisError, match=r"2 of the seeds, 19 \.\. 30"):
        check_seeds((19, 30, 40), False)
    seen = check_seeds((19, 30, 40), True)
    assert seen.seeds == (19, 30)
    file.write_text("{}")
    with pytest.raises(AnalysisError, match="must have seeds"):
        check_seeds((1,), False)


def test_a_campaign_is_made_again_from_its_label_and_no_other():
    setting = Setting(truth="mean_stiffness", d=(3.0,))
    plan = plan_of(setting, 8)
    text = label_text(run_plan(plan, ((plan.causes[0].sized(0.07), 3.1),)).label)
    label = json.loads(text)
    made = remade(8, setting, label, seal(label))
    assert label_text(made.label) == text
    prepared = as_prepared(made)
    assert [run.role for run in prepared.runs] == ["fit"] * 5 + ["held_out"] * 3
    force = made.series[2].columns(tuple(f"F_{m}" for m in prepared.nominal.layout.meshes))
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
    monkeypatch.setattr(bench, "label_of_seed", label)
    monkeypatch.setattr(bench, "diagnose_case", diagnosis)
    monkeypatch.setattr(cluster, "AHEAD", 1)
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
    note = tmp_path / "bench.json"
    kept = json.loads(note.read_text())
    older = {k: v for k, v in kept["setting"].items() if k != "samples_per_cycle"}
    note.write_text(json.dumps({**kept, "setting": older}))
    run_bench(tmp_path, FRESH, SETTING, seen, say=said.append)  # of before there was a choice
    note.write_text(json.dumps({**kept, "setting": 3}))
    with pytest.raises(AnalysisError, match="holds a bench with 3"):
        run_bench(tmp_path, FRESH, SETTING, seen, say=said.append)
    note.write_text(json.dumps(kept))
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
    label = json.loads(trial.label_of_seed(104, setting)[0])
    texts = trial.diagnose_case(104, setting, label, seal(label))
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
    (folder / "labels").mkdir(parents=True)
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


def test_several_benches_are_told_side_by_side(tmp_path, capsys):
    """A row each, of rigs of d >= 3: what is smaller counts in neither."""
    right = a_report("runout", {"runout": 1.0})
    small, large = an_effect("runout", 1.0), an_effect("runout", 3.0)
    healthy = a_report("none", {"none": 1.0})
    first = [(large, right), (an_effect("stagger", 3.0), right), (small, right)]
    stored(tmp_path / "shafts", [*first, (a_label(), healthy)])
    stored(tmp_path / "pins", [(a_label(), right), (a_label(), healthy)])
    folders = [str(tmp_path / name) for name in ("shafts", "pins")]
    assert main(["gap", "bench", "--table", *folders]) == 0
    lines = [one.split("|") for one in capsys.readouterr().out.splitlines() if one[:1] == "|"]
    head = [cell.strip() for cell in lines[0]]
    rows = {Path(line[1].strip()).name: dict(zip(head, line, strict=True)) for line in lines[2:]}
    assert rows["shafts"]["campaigns"].strip() == "3"
    assert rows["shafts"]["right or in the named class"].split()[0] == "0.500"
    assert rows["shafts"]["healthy called none"].split()[0] == "1.000"
    assert rows["pins"]["healthy called none"].split()[0] == "0.500"
    assert rows["pins"]["right or in the named class"].strip() == "-"
    assert rows["all"]["healthy called none"].split()[0] == "0.667"
    note = {"setting": {}, "seeds": [300000], "calibration": None}  # the weights were fitted on it
    (tmp_path / "pins" / "bench.json").write_text(json.dumps(note))
    assert main(["gap", "bench", "--table", *folders]) == 2
    assert main(["gap", "bench", "--calibration-family", "--table", *folders]) == 0
    marked = [one for one in capsys.readouterr().out.splitlines() if "SEEN WHILE" in one]
    assert [one.split()[1].endswith("pins") for one in marked] == [True]


def candidate(chi2, *effects, in_sample=None, size=0):
    places = tuple("all/all/all" for _ in effects)
    left = chi2 if in_sample is None else in_sample
    return Candidate(effects, places, chi2, left, size, 0.0, left / 1000.0)


GAP = Evidence(
    1000.0,
    (
        candidate(9000.0),
        candidate(1010.0, "stagger", in_sample=1005.0, size=1),
        candidate(1020.0, "profile_error", in_sample=1004.0, size=16),
        candidate(1012.0, "runout", "stagger", in_sample=1003.0, size=7),
    ),
    {"none": 8000.0, "single": 3.0, "pair": 2.0},
    {"profile_error": 1100.0, "stagger": 1200.0, "runout": 8900.0},
)


def test_evidence_comes_back_from_plain_data(tmp_path):
    stored(tmp_path, [(a_label("stagger"), a_report("none", {"none": 1.0}))] * 2)
    text = json.dumps(GAP.written())
    (tmp_path / "reports" / name_of(1) / "evidence.json").write_text(text)
    case = tmp_path / "reports" / name_of(1) / "case.json"
    with pytest.raises(AnalysisError, match="must have the relative error of a size"):
        list(stored_evidence(tmp_path))
    case.write_text(json.dumps({RELATIVE_ERROR: 0.03}))
    [(label, report, back, relative_error)] = stored_evidence(tmp_path)
    assert (label["truth"], report["verdict"]) == (["stagger"], "none")
    assert (back, relative_error) == (GAP, 0.03)
    place = tmp_path / "reports" / name_of(1) / "evidence.json"
    place.write_text(text.replace('"chi2"', '"energy"'))
    with pytest.raises(AnalysisError, match=r"must be the evidence of a campaign, got .*energy"):
        list(stored_evidence(tmp_path))


def test_the_model_error_of_an_interval_is_taken_out_of_what_is_fitted():
    """Half of the interval is 1.645 root(sd^2 + (0.06 of the size)^2)."""
    true, found, sd = 2e-5, 2.1e-5, 1e-6
    half = HALF_90 * np.hypot(sd, 0.06 * found)
    place = {"mesh": "all", "planet": "all", "side": "all"}
    size = {"value": found, "unit": "m", "ci90": [found - half, found + half]}
    told = {"effect": "runout", "locus": place, "parameters": {"amplitude": true}}
    cause = {"effect": "runout", "locus": place, "probability": 1.0} | {
        "parameters": {"amplitude": size}
    }
    [(error, left, of)] = size_errors({"effects": [told]}, {"causes": [cause]}, 0.06)
    assert error == pytest.approx(found - true)
    assert left == pytest.approx(sd)
    assert of == true


def test_rivals_name_what_their_rule_says():
    told = {name: report["verdict"] for name, report in rivals("rig", GAP).items()}
    assert told == {
        "recalibration alone": "unknown",  # the calibrated machine leaves nine times the noise
        "in-sample BIC": "stagger",  # a square less is not worth a second effect
        "sparse regression": "profile_error",  # the linear term that takes most off
    }
    quiet = replace(GAP, candidates=(candidate(1010.0), *GAP.candidates[1:]), screened={})
    assert {r["verdict"] for r in rivals("rig", quiet).values()} == {"none"}
    assert {r["verdict"] for r in rivals("rig", None).values()} == {"none"}


def test_workers_share_the_cores_of_the_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("herringbone_sim.practice.pool.cores", lambda: 6)
    for workers, each in ((2, 3), (4, 1), (8, 1)):
        with pool(workers) as (executor, _):
            here = len(os.sched_getaffinity(0))
            assert executor.submit(cores).result() == min(here, each)


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


@pytest.mark.parametrize(
    "wrong", [{"channels": ("full", "fulll")}, {"regime": ("varied", "loud")}, {"law": "mine"}]
)
def test_each_name_of_a_setting_is_known(wrong) -> None:  # type: ignore[no-untyped-def]
    """Before a seed is drawn, so that no folder is begun."""
    with pytest.raises(ParameterError, match="must be one of"):
        Setting(**wrong)
