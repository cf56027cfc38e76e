"""Which explanations are fitted beside those that the linear screen ranks first."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from herringbone_sim.diagnosis.fits import FittedExplanation, with_unscreened
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.diagnosis.products import Coefficient


def one(
    effect: str, law: str | None = None, linear: bool = True, place: str = "all"
) -> Hypothesis:
    own = Coefficient("size", 1.0, np.inf, {}, scales_with_effect=linear)
    return Hypothesis(effect, (("law", law),) if law else (), place, (own,), 1)


def screened(losses: list[tuple[Hypothesis, float]], fitted: int) -> list[FittedExplanation]:
    """Fits of those in a list after its first ``fitted``, all of which were fitted before."""

    def refined(coefficients: Any, start: np.ndarray) -> Any:
        loss = next(loss for h, loss in losses if h.coefficients is coefficients)
        return SimpleNamespace(loss=loss, mean=start)

    search: Any = SimpleNamespace(base=(), refined=refined, settled=lambda score: score)
    ranked = [(float(i), h, np.zeros(1)) for i, (h, _) in enumerate(losses)]
    before = [
        FittedExplanation((h,), refined(h.coefficients, np.zeros(1))) for h, _ in losses[:fitted]
    ]
    return list(with_unscreened(search, ranked, before))


def test_what_is_not_linear_is_fitted_at_its_best_place() -> None:
    """The screen puts it last, and once for each effect."""
    ring, other = one("ring", linear=False), one("ring", linear=False, place="left")
    found = screened(
        [(one("stiffness"), 5.0), (one("friction"), 9.0), (ring, 1.0), (other, 0.5)], 1
    )
    assert [f.hypotheses[0].effect for f in found] == ["ring", "stiffness"]
    assert found[0].hypotheses[0] is ring


def test_the_other_law_of_the_best_effect_is_fitted_once() -> None:
    """Whether the screen had it fitted or not; an explanation that stands twice counts twice."""
    by_load, contact = one("damping", "load"), one("damping", "contact")
    elsewhere = one("damping", "contact", place="left")
    for fitted in (1, 2):
        found = screened([(by_load, 4.0), (contact, 2.0), (elsewhere, 1.0)], fitted)
        assert [f.hypotheses[0] for f in found] == [contact, by_load]


def test_nothing_to_fit_stays_nothing() -> None:
    assert screened([], 0) == []
