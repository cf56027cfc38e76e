"""A machine that is no gear, diagnosed by the same engine from its simulated recordings."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from herringbone_sim.diagnosis import examine as examining
from herringbone_sim.diagnosis import parallel
from herringbone_sim.diagnosis import search as searching
from herringbone_sim.diagnosis.coefficients import amplitudes
from herringbone_sim.diagnosis.damped_steps import damped
from herringbone_sim.diagnosis.evidence import evidence_of
from herringbone_sim.diagnosis.examine import Examination, examine
from herringbone_sim.diagnosis.fits import FittedExplanation
from herringbone_sim.diagnosis.refits import better_fits
from herringbone_sim.diagnosis.search import Search
from herringbone_sim.examples.damper.__main__ import load_weights, main, probabilities
from herringbone_sim.examples.damper.effects import IMPULSE, LAW, dahl_state
from herringbone_sim.examples.damper.machine import Damper, presliding
from herringbone_sim.examples.damper.simulate import (
    OPERATING_POINTS,
    STEP,
    Run,
    draw_rig,
    record,
    simulate,
)

ROOT = Path(__file__).resolve().parents[2]
EFFECTS = ("coulomb", "presliding", "stribeck", "cubic", "play", "gain")
SEED = 21


@cache
def examined(effect: str) -> Examination:
    return examine(Damper(simulate(effect, SEED)))


def most_probable(found: Examination) -> tuple[tuple[str, ...], float]:
    return next(iter(probabilities(evidence_of(found), load_weights()).items()))


@pytest.mark.parametrize("effect", EFFECTS)
def test_the_effect_leaves_least_and_is_named(effect: str) -> None:
    found = examined(effect)
    assert found.singles[0].hypotheses[0].effect == effect
    others = min(f.loss for f in found.singles if f.hypotheses[0].effect != effect)
    gap = found.none.loss - found.count
    assert found.singles[0].loss - found.count < 0.1 * gap
    assert others - found.singles[0].loss > 5.0 * np.sqrt(2.0 * found.count)  # no chance
    assert evidence_of(found).remains["single"] < 0.02 * gap
    name, p = most_probable(found)
    assert (name, p > 0.7) == ((effect,), True)


def test_an_examination_in_processes_is_that_of_one_process(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Fits come back from forked processes with the coefficients that they were made with."""
    for cores in (1, 2):
        monkeypatch.setattr(parallel, "cores", lambda cores=cores: cores)
        found = examine(Damper(simulate("presliding", SEED)))
        of = {f.hypotheses[0].effect: f.score for f in found.singles}
        if cores == 1:
            alone = of
    assert of.keys() == alone.keys()
    for effect, score in of.items():
        assert score.loss == alone[effect].loss
        names = [c.name for c in score.coefficients]
        assert names == [c.name for c in alone[effect].coefficients]
        assert len(names) == len(score.mean)


def test_fits_are_scored_again_with_other_noise() -> None:
    """At twice the noise, a fit leaves a quarter of the chi2, but for what its priors ask."""
    found = examined("cubic")
    search, rows = Search(found.machine), found.machine.rows
    twice = {o: np.full((search.runs, n), 2.0) for o, n in rows.items()}
    _, none, singles = examining._with_noise(search, twice, found.none, found.singles[:2])
    for now, before in zip((none, *singles), (found.none, *found.singles[:2]), strict=True):
        assert now.effects == before.effects
        assert now.score.in_sample == pytest.approx(0.25 * before.score.in_sample, rel=0.05)


def test_nothing_is_found_where_nothing_is() -> None:
    found = examined("none")
    noise = np.sqrt(2.0 / found.count)  # of the mean of so many squares
    assert abs(found.none.loss / found.count - 1.0) < 5.0 * noise
    assert evidence_of(found).remains["none"] < 5.0 * noise * found.count
    assert found.none.loss - found.singles[0].loss < 5.0 * noise * found.count
    name, p = most_probable(found)
    assert (name, p > 0.7) == ((), True)


