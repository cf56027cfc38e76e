"""The scorer, on reports whose score is known by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from herringbone_sim.errors import AnalysisError, RecordingError
from herringbone_sim.practice.baselines import always_none, largest_residual
from herringbone_sim.practice.campaign import make_campaign
from herringbone_sim.practice.intervals import auroc, bootstrap, calibration_error, share
from herringbone_sim.practice.label import label_text, read_label, seal
from herringbone_sim.practice.outcome import outcome
from herringbone_sim.practice.plan import draw_plan
from herringbone_sim.practice.rig_model import MESHES
from herringbone_sim.practice.score import (
    METRICS,
    rows_of,
    strata,
    write_table,
)

SP2 = {"mesh": "sp", "planet": "2", "side": "L"}


def a_label(*effects, d=3.0, locus=None, parameters=None, **more):
    told = [
        {
            "effect": effect,
            "locus": locus or SP2,
            "parameters": parameters or {"factor": {"value": 1.1, "unit": "-"}},
        }
        for effect in effects
    ]
    base = {"truth": list(effects) or ["none"], "effects": told, "d_requested": d}
    return {**base, "snr_dB": 40.0, "channels": "full", "regime": "mostly periodic", **more}


def a_report(verdict, chances, closure=0.9, locus=None, parameters=None, **more):
    causes = [
        {"effect": effect, "locus": locus or SP2, "probability": p, "parameters": parameters or {}}
        for effect, p in chances.items()
    ]
    named = [] if verdict in ("none", "unknown", "ambiguous") else [verdict]
    base = {"verdict": verdict, "effects": named, "causes": causes, "ambiguous_with": []}
    return {**base, "gap": {"closure": closure}, **more}


def figure(rows, name, stratum="all"):
    found = [row for row in rows if row.figure == name and row.stratum == stratum]
    assert len(found) == 1
    return found[0]


def test_a_right_answer():
    one = outcome(
        a_label("mean_stiffness"),
        a_report(
            "mean_stiffness",
            {"mean_stiffness": 0.8, "none": 0.2},
            parameters={"factor": {"value": 1.11, "ci90": [1.09, 1.12]}},
        ),
    )
    assert (one.right, one.in_class, one.in_three, one.both) == (True, True, True, False)
    assert one.p_truth == pytest.approx(0.8)
    assert one.brier == pytest.approx(0.08)
    assert one.locus is True
    assert one.error == pytest.approx(0.1)
    assert one.covered == (True,)
    assert one.strata["d"] == "3"


def test_harmonics_are_measured_as_vectors_and_intervals_one_by_one():
    true = {"order": {"value": 2}, "cos": {"value": 0.03}, "sin": {"value": 0.04}}
    said = {
        "cos": {"value": 0.03, "ci90": [0.02, 0.04]},
        "sin": {"value": 0.05, "ci90": [0.045, 0.055]},
    }
    one = outcome(
        a_label("stiffness_harmonic", parameters=true),
        a_report("stiffness_harmonic", {"stiffness_harmonic": 1.0}, parameters=said),
    )
    assert one.error == pytest.approx(0.2)
    assert one.covered == (True, False)


def test_a_wrong_place_member_or_channel_is_wrong():
    wrong = {**SP2, "planet": "3"}
    p = {"mean_stiffness": 1.0}
    assert outcome(a_label("mean_stiffness"), a_report("x", p, locus=wrong)).locus is False
    true = {"depth": {"value": 0.2}, "member": {"value": "sun"}}
    for member, right in (("sun", True), ("planet", False)):
        said = {"depth": {"value": 0.2}, "member": {"value": member}}
        report = a_report("tooth_crack", {"tooth_crack": 1.0}, parameters=said)
        assert outcome(a_label("tooth_crack", parameters=true), report).locus is right
    for said, right in ((["F_sp2_L"], True), (["F_sp2_R"], False)):
        report = a_report("sensor_gain", {"sensor_gain": 1.0}, locus={"channels": said})
        label = a_label("sensor_gain", locus={**SP2, "channels": ["F_sp2_L"]})
        assert outcome(label, report).locus is right


def test_ambiguity_counts_as_the_class_not_as_first():
    report = a_report(
        "ambiguous",
        {"tooth_spall": 0.6, "tooth_crack": 0.4},
        ambiguous_with=["tooth_spall", "tooth_crack"],
    )
    one = outcome(a_label("tooth_crack"), report)
    assert (one.right, one.in_class, one.in_three, one.wrong_name) == (False, True, True, False)
    assert one.locus is None
    assert one.error is None


def test_of_an_empty_rig_any_name_and_unknown_are_false():
    label = a_label()
    for verdict, false in (("none", False), ("unknown", True), ("runout", True)):
        report = a_report(verdict, {"none": 0.5, "runout": 0.5})
        assert outcome(label, report).named is false
    open_to_none = a_report("ambiguous", {"none": 1.0}, ambiguous_with=["none", "runout"])
    assert outcome(label, open_to_none).named is False


def test_an_unknown_is_not_to_be_named_with_confidence():
    label = a_label("unknown")
    for p, wrong in ((0.9, True), (0.4, False)):
        report = a_report("runout", {"runout": p, "unknown": 1.0 - p})
        assert outcome(label, report).wrong_name is wrong
    assert outcome(label, a_report("unknown", {"unknown": 1.0})).right


def test_figures_over_cases_and_strata():
    sure = a_report("mean_stiffness", {"mean_stiffness": 1.0}, closure=0.8)
    pair = {**sure, "effects": ["mean_stiffness", "runout"]}
    cases = [
        (a_label(), a_report("none", {"none": 1.0})),
        (a_label(), a_report("runout", {"runout": 0.6, "none": 0.4})),
        (a_label("mean_stiffness"), sure),
        (a_label("mean_stiffness", d=10.0), sure),
        (a_label("runout", d=10.0), sure),
        (a_label("mean_stiffness", "runout"), pair),
        (a_label("mean_stiffness", "stagger"), pair),
        (a_label("unknown"), a_report("unknown", {"unknown": 0.7, "runout": 0.3})),
    ]
    found = [outcome(*case) for case in cases]
    rows = [row for name, some in [("all", found), *strata(found)] for row in rows_of(some, name)]
    values = {row.figure: row.result.value for row in rows if row.stratum == "all"}
    assert values["false attribution on none"] == 0.5
    assert values["right effect first"] == pytest.approx(4 / 5)
    assert values["both effects of a pair"] == 0.5
    assert values["mean probability on the truth"] == pytest.approx((1 + 0.4 + 4 + 0.7) / 8)
    assert values["Brier score"] == pytest.approx((0 + 0.72 + 0 + 0 + 2 + 0.18) / 6)
    assert values["AUROC unknown against known"] == 1.0
    assert values["confident wrong names on unknown"] == 0.0
    assert values["calibration error"] == pytest.approx((0.6 + 2.0 + 0.3) / 8)
    assert values["closure, median"] == pytest.approx(0.8)
    assert figure(rows, "right effect first", "d: 10").result.value == 0.5
    assert figure(rows, "right effect first", "truth: none").result.n == 0
    missed, met = figure(rows, "false attribution on none"), figure(rows, "both effects of a pair")
    assert (missed.met, met.met) == (False, False)
    assert figure(rows, "AUROC unknown against known").met is True
    assert {row.figure for row in rows} == {question.name for question in METRICS}


def test_wilson_interval_by_its_formula():
    none, half = share([False] * 50), share([True, False] * 50)
    assert none.low == pytest.approx(0.0, abs=1e-12)
    assert none.high == pytest.approx(3.8414588 / (50 + 3.8414588), rel=1e-6)
    assert (half.low, half.high) == pytest.approx((0.40383, 0.59617), abs=1e-5)
    assert math.isnan(share([]).value)


def test_bootstrap_covers_a_mean_and_orders_scores():
    rng = np.random.default_rng(0)
    values = rng.normal(2.0, 1.0, 400)
    found = bootstrap(values, lambda rows: float(np.mean(rows)))
    assert (found.high - found.low) / 2 == pytest.approx(1.96 / 20, rel=0.15)
    scores = np.column_stack([[0.1, 0.4, 0.35, 0.8], [0, 0, 1, 1]])
    assert auroc(scores) == pytest.approx(0.75)
    flat = np.column_stack([np.full(10, 0.7), [1] * 7 + [0] * 3])
    assert calibration_error(flat) == pytest.approx(0.0, abs=1e-12)


def test_a_report_that_breaks_the_schema_is_refused(tmp_path):
    with pytest.raises(AnalysisError, match="sum to 1"):
        outcome(a_label(), a_report("none", {"none": 0.4}))
    with pytest.raises(AnalysisError, match="must have 'causes'"):
        outcome(a_label(), {"verdict": "none"})


def test_a_sealed_label_is_scored_and_a_changed_one_refused(tmp_path):
    label = a_label("mean_stiffness")
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels" / "c0.json").write_text(label_text(label))
    file = tmp_path / "labels" / "c0.json"
    with pytest.raises(RecordingError, match="changed after"):
        read_label(file, "0" * 64)
    report = a_report("mean_stiffness", {"mean_stiffness": 1.0})
    cases = (outcome(read_label(file, seal(label)), report, "c0"),)
    assert cases[0].right
    rows = rows_of(cases, "all")
    write_table(rows, tmp_path / "score.csv")
    lines = (tmp_path / "score.csv").read_text().splitlines()
    assert lines[0].startswith("stratum,figure,value")
    assert len(lines) == len(rows) + 1
    assert any(",right effect first," in line for line in lines)


def test_baselines_name_what_stands_out():
    quiet = make_campaign(draw_plan(104, "none"))
    assert largest_residual(quiet.campaign, quiet.series)["verdict"] == "none"
    assert outcome(quiet.label, always_none(quiet.campaign)).right
    loud = list(quiet.series)
    for i, series in enumerate(loud):
        data = series.data.copy()
        data[:, series.names.index("F_rp3_R")] *= 1.5
        loud[i] = type(series)(series.times, data, series.names)
    report = largest_residual(quiet.campaign, loud)
    assert report["verdict"] == "mean_stiffness"
    assert report["causes"][0]["locus"] == {"mesh": "rp", "planet": "3", "side": "R"}
    few = make_campaign(draw_plan(104, "none", channels="few"))
    assert largest_residual(few.campaign, few.series)["verdict"] == "none"
    assert len(MESHES) == 12
