"""Which explanations are fitted beside those that the linear screen ranks first."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from herringbone_sim.diagnosis import refits
from herringbone_sim.diagnosis.coefficients import Coefficient
from herringbone_sim.diagnosis.examine import WORTH_SEEKING, _first_of_pairs, _other_first
from herringbone_sim.diagnosis.fits import (
    MAX_SCREENED_PER_EFFECT,
    FittedExplanation,
    fit_best,
    rank,
    with_other_law,
)
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.diagnosis.pairs import (
    fit_beside_part,
    fit_jointly,
    fit_pairs,
    fit_rivals_of_first,
    rank_jointly,
    refit_second_alone,
    with_each_alone,
    without_duplicates,
)
from herringbone_sim.diagnosis.refits import fit_again, with_fits_anew
from herringbone_sim.diagnosis.search import Search


@dataclass
class Left:
    """What the search needs of a score."""

    loss: float
    in_sample: float
    mean: np.ndarray = field(default_factory=lambda: np.zeros(1))
    coefficients: tuple[Any, ...] = ()
    count: float = 0.0
    start: Any = None


def with_fits(**known: Any) -> Any:
    """A search with such attributes whose scores are exact, and whose fits are made in turn."""
    machine = SimpleNamespace(
        fitted_in_parallel=lambda fit, items: [fit(None, item) for item in items]
    )
    search = SimpleNamespace(base=(), settled=lambda score: score, machine=machine)
    search.with_machine = lambda machine: search
    search.__dict__.update(known)
    return search


def one(
    effect: str,
    law: str | None = None,
    linear: bool = True,
    place: str = "all",
    center: float = 0.0,
) -> Hypothesis:
    own = Coefficient("size", 1.0, np.inf, {}, center, scales_with_effect=linear)
    return Hypothesis(effect, (("law", law),) if law else (), place, (own,), 1)


def screened(losses: list[tuple[Hypothesis, float]], fitted: int) -> list[FittedExplanation]:
    """Fits of those in a list, best first, the linear screen of which has its first fitted."""

    def refined(coefficients: Any, start: np.ndarray) -> Any:
        loss = next(loss for h, loss in losses if h.coefficients is coefficients)
        return Left(loss, loss, start)

    search = with_fits(refined=refined, null=SimpleNamespace(in_sample=np.inf))
    ranked = [(float(i), h, np.zeros(1)) for i, (h, _) in enumerate(losses)]
    fits = fit_best(search, ranked, fitted, 2, nonlinear_too=True)
    return list(with_other_law(search, ranked, fits))


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


def test_pairs_stand_on_a_moving_part_only_if_it_explains_enough() -> None:
    """Of a gap of 100, by chi2: a fit beside a part takes as long as ten others."""

    def fit(effect: str, loss: float, part: bool) -> FittedExplanation:
        hypothesis = replace(one(effect), measured_gain=1.0 if part else None)
        score: Any = SimpleNamespace(loss=loss, in_sample=loss, coefficients=(0,))
        return FittedExplanation((hypothesis,), score)

    none = FittedExplanation((), SimpleNamespace(loss=200.0, in_sample=200.0))  # type: ignore[arg-type]
    other = fit("stiffness", 195.0, part=False)
    for gained, first in ((90.0 * WORTH_SEEKING, "stiffness"), (110.0 * WORTH_SEEKING, "ring")):
        part = fit("ring", 200.0 - gained, part=True)
        assert _first_of_pairs(none, [part, other], 100.0).effects == (first,)
        assert _first_of_pairs(none, [part], 100.0).effects == ("ring",)


def test_a_fit_that_was_made_is_not_made_again() -> None:
    """A fit of another hypothesis of the same effect does not stand for it."""

    def refined(coefficients: Any, start: np.ndarray) -> Any:
        return Left(5.0, 5.0, start)

    null = SimpleNamespace(in_sample=10.0, mean=np.zeros(2))
    search = with_fits(refined=refined, null=null)
    here, there = one("stiffness"), one("stiffness", place="left")
    score: Any = SimpleNamespace(loss=7.0, in_sample=7.0)
    before = FittedExplanation((here,), score)
    ranked = [(0.0, here, np.zeros(3)), (1.0, there, np.zeros(3))]
    fits = fit_best(search, ranked, 2, 2, (before,))
    assert fits[1] is before
    assert [f.loss for f in fits] == [5.0, 7.0]


def test_nothing_to_fit_stays_nothing() -> None:
    assert screened([], 0) == []


def test_a_fit_that_goes_astray_is_made_again_from_its_base() -> None:
    """It leaves more than the fit it stands on, of which it is an extension."""

    def refined(coefficients: Any, start: np.ndarray) -> Any:
        left = 30.0 if start[-1] else 4.0  # from a linear step too long, and from nothing
        return Left(left, left, start)

    null = SimpleNamespace(in_sample=10.0, mean=np.zeros(2))
    search = with_fits(refined=refined, null=null)
    (fit,) = fit_best(search, [(0.0, one("stiffness"), np.array([0.0, 0.0, 9.0]))], 1, 1)
    assert fit.loss == 4.0


def ranking_of(catalogue: list[Hypothesis], gains: dict[int, float]) -> Any:
    """A search that screens hypotheses by what they remove, by the identity of their coefficients.

    It leaves noise, so that no nonlinear trial is made.
    """

    def score(coefficients: Any, *_: Any) -> Any:
        left = 100.0 - gains[id(coefficients)]
        return Left(left, left)

    null = SimpleNamespace(
        coefficients=(), mean=np.zeros(0), count=100.0, loss=100.0, in_sample=100.0
    )
    search = with_fits(null=null, runs=1, rows={}, screened=score, refined=score)
    search.machine.proposals = lambda made, known: (None, [])
    search.quick = lambda coefficients: -gains[id(coefficients)]
    search.onwards = lambda machine, taken: search
    return search


def test_all_that_is_present_or_absent_goes_on() -> None:
    """Any two of nine encoders may be exchanged, and what that does is far from linear."""
    swaps = [one("swap", place=str(i), center=1.0) for i in range(36)]
    frictions = [one("friction", place=str(i)) for i in range(36)]
    gains = {id(h.coefficients): 0.0 for h in swaps}
    gains |= {id(h.coefficients): 1.0 + i for i, h in enumerate(frictions)}
    _, ranked = rank(ranking_of([*swaps, *frictions], gains), [*swaps, *frictions], None)
    effects = [h.effect for _, h, _ in ranked]
    assert effects.count("swap") == 36
    assert effects.count("friction") == MAX_SCREENED_PER_EFFECT


def test_a_pair_of_effects_that_were_fitted_alone_is_tried() -> None:
    """On the residual of the first, which took on much of it, the second is not among the best."""
    first, pin = one("contact"), one("pin")
    rest = [one(name) for name in ("friction", "crack", "ripple", "ring", "stagger")]
    gains = {id(h.coefficients): 20.0 + i for i, h in enumerate(rest)}
    gains |= {id(pin.coefficients): 1.0, id(first.coefficients): 5.0}
    search = ranking_of([first, *rest, pin], gains)
    known = (Coefficient("tolerance", 1.0, np.inf, {}),)
    left = SimpleNamespace(
        loss=95.0, in_sample=95.0, count=50.0, mean=np.zeros(1), coefficients=known
    )
    alone = [FittedExplanation((h,), left) for h in (first, pin)]  # type: ignore[arg-type]
    pairs = fit_pairs(search, [first, *rest, pin], alone[0], 0.0, alone)
    assert "pin" in [f.hypotheses[1].effect for f in pairs]
    enough = SimpleNamespace(**{**vars(left), "count": 95.0})
    alone = [FittedExplanation((h,), enough) for h in (first, pin)]  # type: ignore[arg-type]
    pairs = fit_pairs(search, [first, *rest, pin], alone[0], 0.0, alone)
    assert "pin" not in [f.hypotheses[1].effect for f in pairs]


def test_what_is_partly_screened_is_not_shut_out_by_its_effect() -> None:
    """A clock of rates is behind one of gauges for what the balance would gain."""
    gauges, some, rates = (one("clock", place=name) for name in ("F", "F left", "v"))
    rates = replace(rates, partly_screened=True)
    ranked = [(float(i), h, np.zeros(1)) for i, h in enumerate((gauges, some, rates))]
    gains = {id(h.coefficients): 1.0 for _, h, _ in ranked}
    found = fit_best(ranking_of([], gains), ranked, 3, 1)
    assert [f.hypotheses[0].locus for f in found] == ["F", "v"]


def fitted(loss: float, *hypotheses: Hypothesis) -> FittedExplanation:
    score: Any = SimpleNamespace(loss=loss, in_sample=loss, mean=np.zeros(2), coefficients=())
    return FittedExplanation(hypotheses, score)


def test_the_rival_of_the_first_effect_is_tried_beside_the_second() -> None:
    """Alone it left little more than the first; the second, and what is tried, not again."""
    first, rival, second = one("thermal"), one("backlash"), one("stagger")
    search = ranking_of([], {id(rival.coefficients): 70.0})
    search.null.mean = np.zeros(1)
    singles = [fitted(50.0, first), fitted(51.0, rival), fitted(60.0, second)]
    pairs = [fitted(40.0, first, second)]
    (found,) = fit_rivals_of_first(search, singles[2], singles, pairs)
    assert found.effects == ("stagger", "backlash")
    assert without_duplicates([*pairs, found])[0] is found


def test_a_pair_stands_once_whichever_effect_was_first() -> None:
    first, second = one("thermal"), one("stagger")
    better, other = fitted(30.0, second, first), fitted(40.0, first, second)
    alone = fitted(35.0, first, one("ring"))
    assert without_duplicates([other, alone, better]) == (better, alone)


def test_the_second_effect_to_fit_alone_is_one_that_can_stand_alone() -> None:
    """One that was proposed from what the first effect left has no functions without that."""
    first, pin = one("backlash"), one("pin")
    seat = replace(one("bearing"), source="residual of the first effect")
    pairs = [fitted(30.0, first, seat), fitted(35.0, first, pin)]
    alone = fitted(60.0, pin)
    search = ranking_of([], {})
    assert refit_second_alone(search, [alone], pairs) is alone
    assert refit_second_alone(search, [alone], pairs[:1]) is None


def joint_search(gains: dict[frozenset[str], float]) -> Any:
    """A search in which a set of effects leaves 100 less its gain; coefficients bear its name.

    Means are 0 of the tolerance, then 1, 2, ...; each score tells from where it was fitted.
    """

    def score(coefficients: Any, start: Any = None) -> Any:
        left = 100.0 - gains.get(frozenset(c.name for c in coefficients), 0.0)
        mean = np.arange(1.0 + len(coefficients))
        return Left(left, left, mean, coefficients, start=start)

    null = SimpleNamespace(in_sample=100.0, mean=np.array([7.0]))
    search = with_fits(screened=score, refined=score, null=null, base=(None,))
    search.quick = lambda coefficients: score(coefficients).loss - 100.0
    return search


def named(effect: str, place: str = "all") -> Hypothesis:
    """A hypothesis whose coefficient has the name of the effect."""
    return Hypothesis(effect, (), place, (Coefficient(effect, 1.0, np.inf, {}),), 1)


def test_pairs_are_screened_though_neither_effect_is_the_best_alone() -> None:
    """Each removes little; another effect takes on a part of both."""
    contact, thermal, backlash = (named(name) for name in ("contact", "thermal", "backlash"))
    gains = {frozenset(("contact",)): 50.0, frozenset(("thermal", "backlash")): 90.0}
    gains |= {frozenset(("contact", other)): 55.0 for other in ("thermal", "backlash")}
    gains |= {frozenset(("contact", other)): 54.0 for other in ("friction", "ripple")}
    gains[frozenset(("friction", "ripple"))] = -1.0
    seat = replace(named("ring"), measured_gain=70.0)  # no linear score can rank it
    others = thermal, backlash, seat, named("thermal", "left"), named("friction"), named("ripple")
    ranked = [(50.0, contact, np.zeros(2)), *((95.0, h, np.zeros(2)) for h in others)]
    search = joint_search(gains)
    joint = rank_jointly(search, ranked)
    assert [{a.effect, b.effect} for _, (a, b), _ in joint[:2]] == 2 * [{"thermal", "backlash"}]
    assert all(
        a.effect != b.effect and "ring" not in (a.effect, b.effect) for _, (a, b), _ in joint
    )
    assert [f.loss for f in fit_jointly(search, joint, 101.0)] == [10.0, 45.0, 45.0]
    (best,) = fit_jointly(search, joint, 40.0)  # the others leave more
    np.testing.assert_array_equal(best.score.start, [0.0, 1.0, 2.0])  # type: ignore[attr-defined]
    worse = [r for r in joint if {h.effect for h in r[1]} == {"friction", "ripple"}]
    assert worse
    assert not fit_jointly(search, worse, 200.0)  # leaves more than no effect does


def test_each_effect_of_a_pair_is_fitted_alone_once() -> None:
    """From its own value in the pair; fits of the same tooth by two ways of assembly both stay."""
    thermal, backlash, tooth = (named(name) for name in ("thermal", "backlash", "crack"))
    search = joint_search({frozenset(("thermal",)): 30.0})
    pair = FittedExplanation(
        (backlash, thermal), search.refined((*backlash.coefficients, *thermal.coefficients))
    )
    twins = [fitted(50.0, tooth), fitted(90.0, tooth)]
    singles = with_each_alone(search, [pair, pair], twins)
    assert [(f.effects[0], f.loss) for f in singles] == [
        ("crack", 50.0),
        ("thermal", 70.0),
        ("crack", 90.0),
        ("backlash", 100.0),
    ]
    starts = [f.score.start for f in singles if f.effects != ("crack",)]  # type: ignore[attr-defined]
    np.testing.assert_array_equal(starts, [[7.0, 2.0], [7.0, 1.0]])


def scored(loss: float, mean: tuple[float, ...] = (0.0,)) -> Any:
    return Left(loss, loss, np.array(mean))


def test_a_moving_part_stands_beside_what_alone_removes_less() -> None:
    """Of a pair it takes the place of the effect that removes more; each other effect once."""
    soft, broken, ring = one("stiffness"), one("spall"), one("ring", linear=False)
    elsewhere = one("spall", place="left")
    singles = [FittedExplanation((h,), scored(x)) for h, x in ((soft, 5.0), (broken, 9.0))]
    pairs = [
        FittedExplanation((soft, broken), scored(3.0, (0.1, 0.7))),
        FittedExplanation((broken, soft), scored(3.5, (0.6, 0.2))),
        FittedExplanation((soft, elsewhere), scored(4.0, (0.3, 0.4))),
    ]
    tried = []

    def refined(coefficients: Any, start: np.ndarray) -> Any:
        tried.append((coefficients[0], start.tolist()))
        return scored(2.0, tuple(start))

    null = SimpleNamespace(in_sample=np.inf, mean=np.array([1.0]))
    beside = with_fits(refined=refined, null=null)
    search: Any = SimpleNamespace(base=(), machine=None, onwards=lambda machine, score: beside)
    found = fit_beside_part(search, FittedExplanation((ring,), scored(4.0)), pairs, singles)
    assert [f.hypotheses for f in found] == [(ring, broken), (ring, elsewhere)]
    assert [start for _, start in tried] == [[1.0, 0.7], [1.0, 0.4]]
    assert all(f.search is beside for f in found)


def test_effects_are_fitted_anew_until_one_explains() -> None:
    """The best place of each effect; a trial that gains nothing leaves the fit as it was."""
    losses = {"runout": 8.0, "pin": 9.0, "crack": 10.0}
    better = {"runout": 100.0, "pin": 50.0}  # squares removed by the fit after a trial
    hypotheses = {effect: one(effect) for effect in losses}
    known = {id(h.coefficients[0]): effect for effect, h in hypotheses.items()}
    asked = []

    def restarted_from_other_sizes(hypothesis: Hypothesis, fit: Any) -> np.ndarray | None:
        asked.append(hypothesis.effect)
        return None if asked.count(hypothesis.effect) > 1 else np.ones(1)

    def refined(coefficients: Any, start: np.ndarray) -> Any:
        effect = known[id(coefficients[0])]
        return scored(1000.0 * losses[effect] - better[effect])

    search: Any = SimpleNamespace(
        machine=SimpleNamespace(restarted_from_other_sizes=restarted_from_other_sizes),
        refined=refined,
        settled=lambda score: score,
        null=SimpleNamespace(in_sample=np.inf),
    )
    singles = [FittedExplanation((h,), scored(1000.0 * losses[e])) for e, h in hypotheses.items()]
    found = with_fits_anew(search, singles, most=1.0)
    assert [f.loss for f in found] == [7900.0, 8950.0, 10000.0]
    assert asked == ["runout", "runout", "pin", "pin"]
    asked.clear()
    assert with_fits_anew(search, singles, most=7950.0)[1].loss == 9000.0
    assert asked == ["runout", "runout"]


@pytest.mark.parametrize(
    ("gained", "leaves", "again"),
    [
        (0.0, 1.2, ["none", "best", "near"]),
        (30.0, 1.2, ["none", "best", "near", "next"]),  # its states may improve as much
        (0.0, 2.0, ["none", "best", "near", "next", "far"]),  # all may be in wrong minima
    ],
)
def test_what_may_come_near_the_best_is_fitted_again(
    monkeypatch: pytest.MonkeyPatch, gained: float, leaves: float, again: list[str]
) -> None:
    """Of a gap of 200, by chi2 of 100 values: others are 5, 35 and 150 behind the best."""
    fits = {
        name: FittedExplanation((one(name),), Left(loss, 100.0 * leaves, count=100.0))  # type: ignore[arg-type]
        for name, loss in (
            ("none", 400.0),
            ("best", 200.0),
            ("near", 205.0),
            ("next", 235.0),
            ("far", 350.0),
        )
    }
    made: list[str] = []

    def better(search: Any, explanations: list[FittedExplanation]) -> list[FittedExplanation]:
        made.extend(f.effects[0] for f in explanations)
        gains = [gained * (f.effects[0] == "none") for f in explanations]
        return [
            replace(f, score=replace(f.score, loss=f.loss - g))
            for f, g in zip(explanations, gains, strict=True)
        ]

    monkeypatch.setattr(refits, "better_fits", better)
    none, *singles = fits.values()
    left, found = fit_again(with_fits(), none, singles)
    assert made == again
    assert left.loss == 400.0 - gained
    assert [f.effects[0] for f in found] == ["best", "near", "next", "far"]


@pytest.mark.parametrize("center", [0.0, 1.0])
def test_a_quick_screen_is_the_fall_of_chi2_beyond_the_base(center: float) -> None:
    """About a fitted base whose columns go with the effect's; with the priors."""
    rng = np.random.default_rng(1)
    X = rng.normal(size=(400, 3))
    X[:, 2] += X[:, 0]
    y = X @ [0.3, -0.2, 1.0] + rng.normal(size=400)
    prior, at = np.array([4.0, 4.0, 100.0]), np.array([0.0, 0.0, center])
    y -= X[:, :2] @ np.linalg.solve(X[:, :2].T @ X[:, :2] + np.diag(prior[:2]), X[:, :2].T @ y)

    def least(n: int) -> float:
        A, b = X[:, :n].T @ X[:, :n] + np.diag(prior[:n]), X[:, :n].T @ y + prior[:n] * at[:n]
        mean = np.linalg.solve(A, b)
        return float(np.sum((y - X[:, :n] @ mean) ** 2) + prior[:n] @ (mean - at[:n]) ** 2)

    search = object.__new__(Search)
    search.base = tuple(Coefficient("", 0.5, np.inf, {}) for _ in range(2))
    equations = (X.T @ X)[None], (X.T @ y)[None]
    search.campaign = SimpleNamespace(normal_equations=lambda _: equations)
    gain = search.quick((Coefficient("", 0.1, np.inf, {}, center),))
    assert gain == pytest.approx(least(3) - least(2), rel=1e-9)