@pytest.mark.parametrize("cause", ["maxwell", "smooth"])
def test_a_cause_outside_the_catalogue_is_unknown(cause: str) -> None:
    found = examined(cause)
    gap = found.none.loss - found.count
    assert found.singles[0].loss - found.count > 0.2 * gap
    name, p = most_probable(found)
    assert (name, p > 0.5) == (("unknown",), True)


def fitted(found: Examination, name: str) -> tuple[float, float]:
    """Value and standard deviation of a coefficient of the best effect."""
    score = found.singles[0].score
    i = [c.name for c in score.coefficients].index(name)
    return float(score.mean[i]), float(np.sqrt(score.covariance_with_jackknife()[i, i]))


def test_sizes_are_recovered() -> None:
    """The play is far from where the law was linear, the gain where F enters twice."""
    for effect, name, at in (
        ("cubic", "cubic", 6),
        ("play", "play", 2),
        ("coulomb", "coulomb", 3),
    ):
        _, _, p = draw_rig(effect, np.random.default_rng(SEED))
        true = p[at] - 5e-4 if effect == "play" else p[at]
        value, sd = fitted(examined(effect), name)
        assert value == pytest.approx(true, abs=4.0 * sd + 0.02 * abs(true))
    _, gain, _ = draw_rig("gain", np.random.default_rng(SEED))
    value, sd = fitted(examined("gain"), "gain")
    assert value == pytest.approx(1.0 - 1.0 / gain, abs=4.0 * sd)


def test_the_travel_of_presliding_is_learned() -> None:
    _, _, p = draw_rig("presliding", np.random.default_rng(SEED))
    best = examined("presliding").singles[0]
    travel = dict(best.hypotheses[0].options)["travel"]
    force, longer = (fitted(examined("presliding"), q)[0] for q in ("presliding", "longer"))
    assert force == pytest.approx(p[5], rel=0.03)
    assert travel * np.exp(longer / force) == pytest.approx(p[9], rel=0.1)


def test_a_state_of_presliding_is_dahls() -> None:
    """Pulled one way it rises as 1 - exp(-s / travel); after that it forgets where it began."""
    v = np.full(1001, 2e-3)
    way = v[0] * STEP * np.arange(1001)
    np.testing.assert_allclose(dahl_state(v, 3e-4), 1.0 - np.exp(-way / 3e-4), atol=1e-12)


def test_slopes_of_presliding_are_those_of_its_force() -> None:
    v = 0.05 * np.sin(0.05 * np.arange(2000))
    made = presliding(v, 0.7, 0.2, 3e-4)
    for name, step in (("slip", [1e-4, 0.0]), ("longer", [0.0, 1e-4])):
        up = presliding(v, 0.7 + step[0], 0.2 + step[1], 3e-4)["force"]
        down = presliding(v, 0.7 - step[0], 0.2 - step[1], 3e-4)["force"]
        np.testing.assert_allclose(made[name], (up - down) / 2e-4, atol=1e-3)


@pytest.fixture(scope="module")
def search() -> Search:
    found = Search(Damper(simulate("cubic", SEED)))
    return found.onwards(found.machine)


def test_columns_are_the_slopes_of_the_residual(search: Search) -> None:
    """Of every function of both observations, about a play that is off."""
    machine = search.machine
    about = {LAW: {"play": np.full((search.runs, 1), 4e-5)}}
    before = machine.blocks(about, None, (LAW, IMPULSE))[1]
    for o in (LAW, IMPULSE):
        for i, name in enumerate(before[o].functions):
            column = before[o].columns[:, 0, i]
            step = 1e-3 * np.mean(before[o].sigma) / np.abs(column).max()
            now = {q: dict(a) for q, a in about.items()}
            own = now.setdefault(o, {})
            own[name] = own.get(name, 0.0) + np.full((search.runs, 1), step)
            after = machine.blocks(now, {}, (o,))[1][o]
            change = (before[o].residual - after.residual)[:, 0] / step
            np.testing.assert_allclose(change, column, atol=2e-2 * np.abs(column).max())


