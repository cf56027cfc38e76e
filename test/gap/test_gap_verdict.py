"""From chances to a verdict and its report."""

from __future__ import annotations

import copy
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from gap_support import a_report, check_report

from herringbone_sim.core.parameters import Parameters
from herringbone_sim.diagnosis.fits import FittedExplanation
from herringbone_sim.diagnosis.judge import Chance
from herringbone_sim.diagnosis.score import Score
from herringbone_sim.effects.effect import active
from herringbone_sim.effects.registry import effect
from herringbone_sim.gap.calibrated_fit import Calibrated
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.gap_by_run import metric_of
from herringbone_sim.gap.verdict.decide import NamedExplanation, Verdict, decide
from herringbone_sim.gap.verdict.undecidable import undecidable


def verdict_of(*told: tuple[tuple[str, ...], float]) -> Verdict:
    """The verdict of explanations by their effects; none and unknown have no option."""
    chances = sorted((Chance(e, None, p) for e, p in told), key=lambda c: -c.probability)
    options = {
        i: NamedExplanation(tuple(active(effect(name)) for name in c.effects))
        for i, c in enumerate(chances)
        if c.effects and "unknown" not in c.effects
    }
    return decide(chances, options, "force_law")


def ids(option: NamedExplanation | None) -> tuple[str, ...]:
    return () if option is None else tuple(a.effect.id for a in option.actives)


def test_what_is_likelier_than_all_others_is_named() -> None:
    found = verdict_of((("runout",), 0.8), (("stagger",), 0.15), ((), 0.05))
    assert (found.verdict, found.effects) == ("runout", ("runout",))
    assert ids(found.chosen) == ("runout",)
    assert ids(found.runner_up) == ("stagger",)
    assert sum(found.probabilities.values()) == pytest.approx(1.0)


def test_none_has_no_effect_and_no_rival() -> None:
    found = verdict_of((("runout",), 0.1), ((), 0.9))
    assert (found.verdict, found.effects) == ("none", ())
    assert (found.chosen, found.runner_up) == (None, None)


def test_rivals_without_a_favourite_are_ambiguous() -> None:
    told = ((("runout",), 0.44), (("stagger",), 0.4), (("tooth_crack",), 0.01), ((), 0.15))
    found = verdict_of(*told)
    assert found.verdict == "ambiguous"
    assert found.ambiguous_with == ("runout", "stagger")


def test_a_pair_names_both_and_is_not_its_own_rival() -> None:
    found = verdict_of(
        (("mean_stiffness", "runout"), 0.9), (("mean_stiffness",), 0.06), (("stagger",), 0.04)
    )
    assert set(found.effects) == {"mean_stiffness", "runout"}
    assert ids(found.runner_up) == ("stagger",)


def test_both_effects_of_a_sure_pair_are_named_and_no_class() -> None:
    """Each has half of the probability of the pair, so that neither is likelier than the other."""
    found = verdict_of((("stagger", "runout"), 0.99), (("unknown",), 0.01))
    assert (found.verdict, found.effects) == ("stagger", ("stagger", "runout"))
    assert found.ambiguous_with == ()
    made = a_report(found).to_dict()
    assert check_report(made) == []
    assert [cause["effect"] for cause in made["causes"][:2]] == ["stagger", "runout"]


def test_an_effect_of_all_likely_pairs_is_named() -> None:
    pairs = ((("runout", "stagger"), 0.45), (("runout", "tooth_crack"), 0.4))
    found = verdict_of(*pairs, (("unknown",), 0.15))
    assert (found.verdict, found.effects) == ("runout", ("runout", "stagger"))


def test_no_second_effect_is_named_that_is_hardly_there() -> None:
    """The likeliest explanation with the effect decides, without what is unknown beside it."""
    beside = ((("runout", "unknown"), 0.9), (("runout", "stagger"), 0.04))
    found = verdict_of(*beside, (("runout",), 0.03), (("unknown",), 0.03))
    assert (found.verdict, found.effects) == ("runout", ("runout",))
    assert ids(found.chosen) == ("runout",)


def test_pairs_with_nothing_in_common_are_ambiguous() -> None:
    pairs = ((("runout", "stagger"), 0.45), (("tooth_crack", "pin_position"), 0.4))
    found = verdict_of(*pairs, (("unknown",), 0.15))
    assert found.verdict == "ambiguous"
    assert set(found.ambiguous_with) == {"runout", "stagger", "tooth_crack", "pin_position"}


