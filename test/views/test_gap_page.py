"""The page of a gap diagnosis: every verdict in words, twelve meshes with their shares."""

from __future__ import annotations

import copy
import math
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from herringbone_sim.effects.registry import effects
from herringbone_sim.views.figures.gap import GapArrays
from herringbone_sim.views.figures.gap_arrays import BINS, mean_over_phase
from herringbone_sim.views.pages.gap.page import gap_page, plan_command, write_gap_page
from herringbone_sim.views.pages.gap.tables import closure
from herringbone_sim.views.pages.gap.verdict import headline
from herringbone_sim.views.pages.gap.where import bodies
from herringbone_sim.views.pages.gap.words import (
    PHRASES,
    closure_words,
    figure,
    locus_words,
    parameter_words,
    percent,
    place_words,
)
from herringbone_sim.views.pages.gear_drawing import MESHES, colour, mesh_shares

ALL = {"mesh": "all", "planet": "all", "side": "all"}
SUN_2_LEFT = {"mesh": "sp", "planet": "2", "side": "L"}
DEPTH = {"value": 0.21, "unit": "-", "ci90": [0.19, 0.23]}
SHARES = {mesh: 0.61 if mesh == "sp2_L" else 0.39 / 11 for mesh in MESHES}


def locus(mesh: str) -> dict[str, str]:
    return {"mesh": mesh[:2], "planet": mesh[2], "side": mesh[4]}


def causes(**first: float) -> list[dict[str, Any]]:
    """The whole catalogue; what is not given shares the rest."""
    others = [one for one in PHRASES if one not in first]
    chances = first | dict.fromkeys(others, (1.0 - sum(first.values())) / len(others))
    parameters = {"depth": DEPTH, "member": {"value": "planet", "unit": "-"}}
    return [
        {
            "effect": effect,
            "locus": SUN_2_LEFT if effect == "tooth_crack" else ALL,
            "probability": chance,
            "parameters": parameters if effect == "tooth_crack" else {},
        }
        for effect, chance in chances.items()
    ]


def runs(before: float, after: float) -> list[dict[str, Any]]:
    return [
        {
            "path": f"run_{i:02d}",
            "role": "held_out" if i > 5 else "fit",
            "nominal": before * (1 + 0.2 * i),
            "augmented": after * (1 + 0.2 * i),
            "noise_floor": 61.0 * (1 + 0.2 * i),
        }
        for i in range(8)
    ]


def report(
    verdict: str, named: list[str], chances: dict[str, float], **more: Any
) -> dict[str, Any]:
    attractor = {"contact": {"drive": 0.61, "back": 0.12}, "load_sharing": 1.31}
    gap = {"metric": "force_law", "nominal": 1234.0, "augmented": 98.0, "noise_floor": 61.0}
    base = {
        "schema": "herringbone_sim/gap-report/1",
        "campaign": "blind_07",
        "verdict": verdict,
        "effects": named,
        "where": [{"locus": locus(mesh), "share": share} for mesh, share in SHARES.items()],
        "causes": causes(**chances),
        "ambiguous_with": [],
        "gap": {**gap, "closure": 0.968, "runs": runs(900.0, 80.0)},
        "attractor": {"nominal": attractor, "augmented": attractor | {"load_sharing": 1.18}},
        "undecidable": ["left and right tooth of the same number: no index pulse is recorded"],
        "next_experiment": {
            **{"delta_T": 70.0, "K": 0.0, "T_1": 440.0, "Omega": 0.6},
            "why": "at twice the load a crack grows and a spall does not",
        },
    }
    return base | more


