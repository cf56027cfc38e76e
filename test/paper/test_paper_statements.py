"""The published statements as data, and the rules by which they are held against a sweep."""

from __future__ import annotations

import importlib.util
import io
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_paper import PAPER
from tqdm import tqdm

from herringbone_sim.cli.reproduce import _table
from herringbone_sim.errors import AnalysisError
from herringbone_sim.paper.boundaries import INNER, MOVES, ROUNDS, Boundary, bisect, locate
from herringbone_sim.paper.checks import CheckResult, Evidence, check
from herringbone_sim.paper.observe import BatchRunner, Request
from herringbone_sim.paper.regimes import (
    Sweep,
    find_cut,
    motions_of,
    nearest_stretch,
    route,
    share,
    stretches,
)
from herringbone_sim.paper.reproduction import CheckedStatement
from herringbone_sim.paper.scenarios import CHAOS, SCENARIOS, scenario
from herringbone_sim.paper.staircase import Reading, continuations, request, sweep
from herringbone_sim.paper.statements import (
    BoundaryAt,
    ChaosEnds,
    ExponentSign,
    MotionAt,
    Route,
    WindowIs,
    statements,
)
from herringbone_sim.recording.parameter_file import load_parameters
from herringbone_sim.sweeps.array_cache import digest
from herringbone_sim.views.figures.paper import pair_figure, raster_figure

A = scenario("A")


def staircase(*steps, n=401, low=0.0, high=100.0):
    """A sweep of known motions, (first value, motion); exponents +0.1 in chaos, else -0.1."""
    values = np.linspace(low, high, n)
    motions = np.full(n, -1)
    for first, motion in steps:
        motions[values >= first] = motion
    exponents = np.where(motions == CHAOS, 0.1, -0.1)[:, None] * np.ones(4)
    return Sweep(values, motions, np.zeros((n, 4)), exponents)


PUBLISHED = staircase((0, CHAOS), (64, 3), (67, 2), (80, 1))


def evidence(found, points=()):
    return Evidence(found, {}, dict(points))


def test_every_published_number_of_the_scenarios_is_in_a_statement():
    told = {key: " ".join(f"{s.text} {s.published}" for s in statements(key)) for key in "ABCDE"}
    numbers = {
        "A": "64 67 80 20 65 70 85",
        "B": "0.122 0.144 0.145 0.163 0.04 0.13 0.15 0.17",
        "C": "0.224 0.242 0.33 0.1 0.23 0.3 0.5",
        "D": "43 53 64",
        "E": "9 14 64",
    }
    for key, wanted in numbers.items():
        assert not [n for n in wanted.split() if n not in told[key].split()]


def test_statements_are_unique_and_of_every_kind():
    known = statements()
    assert len(set(known)) == len(known) == 62
    kinds = {type(one) for one in known}
    assert kinds == {WindowIs, BoundaryAt, ExponentSign, ChaosEnds, MotionAt, Route}
    assert [one.scenario for one in known] == sorted(one.scenario for one in known)


def test_windows_follow_each_other_within_the_sweep():
    for one in SCENARIOS:
        ends = [end for window in one.windows for end in (window.low, window.high)]
        assert ends == sorted(ends)
        assert one.low <= ends[0] <= ends[-1] <= one.high


def test_scenario_that_is_none_is_refused():
    with pytest.raises(AnalysisError, match="one of A, B, C, D, E"):
        scenario("F")


def test_all_statements_hold_of_the_published_staircase():
    points = {20.0: (CHAOS, 0.1), 65.0: (3, -0.1), 70.0: (2, -0.1), 85.0: (1, -0.1)}
    for statement in statements("A"):
        assert check(statement, evidence(PUBLISHED, points)).ok, statement.text


@pytest.mark.parametrize(
    ("edge", "ok"), [(80.0, True), (82.9, True), (83.2, False), (77.1, True), (76.8, False)]
)
def test_a_boundary_counts_within_three_per_cent_of_the_sweep(edge, ok):
    found = staircase((0, CHAOS), (64, 3), (67, 2), (edge, 1))
    (wanted,) = [s for s in statements("A") if isinstance(s, BoundaryAt) and s.high == 80]
    got = check(wanted, evidence(found))
    assert got.ok == ok
    assert got.error == pytest.approx(edge - 80.0, abs=0.13)


def test_a_boundary_between_wrong_motions_does_not_count():
    found = staircase((0, CHAOS), (64, 3), (67, CHAOS), (80, 1))
    (wanted,) = [s for s in statements("A") if isinstance(s, BoundaryAt) and s.high == 80]
    got = check(wanted, evidence(found))
    assert not got.ok
    assert "no P2" in got.text