def test_the_quick_score_is_what_the_regression_takes_off(search: Search) -> None:
    for one in search.machine.hypotheses()[:4]:
        A, b = search.campaign.normal_equations(one.coefficients)
        every = (*search.base, *one.coefficients)
        whole = A.sum(0) + np.diag([c.sd**-2.0 for c in every])
        b, n = b.sum(0), len(search.base)
        taken = b @ np.linalg.solve(whole, b)
        by_base = b[:n] @ np.linalg.solve(whole[:n, :n], b[:n])
        assert search.quick(one.coefficients) == pytest.approx(by_base - taken, rel=1e-6)


@pytest.mark.parametrize("effect", ["play", "presliding"])
def test_laws_that_bend_are_followed(effect: str) -> None:
    """Exactly they leave less than their slopes at zero, and one travel leads to the next."""
    search = Search(Damper(simulate(effect, 24)))
    search = search.onwards(search.machine)
    of_effect = [h for h in search.machine.hypotheses() if h.effect == effect]
    lines = [search.screened(h.coefficients, 1.0) for h in of_effect]
    exact = [
        search.refined(h.coefficients, line.mean).chi2.sum()
        for h, line in zip(of_effect, lines, strict=True)
    ]
    count = sum(search.campaign.counts.values())
    assert lines[0].chi2.sum() - exact[0] > 3.0 * np.sqrt(2.0 * count)
    assert np.ptp(exact) < 1.0


def test_runs_left_out_are_predicted_by_the_others(search: Search) -> None:
    """The chi2 of a run is what its block leaves with the numbers that the others give."""
    one = next(h for h in search.machine.hypotheses() if h.effect == "cubic")
    found = search.refined(one.coefficients, np.append(search.null.mean, 0.0))
    for r in range(search.runs):
        made = amplitudes(
            found.coefficients, found.leave_one_out_means[r], search.runs, search.rows
        )
        exact = search.about(one.coefficients, found.mean, None)
        moved = search.about(one.coefficients, found.leave_one_out_means[r], None)
        assert set(made) == {LAW, IMPULSE}
        assert moved.chi2[r] == pytest.approx(found.chi2[r], rel=1e-6)
        assert exact.chi2[r] < moved.chi2[r]


def test_a_single_run_is_enough_to_be_examined() -> None:
    found = examine(Damper(simulate("gain", SEED)[2:3]))
    assert np.isfinite(found.none.loss)


def test_the_verdict_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    main(["--effect", "coulomb", "--seed", "3"])
    first, *_, best, left = capsys.readouterr().out.splitlines()
    assert first.endswith("%  coulomb")
    assert best.startswith("best effect: coulomb, coulomb = ")
    assert left.startswith("mean square left over the noise: ")


def test_the_page_shows_the_code_as_it_is() -> None:
    """Every piece of code on the page that names its file."""
    page = (ROOT / "docs" / "diagnosis_machine.md").read_text(encoding="utf-8")
    pieces = re.findall(r"```python\n# (\S+\.py)\n(.*?)```", page, re.DOTALL)
    assert len(pieces) >= 4
    for name, piece in pieces:
        assert piece in (ROOT / "herringbone_sim" / name).read_text(encoding="utf-8"), piece


def test_the_script_of_the_page_runs(capsys: pytest.CaptureFixture[str]) -> None:
    page = (ROOT / "docs" / "diagnosis_machine.md").read_text(encoding="utf-8")
    (script,) = re.findall(r"```python\n(from .*?)```", page, re.DOTALL)
    exec(script, {})
    assert capsys.readouterr().out.startswith("('play',)")