def test_unknown_keeps_what_comes_nearest() -> None:
    found = verdict_of((("unknown",), 0.7), (("runout",), 0.2), ((), 0.1))
    assert (found.verdict, found.effects) == ("unknown", ())
    nothing = PreparedCampaign("rig", Parameters(), (), ())
    said = undecidable(nothing, Calibrated((), np.ones(6), None), found)
    assert "no effect of the catalogue explains the gap: what it comes from is open" in said
    assert "nearest comes runout, but it leaves too much" in said


def test_an_effect_with_something_beside_it_is_named_alone_and_half_is_unknown() -> None:
    beside = ("runout", "unknown")
    found = verdict_of((beside, 0.5), (("runout",), 0.3), (("stagger",), 0.15), ((), 0.05))
    assert (found.verdict, found.effects) == ("runout", ("runout",))
    assert ids(found.chosen) == ("runout",)
    assert ids(found.runner_up) == ("stagger",)
    assert found.probabilities["runout"] == pytest.approx(0.55)
    assert found.probabilities["unknown"] == pytest.approx(0.25)
    assert "unknown" not in found.best
    nothing = PreparedCampaign("rig", Parameters(), (), ())
    said = undecidable(nothing, Calibrated((), np.ones(6), None), found)
    assert "something beside runout that was not found is not excluded: probability 50%" in said
    assert not any("outside the catalogue" in one for one in said)
    made = a_report(found).to_dict()
    assert check_report(made) == []
    assert made["hypotheses"][0]["effects"] == ["runout", "unknown"]


def test_what_is_beside_an_effect_is_no_class_and_no_verdict() -> None:
    """The effect alone is what the verdict takes, and unknown is not named beside another."""
    found = verdict_of((("unknown",), 0.45), (("runout", "unknown"), 0.3), (("runout",), 0.25))
    assert (found.verdict, found.effects, found.ambiguous_with) == ("unknown", (), ())


@pytest.mark.parametrize("name", ["none", "unknown", "stagger"])
def test_report_follows_the_contract(name: str) -> None:
    effects = () if name == "none" else (name,)
    verdict = verdict_of((effects, 0.8), (("runout",), 0.2))
    assert verdict.verdict == name
    good = a_report(verdict).to_dict()
    assert check_report(good) == []
    assert good["gap"]["closure"] == pytest.approx(0.9)
    bad = copy.deepcopy(good)
    bad["causes"][0]["probability"] += 0.1
    assert any("sum to 1" in rule for rule in check_report(bad))
    del good["gap"]
    assert check_report(good) == ["gap is missing"]


def test_a_clock_is_told_with_the_channel_that_it_is() -> None:
    drift = active(effect("clock_drift"), values={"ppm": 200.0})
    option = NamedExplanation((drift,), (((190.0, 210.0),),))
    verdict = decide([Chance(("clock_drift",), None, 1.0)], {0: option}, "consistency")
    told = a_report(verdict).to_dict()["causes"]
    assert told[0]["effect"] == "clock_drift"
    assert told[0]["parameters"]["channels"]["value"] == ["t"]
    assert told[0]["parameters"]["ppm"]["ci90"] == [190.0, 210.0]


def left(**rows: float) -> FittedExplanation:
    """An explanation that leaves so many squares of each observation."""
    score = SimpleNamespace(chi2_by_row={o: np.array([[value]]) for o, value in rows.items()})
    return FittedExplanation((), cast("Score", score))


def test_the_residual_that_counts_is_one_that_the_explanation_lowers() -> None:
    counts = {"force_law": 100.0, "consistency": 400.0}
    none = left(force_law=900.0, consistency=401.0)
    assert metric_of(none, left(force_law=120.0, consistency=400.0), counts) == "force_law"
    assert metric_of(none, left(force_law=900.0, consistency=390.0), counts) == "consistency"


def test_where_nothing_is_lowered_the_residual_above_its_noise_counts() -> None:
    counts = {"force_law": 100.0, "consistency": 4000.0}
    none = left(force_law=900.0, consistency=3990.0)
    worse = left(force_law=930.0, consistency=3990.0)
    assert metric_of(none, worse, counts) == metric_of(none, None, counts) == "force_law"