def test_a_ragged_edge_does_not_count_and_tells_its_shares():
    found = staircase((0, CHAOS), (64, 3), (67, 2), (80, 1))
    mixed = found.motions.copy()
    near = (found.values > 80) & (found.values < 83)
    mixed[near] = np.where(np.arange(near.sum()) % 2, 1, CHAOS)
    (wanted,) = [s for s in statements("A") if isinstance(s, BoundaryAt) and s.high == 80]
    got = check(wanted, evidence(replace(found, motions=mixed)))
    assert not got.ok
    assert "%" in got.text


def test_a_window_counts_from_nine_values_in_ten_on():
    (wanted,) = [s for s in statements("A") if isinstance(s, WindowIs) and s.motion == 1]
    for first, ok in ((81.9, True), (82.3, False)):
        got = check(wanted, evidence(staircase((0, 2), (first, 1))))
        assert got.ok == ok
        assert got.error == pytest.approx((first - 80) / 20, abs=0.01)


def test_a_missing_window_names_the_nearest_of_its_motion():
    found = staircase((0, CHAOS), (50, 3), (55, CHAOS), (67, 2), (80, 1))
    (wanted,) = [s for s in statements("A") if isinstance(s, WindowIs) and s.motion == 3]
    got = check(wanted, evidence(found))
    assert not got.ok
    assert "nearest P3: 50 to 54.75" in got.text
    assert nearest_stretch(found, 7, 65.0) is None


def test_chaos_ends_where_its_last_value_lies():
    (wanted,) = [s for s in statements("A") if isinstance(s, ChaosEnds)]
    got = check(wanted, evidence(staircase((0, CHAOS), (60, 1), (70, CHAOS), (72, 1))))
    assert not got.ok
    assert got.error == pytest.approx(71.75 - 64)


def test_the_sign_of_the_exponent_is_that_of_the_values_in_the_window():
    found = replace(PUBLISHED, exponents=-PUBLISHED.exponents)
    signs = [s for s in statements("A") if isinstance(s, ExponentSign)]
    assert len(signs) == 4
    assert all(check(s, evidence(PUBLISHED)).ok for s in signs)
    assert not any(check(s, evidence(found)).ok for s in signs)


def test_chaos_of_a_figure_needs_a_positive_exponent():
    wanted = MotionAt("A", "", "chaos", 20.0, CHAOS, "Fig. 6")
    assert check(wanted, evidence(PUBLISHED, {20.0: (CHAOS, 0.1)})).ok
    assert not check(wanted, evidence(PUBLISHED, {20.0: (CHAOS, -0.1)})).ok
    assert not check(wanted, evidence(PUBLISHED, {20.0: (3, 0.1)})).ok


def test_a_route_leaves_short_pockets_out():
    found = staircase((0, CHAOS), (40, 1), (41, CHAOS), (64, 3), (67, 2), (80, 1))
    assert route(found) == (CHAOS, 3, 2, 1)
    assert route(staircase((0, CHAOS), (40, 1), (43, CHAOS))) == (CHAOS, 1, CHAOS)


def test_stretches_and_shares_of_a_staircase():
    assert [motion for _, _, motion in stretches(PUBLISHED)] == [CHAOS, 3, 2, 1]
    assert share(PUBLISHED, 67.0, 79.75, 2) == 1.0
    assert share(PUBLISHED, 60.0, 66.75, 3) == pytest.approx(12 / 28)
    assert np.isnan(share(PUBLISHED, 101.0, 102.0, 1))


def test_the_cleanest_edge_near_is_taken():
    found = staircase((0, CHAOS), (50, 2), (50.5, CHAOS), (70, 2), (80, 1))
    cut = find_cut(found, CHAOS, 2, 60.0)
    assert cut is not None
    assert cut.at == pytest.approx(70.0, abs=0.25)
    assert (cut.clean, cut.share_before, cut.share_after) == (True, 1.0, 1.0)
    assert find_cut(found, CHAOS, 2, 20.0) is None


def sections(*centres, noise=0.0, cycles=64):
    """Section points that visit centres in turn."""
    rng = np.random.default_rng(0)
    points = np.array([centres[i % len(centres)] for i in range(cycles)], dtype=float)
    return np.repeat(points[:, None], 8, axis=1) + noise * rng.normal(size=(cycles, 8))


@pytest.mark.parametrize(
    ("points", "motion"),
    [
        (sections(1.0), 1),
        (sections(0.0, 1.0), 2),
        (sections(0.0, 1.0, 0.5, 0.2, noise=1e-4), 4),
        (sections(0.0, 1.0, noise=0.1), CHAOS),
        (sections(0.0) + np.linspace(0, 1, 64)[:, None], CHAOS),
        (sections(np.nan), -1),
    ],
)
def test_motions_of_known_sections(points, motion):
    class Known:
        sections = points[None]

    assert motions_of(Known()).tolist() == [motion]