def test_what_needs_no_first_effect_is_tried_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the wrong effect alone is fitted, the right one beside it explains all by itself."""
    rank = examining.rank

    def wrong_first(search, catalogue, taken):
        found, ranked = rank(search, catalogue, taken)
        if taken is None:
            ranked = [r for r in ranked if r[1].effect == "coulomb"]
        return found, ranked

    monkeypatch.setattr(examining, "rank", wrong_first)
    found = examine(Damper(simulate("play", SEED)))
    assert [f.hypotheses[0].effect for f in found.singles] == ["play", "coulomb"]
    assert found.singles[0].loss == pytest.approx(examined("play").singles[0].loss, rel=1e-3)


def test_a_first_effect_that_is_fitted_again_takes_its_own_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An explanation that stood twice would be counted twice."""
    refit, before = examining.refit_first_alone, examined("maxwell")

    def better(search: Search, first: FittedExplanation, pair: FittedExplanation):
        again = refit(search, first, pair)
        return replace(again, score=replace(again.score, chi2=0.999 * first.score.chi2))

    monkeypatch.setattr(examining, "refit_first_alone", better)
    found = examine(Damper(simulate("maxwell", SEED)))
    (first,) = found.singles[0].hypotheses
    assert found.singles[0].loss < before.singles[0].loss
    assert sum(f.hypotheses == (first,) for f in found.singles) == 1