ONE = report("tooth_crack", ["tooth_crack"], {"tooth_crack": 0.93, "tooth_spall": 0.05})
REPORTS: dict[str, dict[str, Any]] = {
    "one": ONE,
    "none": report(
        "none",
        [],
        {"none": 0.99},
        where=[{"locus": locus(mesh), "share": 1 / 12} for mesh in MESHES],
        gap={
            **{"metric": "force_law", "nominal": 61.4, "augmented": 61.4, "noise_floor": 61.0},
            "closure": None,
            "runs": runs(61.4, 61.4),
        },
        next_experiment=None,
        undecidable=[],
    ),
    "unknown": report("unknown", [], {"unknown": 0.81, "damping_law": 0.12}),
    "ambiguous": report(
        "ambiguous",
        [],
        {"mean_stiffness": 0.5, "sensor_gain": 0.4, "contact_nonlinearity": 0.08},
        ambiguous_with=["mean_stiffness", "sensor_gain", "contact_nonlinearity"],
        where=[
            {"locus": {"mesh": "sp", "planet": "all", "side": "all"}, "share": 0.9},
            {"locus": {"mesh": "rp", "planet": "all", "side": "all"}, "share": 0.1},
        ],
    ),
    "pair": report(
        "tooth_crack",
        ["tooth_crack", "thermal_stiffness"],
        {"tooth_crack": 0.55, "thermal_stiffness": 0.4},
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
        if self.open[-1] != "style":
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
    wide = {"locus": {"mesh": "sp", "planet": "all", "side": "all"}, "share": 0.9}
    shares = mesh_shares([wide, {"locus": SUN_2_LEFT, "share": 0.6}])
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


def spoilt(value: Any) -> Any:
    """The same report with markup in every text."""
    if isinstance(value, dict):
        return {key: spoilt(one) for key, one in value.items()}
    if isinstance(value, list):
        return [spoilt(one) for one in value]
    return value + EVIL if isinstance(value, str) else value


def test_all_text_is_escaped() -> None:
    page = gap_page(spoilt(ONE))
    assert "<script" not in page
    assert page.count("&lt;script&gt;") > 20
    text_of(page)


def paths(value: Any, before: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    pairs = (
        list(value.items())
        if isinstance(value, dict)
        else list(enumerate(value[:2]))
        if isinstance(value, list)
        else []
    )
    return [p for key, one in pairs for p in [(*before, key), *paths(one, (*before, key))]]


@pytest.mark.parametrize("hole", [None, math.nan, "absent"])
def test_anything_may_be_missing(hole: Any) -> None:
    for path in paths(ONE):
        broken = copy.deepcopy(ONE)
        *above, last = path
        parent: Any = broken
        for key in above:
            parent = parent[key]
        if hole == "absent":
            del parent[last]
        else:
            parent[last] = hole
        text = text_of(gap_page(broken))
        assert "None" not in text, path
        assert "nan" not in re.split(r"\W", text), path


def test_an_empty_report_says_what_is_not_known() -> None:
    page = gap_page({})
    text = text_of(page)
    assert "gives no verdict" in text
    assert text.count("not known") >= 6
    assert page.count('data-share=""') == 12


def test_missing_numbers_are_told_as_not_known() -> None:
    broken = copy.deepcopy(ONE)
    broken["gap"]["noise_floor"] = None
    broken["causes"][0]["parameters"]["depth"]["ci90"] = None
    text = text_of(gap_page(broken))
    assert "noise floor not known" in text
    assert "depth 0.21 (interval not known)" in text


def test_held_out_runs_are_told_from_fit_runs() -> None:
    page = gap_page(ONE)
    assert page.count('<tr class="held">') == 2
    assert page.index("run_06") < page.index("run_00")


def test_closure_of_a_run() -> None:
    run = {"nominal": 10.0, "augmented": 3.0, "noise_floor": 2.0}
    assert closure(run) == pytest.approx(7 / 8)
    assert closure(run | {"augmented": 12.0}) == pytest.approx(-2 / 8)
    assert closure(run | {"nominal": 1.9}) is None
    assert closure(run | {"noise_floor": None}) is None


def test_words() -> None:
    assert locus_words(SUN_2_LEFT) == "sun mesh of planet 2, left side"
    assert (
        locus_words({"mesh": "rp", "planet": "all", "side": "R"}) == "all ring meshes, right side"
    )
    assert locus_words(ALL) == "all meshes"
    assert locus_words(None) == "place not known"
    height = {"value": 1.2e-5, "unit": "m", "ci90": [1.12e-5, 1.27e-5]}
    assert parameter_words("height", height) == "height 12 µm (11.2 … 12.7)"
    stiffness = {"value": 2.5e9, "unit": "N/m", "ci90": [2e9, 3e9]}
    assert parameter_words("stiffness", stiffness) == "stiffness 2500 N/µm (2000 … 3000)"
    narrow = {"value": 0.196084, "unit": "rad", "ci90": [0.196051, 0.196118]}
    assert parameter_words("phase", narrow) == "phase 0.196084 rad (0.196051 … 0.196118)"
    assert parameter_words("member", {"value": "sun", "unit": "-"}) == "member sun"
    told = [percent(share) for share in (0.0, 0.0004, 0.0123, 0.61, 0.9993, 1.0, None)]
    assert told == ["0 %", "< 0.1 %", "1.2 %", "61 %", "> 99.9 %", "100 %", "not known"]


def test_an_effect_of_the_users_own_is_readable() -> None:
    assert headline({"verdict": "loose_key", "effects": ["loose_key"]}) == "Loose key"


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
    assert place_words({"effect": "torque_ripple", "locus": ALL}) == "input shaft"
    assert place_words({"effect": "sensor_gain", "locus": ALL}) == "sensors"
    sun = {"effect": "runout", "locus": ALL, "parameters": {"member": {"value": "sun"}}}
    assert place_words(sun) == "sun"
    assert bodies(sun) == {"sun_L", "sun_R"}
    left = {"mesh": "all", "planet": "2", "side": "L"}
    assert bodies({"effect": "pin_position", "locus": left}) == {"planet2_L"}
    assert bodies({"effect": "mean_stiffness", "locus": left}) == set()


def test_what_closes_the_gap_is_named_by_the_verdict() -> None:
    assert closure_words(0.968, "one") == "adding it closes 97 % of the gap on held-out runs"
    assert closure_words(0.968, "pair").startswith("adding both closes")
    assert "recalibrating" in closure_words(0.1, "none")
    assert closure_words(None, "none") == "there is no gap to close"
    assert "larger" in closure_words(-0.1, "one")


def test_figures_are_short() -> None:
    told = [figure(value) for value in (1234.4, 98.0, 0.12345, -56789.0, 1.5e9, None)]
    assert told == ["1234", "98", "0.123", "-56789", "1.5e+09", "not known"]


def test_few_sensors_are_told_what_one_more_would_tell(tmp_path: Path) -> None:
    said = {"observations": ["trajectory"], "recorded": ["u_c", "u_s_L", "u_s_R", "a_c"]}
    command = plan_command(said, Path("rig.yaml"), tmp_path)
    assert "gap plan --nominal rig.yaml --sensors u_c,u_s_L,u_s_R,a_c" in command
    assert "--also F_pin1,F_rp1_L,u_p1_L" in command
    assert "gap plan" in gap_page({}, (), "", command)
    assert plan_command({**said, "observations": ["force_law"]}, Path("rig.yaml"), tmp_path) == ""


def test_a_planet_that_nothing_tells_from_the_others_is_not_named_alone() -> None:
    """A cause at planet 2: the same share at every planet says that it may sit at another."""
    told = "or at another planet: nothing tells them apart"
    alike = [{"locus": locus(mesh), "share": 1 / 12} for mesh in MESHES]
    assert told in gap_page(ONE | {"where": alike})
    assert told not in gap_page(ONE)
    assert told not in gap_page(REPORTS["none"])