@pytest.fixture(scope="module")
def reading():
    return Reading(load_parameters(PAPER), 0.085)


def test_period_doubling_is_bisected_to_a_small_part_of_the_step(reading):
    """B: the last inverse period doubling, published at 0.163."""
    one = scenario("B")
    (wanted,) = [s for s in statements("B") if isinstance(s, BoundaryAt) and s.after == 1]
    runner = BatchRunner()
    whole = one.values(17)[-4:]
    batch = runner.batch(request(one, reading, whole))
    coarse = Sweep(whole, motions_of(batch), batch.sections[:, :, 0], np.zeros((4, 4)))
    assert coarse.motions.tolist() == [2, 2, 1, 1]
    found = bisect(runner, one, reading, coarse, wanted)
    assert found.half_width < (whole[1] - whole[0]) / 400
    sides = [found.at - 1e-3, found.at + 1e-3]
    assert motions_of(runner.batch(request(one, reading, sides))).tolist() == [2, 1]
    assert found.note == "bisected"
    flip = 0.16244  # multiplier -1 of the P1 orbit itself, docs/boundaries.md
    assert found.at == pytest.approx(flip, abs=2e-4)


def test_an_interval_that_is_moved_as_often_as_it_may_be_is_bisected(reading, monkeypatch):
    one = scenario("B")
    (wanted,) = [s for s in statements("B") if isinstance(s, BoundaryAt) and s.after == 1]
    asked = []

    def batch(runs):
        asked.append(len(runs.sets))
        return asked

    def motions(asked, tolerance):
        moved = len(asked) < MOVES
        return np.array([wanted.before, wanted.before if moved else wanted.after, *[0] * 13])[
            : asked[-1]
        ]

    monkeypatch.setattr("herringbone_sim.paper.boundaries.motions_of", motions)
    runner = SimpleNamespace(batch=batch)
    coarse = Sweep(one.values(17)[-4:], np.array([2, 2, 1, 1]), np.zeros((4, 1)), np.zeros((4, 4)))
    assert bisect(runner, one, reading, coarse, wanted).note == "bisected"
    assert asked == [2] * MOVES + [INNER] * ROUNDS


def test_an_edge_that_is_not_clean_is_not_bisected(reading):
    found = staircase((0, CHAOS), (64, 3), (66.5, 5), (67, 2), (80, 1))
    (wanted,) = [s for s in statements("A") if isinstance(s, BoundaryAt) and s.before == 3]
    runner = BatchRunner()
    assert bisect(runner, A, reading, found, wanted) == locate(found, wanted)
    assert locate(found, wanted).note.startswith("ragged")
    assert np.isnan(locate(staircase((0, 1)), wanted).at)


def test_sweeps_by_continuation_show_hysteresis(reading):
    """P1 coexists with the chaos below 64: going down keeps it, going up does not find it."""
    small = replace(A, low=40.0, high=90.0)
    runner = BatchRunner()
    (up,) = continuations(runner, [small], reading, 6, 1)
    (down,) = continuations(runner, [small], reading, 6, -1)
    assert up.values.tolist() == down.values.tolist() == [40.0, 50.0, 60.0, 70.0, 80.0, 90.0]
    assert up.motions[0] == CHAOS
    assert down.motions[:2].tolist() == [1, 1]
    assert (up.motions[-1], down.motions[-1]) == (1, 1)


def test_a_sweep_gives_section_displacements_and_exponents(reading):
    one = replace(A, low=85.0, high=95.0)
    runner = BatchRunner()
    found = sweep(runner, one, reading, 2, exponents=True)
    assert found.motions.tolist() == [1, 1]
    assert (found.exponents[:, 0] < 0).all()
    assert found.x.shape == (2, 64)
    half_backlash = 0.35
    assert (np.abs(found.x[:, -1]) > half_backlash).all()


def test_observer_reads_what_it_knows_and_does_not_trust_a_broken_file(reading, tmp_path):
    asked = Request((A.parameters(reading.parameters, 90.0, 0.1),), None, 50)
    bar = tqdm(total=0, file=io.StringIO())
    runner = BatchRunner(tmp_path, 1, bar)
    first = runner.batch(asked)
    (path,) = tmp_path.glob("*.npz")
    before = path.stat().st_mtime_ns
    runner = BatchRunner(tmp_path, 1)
    again = runner.batch(asked)
    assert path.stat().st_mtime_ns == before
    np.testing.assert_array_equal(first.sections, again.sections)
    assert first.reasons == again.reasons == ("",)
    path.write_bytes(path.read_bytes()[:100])
    mended = runner.batch(asked)
    np.testing.assert_array_equal(first.sections, mended.sections)
    assert (bar.n, bar.total) == (1, 1)


