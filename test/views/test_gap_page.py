"""The page of a gap diagnosis: every verdict in words, twelve meshes with their shares."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gap_support import a_report

from herringbone_sim.effects.effect import Locus, active
from herringbone_sim.effects.registry import effects
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.further_runs import Repetition
from herringbone_sim.gap.observations.calibration.noise_report import ChannelNoise
from herringbone_sim.gap.report import Cause, Estimate, Report
from herringbone_sim.gap.report_file import StoredReport
from herringbone_sim.gap.verdict.decide import NamedExplanation, Verdict
from herringbone_sim.gap.verdict.next_experiment import NextExperiment
from herringbone_sim.gap.verification.residual_gap import Gap, RunGap
from herringbone_sim.gap.verification.senses import Senses
from herringbone_sim.views.figures.gap import GapArrays
from herringbone_sim.views.figures.gap_arrays import BINS, mean_over_phase
from herringbone_sim.views.gear_geometry import MESHES
from herringbone_sim.views.numbers import figure, percent
from herringbone_sim.views.pages.gap.page import gap_page, plan_command, write_gap_page
from herringbone_sim.views.pages.gap.senses import verify_page
from herringbone_sim.views.pages.gap.tables import runs_values
from herringbone_sim.views.pages.gap.verdict import headline
from herringbone_sim.views.pages.gap.where import bodies
from herringbone_sim.views.pages.gap.words import (
    PHRASES,
    closure_words,
    locus_words,
    parameter_words,
    place_words,
)
from herringbone_sim.views.pages.gear_drawing import colour, mesh_shares

ALL = Locus()
SUN_2_LEFT = Locus("sp", "2", "L")
SHARES = {mesh: 0.61 if mesh == "sp2_L" else 0.39 / 11 for mesh in MESHES}
ALIKE = [(Locus(mesh[:2], mesh[2], mesh[4]), 1 / 12) for mesh in MESHES]
CRACK = active(effects()["tooth_crack"], SUN_2_LEFT, {"depth": 0.21, "member": "planet"})


def verdict(
    name: str, named: tuple[str, ...] = (), alike: tuple[str, ...] = (), **first: float
) -> Verdict:
    """A verdict over the whole catalogue; what is not given shares the rest."""
    others = [one for one in PHRASES if one not in first]
    chances = first | dict.fromkeys(others, (1.0 - sum(first.values())) / len(others))
    spans = tuple((0.9 * value, 1.1 * value) for value in CRACK.theta)
    best = {"tooth_crack": (NamedExplanation((CRACK,), (spans,)), 0)}
    return Verdict(name, named, chances, best, alike, "force_law", None, None, ())


def gap(before: float, after: float) -> Gap:
    return Gap(
        "force_law",
        tuple(
            RunGap(
                f"run_{i:02d}",
                "held_out" if i > 5 else "fit",
                *(size * (1 + 0.2 * i) for size in (before, after, 61.0)),
            )
            for i in range(8)
        ),
    )


def report(verdict: Verdict, **more: Any) -> Report:
    where = [(Locus(mesh[:2], mesh[2], mesh[4]), share) for mesh, share in SHARES.items()]
    where.sort(key=lambda one: -one[1])
    told = ["left and right tooth of the same number: no index pulse is recorded"]
    base = a_report(verdict, campaign="blind_07", where=where, undecidable=told)
    return replace(base, gap=gap(900.0, 80.0), **more)


ONE = report(verdict("tooth_crack", ("tooth_crack",), tooth_crack=0.93, tooth_spall=0.05))
CLASS = ("mean_stiffness", "sensor_gain", "contact_nonlinearity")
REPORTS = {
    "one": ONE,
    "none": replace(report(verdict("none", none=0.99), where=ALIKE), gap=gap(61.0, 61.0)),
    "unknown": report(verdict("unknown", unknown=0.81, damping_law=0.12)),
    "ambiguous": report(
        verdict(
            "ambiguous",
            (),
            CLASS,
            **dict(zip(CLASS, (0.5, 0.4, 0.08), strict=True)),
        ),
        where=[(Locus("sp"), 0.9), (Locus("rp"), 0.1)],
    ),
    "pair": report(
        verdict(
            "tooth_crack",
            ("tooth_crack", "thermal_stiffness"),
            tooth_crack=0.55,
            thermal_stiffness=0.4,
        )
    ),
}


class Balance(HTMLParser):
    """Every tag that is opened is closed, in order."""

    VOID = frozenset({"meta", "img", "br", "stop", "rect", "circle", "polygon", "path"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] != "style":
            self.text.append(data)


def text_of(page: str) -> str:
    parser = Balance()
    parser.feed(page)
    parser.close()
    assert not parser.open
    return " ".join(" ".join(parser.text).split())


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("one", "Cracked tooth"),
        ("none", "No gap: the nominal model"),
        ("unknown", "nothing in the catalogue explains it"),
        ("ambiguous", "cannot tell which cause it has: mesh stiffness off by a factor; or a sens"),
        ("pair", "Two causes together: cracked tooth"),
    ],
)
def test_every_verdict_is_a_sentence(name: str, said: str, tmp_path: Path) -> None:
    path = write_gap_page(REPORTS[name], tmp_path / "new")
    text = text_of(path.read_text(encoding="utf-8"))
    assert said in text
    assert "None" not in text
    assert "nan" not in text.split()
    for effect in PHRASES:
        assert effect in text  # the whole catalogue stands on the page


def test_the_page_needs_nothing_outside_it() -> None:
    assert not re.search(r'(src|href)="(?!data:)', gap_page(ONE))


def test_all_effects_have_a_phrase_of_their_own() -> None:
    assert set(effects()) <= set(PHRASES)
    assert len(set(PHRASES.values())) == len(PHRASES)


def test_twelve_meshes_with_their_shares() -> None:
    found = dict(re.findall(r'data-mesh="(\w+)" data-share="([^"]*)"', gap_page(ONE)))
    assert set(found) == set(MESHES)
    assert {mesh: float(share) for mesh, share in found.items()} == pytest.approx(SHARES, rel=1e-5)


def test_a_wide_locus_is_spread_and_the_narrowest_counts() -> None:
    shares = mesh_shares([(Locus("sp"), 0.9), (SUN_2_LEFT, 0.6)])
    assert shares["sp1_R"] == (pytest.approx(0.15), False)
    assert shares["sp2_L"] == (0.6, True)
    assert shares["rp3_R"] == (None, True)


def test_a_larger_share_is_darker() -> None:
    dark = [sum(bytes.fromhex(colour(share, 0.5)[1:])) for share in (0.0, 0.2, 0.5)]
    assert dark == sorted(dark, reverse=True)
    assert len(set(dark)) == 3
    assert colour(None, 0.5) not in {colour(share, 0.5) for share in (0.0, 0.2, 0.5)}


def test_the_mesh_of_the_named_effect_has_a_heavy_rim() -> None:
    rims = re.findall(
        r'data-mesh="(\w+)"[^>]*><title>[^<]*</title><circle class="spot heavy"', gap_page(ONE)
    )
    assert rims == ["sp2_L"]
    pair = re.findall(r'<circle class="spot heavy"', gap_page(REPORTS["pair"]))
    assert len(pair) == 1  # the other effect is everywhere


EVIL = '<script>alert("x")</script>&'


def test_all_text_is_escaped() -> None:
    evil = replace(
        ONE,
        campaign=EVIL,
        verdict=replace(ONE.verdict, verdict=EVIL, effects=(EVIL,), probabilities={EVIL: 1.0}),
        undecidable=[EVIL],
        findings=[Finding("nan", "run_00", (), None, f"a fault {EVIL}")],
        next_experiment=NextExperiment(ONE.next_experiment.point, EVIL),
        noise={EVIL: ChannelNoise(1e-6, "m", "white", (50.0,), 1e-9, 0.0, None)},
        gap=Gap("force_law", (RunGap(EVIL, EVIL, 3.0, 2.0, 1.0),)),
    )
    page = gap_page(evil)
    assert "<script" not in page
    assert page.count("&lt;script&gt;") > 9
    text_of(page)


def test_numbers_that_are_not_known_are_told_as_such() -> None:
    unknown = Gap("force_law", (RunGap("run_06", "held_out", 900.0, 80.0, math.nan),))
    fitted = NamedExplanation((CRACK,))
    broken = replace(ONE, gap=unknown, where=[])
    broken = replace(broken, verdict=replace(ONE.verdict, best={"tooth_crack": (fitted, 0)}))
    page = gap_page(broken)
    text = text_of(page)
    assert "noise floor not known" in text
    assert "depth 0.21 (interval not known)" in text
    assert page.count('data-share=""') == 12
    assert "nan" not in re.split(r"\W", text)


def test_held_out_runs_are_told_from_fit_runs() -> None:
    page = gap_page(ONE)
    assert page.count('<tr class="held">') == 2
    assert page.index("run_06") < page.index("run_00")


def test_closure_of_a_run_is_that_of_the_gap() -> None:
    """From the recalibrated gear where it is known, as in the sentence above the table."""
    run = RunGap("run_06", "held_out", nominal=10.0, augmented=3.0, floor=2.0)
    for one, closed, told in (
        (run, "88 %", "88 %"),
        (replace(run, recalibrated=6.0), "75 %", "75 %"),
        (replace(run, augmented=12.0), "-25 %", "larger, not smaller"),
        (replace(run, nominal=1.9), "not known", "is not known"),
        (replace(run, floor=math.nan), "not known", "is not known"),
    ):
        values = runs_values(Gap("force_law", (one,)), "one")
        (row,) = values["rows"]
        assert row["numbers"][-1] == closed
        assert told in values["lead"]


def test_words() -> None:
    assert locus_words(SUN_2_LEFT) == "sun mesh of planet 2, left side"
    assert locus_words(Locus("rp", "all", "R")) == "all ring meshes, right side"
    assert locus_words(ALL) == "all meshes"
    height = Estimate(1.2e-5, "m", (1.12e-5, 1.27e-5))
    assert parameter_words("height", height) == "height 12 µm (11.2 … 12.7)"
    stiffness = Estimate(2.5e9, "N/m", (2e9, 3e9))
    assert parameter_words("stiffness", stiffness) == "stiffness 2500 N/µm (2000 … 3000)"
    narrow = Estimate(0.196084, "rad", (0.196051, 0.196118))
    assert parameter_words("phase", narrow) == "phase 0.196084 rad (0.196051 … 0.196118)"
    assert parameter_words("member", Estimate("sun")) == "member sun"
    assert parameter_words("order", Estimate(3)) == "order 3"
    assert parameter_words("channels", Estimate(("u_c", "a_c"))) == "channels u_c, a_c"
    told = [percent(share) for share in (0.0, 0.0004, 0.0123, 0.61, 0.9993, 1.0, math.nan)]
    assert told == ["0 %", "< 0.1 %", "1.2 %", "61 %", "> 99.9 %", "100 %", "not known"]
    told = [percent(share) for share in (-0.0, -0.0004, -0.0123, 1.0004, 1.0012, 1.005, 1.3)]
    assert told == ["0 %", "> -0.1 %", "-1.2 %", "> 100 %", "100.1 %", "100.5 %", "130 %"]


def test_an_effect_of_the_users_own_is_readable() -> None:
    assert headline(verdict("loose_key", ("loose_key",))) == "Loose key"


def test_residual_over_the_phase_is_the_planted_one() -> None:
    phase = np.linspace(3.0, 900.0, 40000)
    planted = np.cos(phase)[:, None] * np.arange(12.0) + 5.0
    centres = (np.arange(BINS) + 0.5) * 2 * np.pi / BINS
    expected = np.cos(centres)[:, None] * np.arange(12.0) + 5.0
    np.testing.assert_allclose(mean_over_phase(phase, planted), expected, atol=0.05)


def test_figures_are_in_the_page(tmp_path: Path) -> None:
    phase = np.linspace(0, 2 * np.pi, 24)
    contact = np.tile([0.6, 0.3, 0.1], (12, 1))
    arrays = GapArrays(
        phase,
        np.outer(np.cos(phase), np.arange(12.0)),
        contact,
        {"load": {"220 N m": 0.4, "330 N m": 0.6}},
    )
    page = write_gap_page(ONE, tmp_path, arrays).read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 3
    assert len(list((tmp_path / "figures").glob("gap_*.svg"))) == 3
    text_of(page)


def test_places_without_a_mesh_are_named() -> None:
    assert place_words(Cause("torque_ripple", ALL, 1.0)) == "input shaft"
    assert place_words(Cause("sensor_gain", ALL, 1.0)) == "sensors"
    sun = Cause("runout", ALL, 1.0, {"member": Estimate("sun")})
    assert place_words(sun) == "sun"
    assert bodies(sun) == {"sun_L", "sun_R"}
    left = Locus("all", "2", "L")
    assert bodies(Cause("pin_position", left, 1.0)) == {"planet2_L"}
    assert bodies(Cause("mean_stiffness", left, 1.0)) == set()


def test_what_closes_the_gap_is_named_by_the_verdict() -> None:
    assert closure_words(0.968, "one") == "adding it closes 97 % of the gap on held-out runs"
    assert closure_words(0.968, "pair").startswith("adding both closes")
    assert "recalibrating" in closure_words(0.1, "none")
    assert closure_words(math.nan, "none") == "there is no gap to close"
    assert "larger" in closure_words(-0.1, "one")


def test_figures_are_short() -> None:
    told = [figure(value) for value in (1234.4, 98.0, 999.7, 0.12345, -56789.0, 1.5e9)]
    assert told == ["1234", "98", "1000", "0.123", "-56789", "1.5e+09"]
    assert figure(math.nan) == "not known"


def test_few_sensors_are_told_what_one_more_would_tell(tmp_path: Path) -> None:
    noise = ChannelNoise(1e-6, "m", "white", (), 1e-9, 0.0, None)
    names = ("u_c", "u_s_L", "u_s_R", "a_c")
    few = replace(ONE, observations=["trajectory"], noise=dict.fromkeys(names, noise))
    command = plan_command(few, Path("rig.yaml"), tmp_path)
    assert "gap plan --nominal rig.yaml --sensors a_c,u_c,u_s_L,u_s_R" in command
    assert "--also F_pin1,F_rp1_L,u_p1_L" in command
    assert "gap plan" in gap_page(few, (), "", command)
    assert plan_command(replace(few, observations=["force_law"]), Path("r"), tmp_path) == ""


def test_a_planet_that_nothing_tells_from_the_others_is_not_named_alone() -> None:
    """A cause at planet 2: the same share at every planet says that it may sit at another."""
    told = "or at another planet: nothing tells them apart"
    assert told in gap_page(replace(ONE, where=ALIKE))
    assert told not in gap_page(ONE)
    assert told not in gap_page(REPORTS["none"])


def test_without_an_observation_no_gap_is_stated() -> None:
    assert "not known" in headline(verdict("unknown", unknown=0.5, none=0.5))
    assert "There is a gap" in headline(verdict("unknown", unknown=0.8))


@pytest.mark.parametrize(("after", "said"), [(61.0, "is not known"), (1500.0, "not smaller")])
def test_verify_tells_a_closure_that_is_not_known_or_negative(after: float, said: str) -> None:
    before = 61.0 if after == 61.0 else 900.0
    one = Gap("force_law", (RunGap("r", "fit", before, after, 61.0),))
    same = (RunGap("r", "fit", 1.0, 1.0, 1.0),)
    senses = Senses(one, Gap("prediction", same), Gap("attractor", same))
    earlier = StoredReport("rig", "runout", ("runout",), "force_law", {})
    page = verify_page(Repetition("rig", earlier, senses, ()))
    assert said in page.split("</h1>")[0]