def test_where_all_pairs_leave_more_than_noise_a_second_effect_goes_first() -> None:
    """That of the pair that leaves least, where it alone is best; one that was first is not again.

    Offsets of backlash at all meshes beside its change by temperature at some: alone, a change at
    all meshes removes more, and with it in the fit no offset helps.
    """
    a, b, b_left, c = one("a"), one("b"), one("b", place="L"), one("c")
    singles = [
        FittedExplanation((h,), Left(loss, loss))
        for h, loss in ((a, 5.0), (b, 9.0), (b_left, 20.0))
    ]
    pairs = [
        FittedExplanation((a, c), Left(3.0, 4.0)),
        FittedExplanation((a, b_left), Left(4.0, 2.0)),
    ]
    search = with_fits(
        refined=lambda coefficients, start: Left(7.0, 7.0, start, coefficients),
        null=SimpleNamespace(mean=np.zeros(0)),
    )
    assert _other_first(search, singles, pairs, 1.0, {"a"}) is singles[1]
    assert _other_first(search, singles, pairs, 2.0, {"a"}) is None
    pairs.append(FittedExplanation((b, c), Left(1.5, 1.8)))
    found = _other_first(search, singles, pairs, 1.0, {"a", "b"})
    assert found is not None
    assert found.hypotheses == (c,)
    assert _other_first(search, singles, pairs[1:2], 1.0, {"a", "b"}) is None
