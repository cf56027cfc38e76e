"""Verdicts from the evidence that is kept: the weights of the package come out of it again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from herringbone_sim.__main__ import main
from herringbone_sim.diagnosis import judge, judge_weights
from herringbone_sim.diagnosis.evidence import Candidate, Evidence
from herringbone_sim.diagnosis.examine import WORTH_SEEKING
from herringbone_sim.diagnosis.search import MIN_GAIN_PER_VALUE
from herringbone_sim.errors import AnalysisError
from herringbone_sim.practice.calibrate import calibrate, counted, judged
from herringbone_sim.practice.case_evidence import CaseEvidence, read_evidence, write_evidence
from herringbone_sim.practice.seeds import check_seeds

KEPT = Path(__file__).resolve().parents[1] / "data" / "evidence.jsonl"
PAGE = Path(__file__).resolve().parents[2] / "docs" / "diagnosis.md"


@pytest.fixture(scope="module")
def campaigns() -> list[CaseEvidence]:
    return read_evidence(KEPT)


def test_the_weights_of_the_package_come_out_of_the_evidence(
    campaigns: list[CaseEvidence],
) -> None:
    kept = json.loads(judge.FILE.read_text(encoding="utf-8"))
    found = calibrate(campaigns)
    assert found.penalties == kept["penalties"]
    for by_density, loss in enumerate(judge.LOSSES):
        frozen = judge.frozen_weights(bool(by_density))
        assert found.weights[loss] == pytest.approx(frozen, rel=1e-3, abs=1e-3)
    for stratum, row in kept["figures of campaigns left out"].items():
        assert found.figures[stratum] == pytest.approx(row, abs=0.01)


def test_seeds_of_the_evidence_are_told_by_series(campaigns: list[CaseEvidence]) -> None:
    """Each campaign is in a range, and what lies between two series may be drawn."""
    for one in campaigns:
        with pytest.raises(AnalysisError, match="frozen on"):
            check_seeds([one.seed], False)
    assert check_seeds([305_000, 400_000, 900_000], False).seeds == ()


def test_the_best_single_effect_of_a_pair_is_worth_seeking(campaigns: list[CaseEvidence]) -> None:
    """In every stored pair that shows: no first effect is passed over for being a moving part."""
    shares = []
    for case in campaigns:
        evidence = case.evidence
        none, *others = (c.chi2 for c in evidence.candidates if len(c.effects) < 2)
        gap = none - (1.0 + MIN_GAIN_PER_VALUE) * evidence.count
        if len(case.truth) == 2 and gap > 0.0 and others:
            shares.append((none - min(others)) / gap)
    assert len(shares) > 80
    assert min(shares) > WORTH_SEEKING


def test_what_chance_adds_is_no_excess() -> None:
    """Of 5,000 values 2 % is one standard deviation; of half a million, ten."""
    at = judge.NAMES.index("log excess left")
    for count, excess, is_noise in ((5e3, 0.03, True), (5e3, 0.08, False), (5e5, 0.03, False)):
        none = Candidate((), (), count, count, 0, 0.0, 1.0 + excess)
        _, table = judge.numbers(Evidence(count, (none,), {"none": 0.0}, {}))
        assert (table[0, at] == np.log(judge.LEAST)) == is_noise


def test_the_first_is_as_probable_as_it_is_right() -> None:
    """Of campaigns left out: within two standard deviations.

    There it was a third too probable while pairs of which one effect was tried taught nothing.
    """
    figures = json.loads(judge.FILE.read_text("utf-8"))["figures of campaigns left out"]
    for stratum, sds in (("all", 2.0), ("few sensors", 2.0)):
        row = figures[stratum]
        right = row["right first"]
        sd = np.sqrt(right * (1.0 - right) / row["campaigns"])
        assert abs(row["probability of the first"] - right) < sds * sd
    assert figures["all"]["calibration error"] < 0.06


def test_a_pair_of_which_one_effect_was_tried_teaches(campaigns: list[CaseEvidence]) -> None:
    """Such campaigns tell that with few sensors something may be beside an effect."""
    missed = [
        c
        for c in campaigns
        if len(c.truth) == 2
        and not any(sorted(d.effects) == sorted(c.truth) for d in c.evidence.candidates)
    ]
    taught = [judge_weights.labelled_campaign(c.evidence, c.truth).true.any() for c in missed]
    assert sum(taught) > 10
    few, more = (
        np.mean([_beside(c) for c in campaigns if (c.stratum[2] == "few") == on and c.truth])
        for on in (True, False)
    )
    assert few > more


def _beside(case: CaseEvidence) -> float:
    return sum(c.probability for c in judge.chances(case.evidence) if not c.whole)


def test_the_page_shows_the_figures_of_the_weights() -> None:
    """Its table and the share of a size, from the file that ``gap calibrate`` writes."""
    kept, page = json.loads(judge.FILE.read_text(encoding="utf-8")), PAGE.read_text("utf-8")
    figures = kept["figures of campaigns left out"]
    for row in figures.values():
        count, *others = (row[name] for name in ("campaigns", *list(row)[1:-1]))
        assert f"| {count:.0f} | " + " | ".join(f"{x:.3f}" for x in others) + " |" in page
    assert f"evidence of {figures['all']['campaigns']:.0f} practice campaigns" in page
    assert f"models miss of a size, {100.0 * kept['relative error of a size']:.1f} %" in page


def test_no_healthy_rig_is_blamed(campaigns: list[CaseEvidence]) -> None:
    healthy = [c for c in campaigns if not c.truth]
    assert len(healthy) > 20
    for one in healthy:
        assert judge.chances(one.evidence)[0].effects in ((), ("unknown",))


def test_nine_in_ten_intervals_hold_the_truth(campaigns: list[CaseEvidence]) -> None:
    """By the share that is fitted for it, and by a larger one more of them."""
    current = [c for c, on in zip(campaigns, counted(campaigns), strict=True) if on]
    error, sd, size = np.concatenate([np.array(c.sizes).reshape(-1, 3) for c in current]).T
    inside = [
        np.mean(np.abs(error) <= 1.645 * np.hypot(sd, r * size))
        for r in (judge.relative_error(), 3.0 * judge.relative_error())
    ]
    assert inside[0] == pytest.approx(0.9, abs=1.0 / len(error))
    assert inside[1] > inside[0]


def test_judged_again_each_campaign_gets_what_its_evidence_says(
    campaigns: list[CaseEvidence],
) -> None:
    right = np.array([judged(c) for c in campaigns])
    assert np.all(right[:, 0] <= 1.0 + 1e-9)
    assert right[:, 2].mean() > 0.75  # 0.05 by chance among some twenty effects


def test_evidence_goes_there_and_back(campaigns: list[CaseEvidence], tmp_path: Path) -> None:
    write_evidence(tmp_path / "again.jsonl", campaigns)
    assert read_evidence(tmp_path / "again.jsonl") == campaigns


def test_a_line_that_is_no_evidence_is_named(tmp_path: Path) -> None:
    (tmp_path / "bad.jsonl").write_text('{"seed": 1}\n', encoding="utf-8")
    with pytest.raises(AnalysisError, match="line 1"):
        read_evidence(tmp_path / "bad.jsonl")


def test_campaigns_that_do_not_count_are_too_few_for_figures(
    campaigns: list[CaseEvidence], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ten by squares, whose channels are judged by density in the one that is left to count."""
    squares = [c for c in campaigns if not c.evidence.by_density][:10]
    (few, *_) = (c for c in campaigns if c.evidence.by_density)
    alike = [replace(c, stratum=few.stratum) for c in squares]
    assert counted([*alike, few]).sum() == 1
    with pytest.raises(AnalysisError, match="needs 5 campaigns in its figures, got 1: run more"):
        calibrate([*alike, few])


def test_kinds_of_which_there_are_few_campaigns_take_the_weights_of_the_others(
    campaigns: list[CaseEvidence],
) -> None:
    squares = [c for c in campaigns if not c.evidence.by_density][:40]
    few = [c for c in campaigns if c.evidence.by_density][:3]
    alone, beside = calibrate(squares), calibrate([*squares, *few])
    assert set(alone.weights) == set(beside.weights) == {"squares"}
    assert beside.figures["all"]["campaigns"] >= 3.0


def test_the_folder_of_the_weights_is_made_before_they_are_fitted(tmp_path, monkeypatch, capsys):
    def fit(*_):
        raise AnalysisError("fitted")

    monkeypatch.setattr("herringbone_sim.cli.gap_calibrate.calibrate", fit)
    monkeypatch.setattr("herringbone_sim.cli.gap_calibrate.read_evidence", lambda _: [])
    words = ["gap", "calibrate", "--evidence", "e.jsonl", "--out"]
    assert main([*words, str(tmp_path / "new" / "w.json")]) == 2
    assert (tmp_path / "new").is_dir()
    (tmp_path / "file").touch()
    assert main([*words, str(tmp_path / "file" / "w.json")]) == 2
    assert "choose another --out" in capsys.readouterr().err