def test_an_explanation_is_fitted_again_where_states_improve_and_that_leaves_less(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    search = Search(Damper(simulate("none", SEED)))
    stuck, lucky = (
        FittedExplanation((), replace(search.null, chi2=share * search.null.chi2))
        for share in (1.1, 0.9)
    )
    assert better_fits(search, [stuck, lucky]) == [stuck, lucky]
    monkeypatch.setattr(Damper, "states_improve", lambda damper, made: True)
    again, same = better_fits(search, [stuck, lucky])
    assert again.loss == pytest.approx(search.null.loss, rel=1e-3)
    assert same is lucky


def test_a_fit_ends_once_a_step_promises_less_than_the_noise_of_a_value(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The tolerances of a healthy damper: one step from zero, and none that is tried in vain."""
    evaluated = []
    about = Search.about

    def counted(search, coefficients, mean, wanted):
        evaluated.append(mean)
        return about(search, coefficients, mean, wanted)

    monkeypatch.setattr(Search, "about", counted)
    null = Search(Damper(simulate("none", SEED))).null
    assert len(evaluated) == 2
    np.testing.assert_array_equal(evaluated[-1], null.mean)


def test_a_step_that_diverges_is_shortened(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the first step led out of the range in which the motion is bounded.

    A damping of 1 on the diagonal halves the step where coefficients do not depend on each other.
    """
    evaluated, right = [], Search(Damper(simulate("none", SEED))).null
    about = Search.about

    def astray(search, coefficients, mean, wanted):
        found = about(search, coefficients, mean, wanted)
        evaluated.append(mean)
        if len(evaluated) == 2:
            found.chi2 = np.full_like(found.chi2, np.inf)
        return found

    monkeypatch.setattr(Search, "about", astray)
    null = Search(Damper(simulate("none", SEED))).null
    np.testing.assert_allclose(evaluated[2], 0.5 * evaluated[1], rtol=0.2)
    assert null.in_sample == pytest.approx(right.in_sample, rel=1e-3)


def test_damping_shortens_a_step_most_along_a_narrow_valley() -> None:
    """Of a matrix with eigenvalues 1.99 and 0.01 along (1, 1) and (1, -1), in any units."""
    units = np.array([1.0, 1e-6])
    A = np.array([[1.0, 0.99], [0.99, 1.0]]) / np.outer(units, units)
    for along, value in ((1.0, 1.99), (-1.0, 0.01)):
        step = np.array([1.0, along]) * units
        np.testing.assert_allclose(damped(A, 0.1, step), value / (value + 0.1) * step)


def test_a_departure_goes_beyond_what_a_moderate_effect_allows() -> None:
    """Stribeck's friction of seed 1 is over twice a moderate one; so may its departures be."""
    search = Search(Damper(simulate("stribeck", 1)))
    hypothesis = next(h for h in search.machine.hypotheses() if h.effect == "stribeck")
    start = np.append(search.null.mean, np.zeros(len(hypothesis.coefficients)))
    mean = search.refined(hypothesis.coefficients, start).mean[len(search.base) :]
    departures = [c.departs_from > 0 for c in hypothesis.coefficients]
    bound = np.array([c.bound for c in hypothesis.coefficients])
    assert (np.abs(mean) / bound)[departures].max() > 1.5


def test_no_density_is_better_than_the_fit_to_all_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that the linear correction makes so counts as what the left-out runs leave."""
    compute_score = searching.compute_score

    def astray(*args, **options):
        return replace(compute_score(*args, **options), log_density=1e6)

    monkeypatch.setattr(searching, "compute_score", astray)
    found = Search(Damper(simulate("maxwell", SEED))).null
    assert found.chi2.sum() > found.in_sample
    assert found.log_density == pytest.approx(-0.5 * found.chi2.sum())


class Stated(Damper):
    """A damper that says that its states are estimated, and takes the first of its runs first."""

    estimates_states = True

    def __init__(self, whole: Sequence[Run], used: int) -> None:
        super().__init__(whole[:used])
        self.whole = whole

    def with_more_values(self) -> Stated | None:
        more = len(self.whole) > self.runs
        return Stated(self.whole, len(self.whole)) if more else None


@pytest.mark.parametrize(("effect", "runs"), [("none", 5), ("cubic", 3)])
def test_where_little_is_left_more_values_are_used_and_densities_compared(
    effect: str, runs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, fit_again = simulate(effect, SEED), examining.fit_again
    repeated: list[FittedExplanation] = []

    def counted(search: Search, none: FittedExplanation, found: Sequence[FittedExplanation]):
        repeated.extend((none, *found))
        return fit_again(search, none, found)

    monkeypatch.setattr(examining, "fit_again", counted)
    found = examine(Stated(whole, 3))
    assert repeated[0].hypotheses == ()
    again = [f.hypotheses for f in repeated]
    assert all(f.hypotheses in again for f in found.singles)
    assert found.machine.runs == runs
    assert all(f.score.by_density for f in (found.none, *found.singles, *found.pairs))
    assert evidence_of(found).by_density
    if effect == "cubic":
        assert found.singles[0].hypotheses[0].effect == "cubic"


def test_a_pair_that_explains_all_ends_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Friction and a cubic stiffness, screened together where states are estimated."""
    rng = np.random.default_rng(SEED)
    mass, gain, p = draw_rig("cubic", rng)
    p[3] = 0.6  # friction force [N]
    runs = [record(2.0 * np.pi * f, float(P), mass, gain, p, rng) for f, P in OPERATING_POINTS]
    monkeypatch.setattr(examining, "fit_pairs", None)  # not called
    found = examine(Stated(runs, 5))
    assert set(found.pairs[0].effects) == {"coulomb", "cubic"}
    alone = {f.hypotheses[0].effect for f in found.singles}
    assert {name for f in found.pairs for name in f.effects} <= alone
    assert found.pairs[0].score.in_sample < 1.02 * found.count
    assert found.singles[0].loss > 1.5 * found.pairs[0].loss


@pytest.mark.parametrize(("too_much", "limits"), [(np.inf, (6, 2)), (0.5, (10, 4))])
def test_more_effects_are_fitted_where_the_best_linear_fit_leaves_too_much(
    too_much: float, limits: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Too much by a threshold below or above what a friction leaves of the linear fit."""
    asked: list[tuple[int, int]] = []

    def fit_best(search: Search, ranked: object, *most: int) -> tuple[FittedExplanation, ...]:
        asked.append((most[0], most[1]))
        return ()

    monkeypatch.setattr(examining, "fit_best", fit_best)
    monkeypatch.setattr(examining, "NONLINEAR_CHI2", too_much)
    examine(Stated(simulate("coulomb", SEED), 5))
    assert asked == [limits]


def test_a_step_that_was_not_tried_is_no_gain() -> None:
    """An effect fitted in no round stays at zero, whatever the linear model promises of it."""
    search = Search(Stated(simulate("cubic", SEED), 5))
    cubic = next(h for h in search.machine.hypotheses() if h.effect == "cubic")
    start = np.concatenate([search.null.mean, np.zeros(len(cubic.coefficients))])
    found = search.refined(cubic.coefficients, start, rounds=1)
    np.testing.assert_array_equal(found.mean, start)
    assert found.by_density
    assert found.loss > 0.99 * found.in_sample
    assert search.refined(cubic.coefficients, start).loss < 0.5 * found.loss