def test_requests_differ_in_all_that_counts(reading):
    p = A.parameters(reading.parameters, 90.0, 0.1)
    start = np.zeros((1, 8))
    asked = [
        Request((p,)),
        Request((p,), start),
        Request((p,), start + 1e-300),
        Request((p,), None, 601),
        Request((p,), exponents=True),
        Request((p.changed({"delta_T": 90.1}),)),
    ]
    assert len({digest(one.key) for one in asked}) == len(asked)
    assert [len(one.sets) for one in Request((p,) * 70).parts()] == [32, 32, 6]


def test_unwritable_folder_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(AnalysisError, match="--out"):
        BatchRunner(tmp_path / "file" / "data")


@pytest.fixture(scope="module")
def readings():
    path = Path(__file__).resolve().parents[2] / "benchmarks" / "reading.py"
    spec = importlib.util.spec_from_file_location("reading_search", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["reading_search"] = module
    spec.loader.exec_module(module)
    return module


def test_paper_file_is_the_best_natural_reading_of_the_search(readings, reading):
    best = readings.parameters(readings.BEST)
    for name in ("m_n", "alpha_w", "gamma", "b_c"):
        assert getattr(best, name) == pytest.approx(getattr(reading.parameters, name), rel=1e-4)
    for name in ("projection", "thermal_rp", "initial_x", "T_2", "beta"):
        assert getattr(best, name) == getattr(reading.parameters, name)


def test_every_reading_of_the_search_is_a_set_of_parameters(readings):
    known = [*readings.natural(), *readings.drawn(3)]
    assert len({name for name, _ in known}) == len(known)
    sets = [readings.parameters(changes) for _, changes in known]
    assert len({repr(one) for one in sets}) == len(sets)
    assert list(readings.drawn(2)) == list(readings.drawn(3))[:2]


def test_search_goes_on_where_it_stopped(readings, tmp_path, monkeypatch):
    asked = []

    def score(name, kind, changes, n):
        asked.append(name)
        return readings.Score(name, kind, dict.fromkeys("ABCDE", len(asked)), 0.1)

    monkeypatch.setattr(readings, "score", score)
    wanted = [(name, "natural", changes) for name, changes in readings.natural()][:3]
    first = readings.scores(wanted[:2], 10, tmp_path / "scores.jsonl")
    again = readings.scores(wanted, 10, tmp_path / "scores.jsonl")
    assert asked == [name for name, _, _ in wanted]
    assert again[:2] == first
    assert readings.table(again, 1).splitlines()[1].split()[0] == "15"


def test_a_boundary_between_coarse_values_has_values_on_both_sides():
    values = A.values(20)
    motions = np.where(values < 64, CHAOS, np.where(values < 67, 3, np.where(values < 80, 2, 1)))
    found = Sweep(values, motions, np.zeros((20, 4)), np.full((20, 4), np.nan))
    last = [s for s in statements("A") if isinstance(s, BoundaryAt)][-1]
    edge = Boundary(82.45, 0.01, 1.0, 1.0, "bisected")
    assert check(last, Evidence(found, {last: edge}, {})).ok


def unknown(n, largest=np.nan):
    """A sweep of chaos of which the largest exponents alone are known, or none."""
    exponents = np.full((n, 4), np.nan)
    exponents[:, 0] = largest
    return Sweep(A.values(n), np.full(n, CHAOS), np.zeros((n, 4)), exponents)


def test_no_share_is_told_of_exponents_that_are_not_known():
    sign = next(s for s in statements("A") if isinstance(s, ExponentSign))
    assert "alike" not in check(sign, Evidence(unknown(20, 0.1), {}, {})).text
    assert np.isnan(check(sign, Evidence(unknown(20), {}, {})).error)


def test_a_window_without_swept_values_is_told():
    p3 = [s for s in statements("A") if isinstance(s, WindowIs)][1]
    assert "no values swept" in check(p3, Evidence(unknown(5), {}, {})).text


def test_the_legend_has_the_published_motions():
    row = unknown(20)
    for figure in (raster_figure(A, {"zero start": row}), pair_figure([(A, row), (A, row)])):
        names = {text.get_text() for text in figure.legends[0].get_texts()}
        assert names >= {"chaos", "P1", "P2", "P3"}


def test_what_is_published_is_printed_whole() -> None:
    checked = [CheckedStatement(s, CheckResult("obtained", 0.0, True)) for s in statements()]
    for line, c in zip(_table(checked), checked, strict=True):
        assert f"  {c.statement.published} " in line
