"""What the words after a verb become, and what is said of those that are wrong."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from herringbone_sim.__main__ import VERBS, main, split_ros
from herringbone_sim.cli import gap_live, run
from herringbone_sim.cli.arguments import ArgumentError, help_of, parse

GAP = ["--nominal", "rig.yaml", "--out", "x"]
SWEEP = ["--over", "K=0:1:4", "--out", "x"]
ORBITS = ["--over", "delta_T", "--from", "70", "--to", "90", "--out", "x"]


def asked(verb: str, *words: str) -> dict[str, Any]:
    """Arguments of ``run`` by name, positional ones by ``0``, ``1``."""
    call: Any = parse(verb, words)
    return {**{str(i): value for i, value in enumerate(call.args)}, **call.keywords}


@pytest.mark.parametrize(
    ("words", "where"),
    [
        ([], None),
        (["--rerun"], "save"),
        (["--rerun", "serve=9876"], "serve=9876"),
        (["--rerun=connect"], "connect"),
    ],
)
def test_a_value_that_may_be_left_out(words: list[str], where: str | None) -> None:
    """Before and after a positional argument, before another option and at the end."""
    alone = words == ["--rerun"]
    orders = [["campaign", *GAP, *words], ["campaign", *words, *GAP]]
    orders += [] if alone else [[*words, "campaign", *GAP], [*GAP, *words, "campaign"]]
    for order in orders:
        given = asked("gap", *order)
        assert given["0"] == Path("campaign")
        assert given.get("rerun") == where


def test_options_with_values_of_their_own_left_out() -> None:
    assert asked("show", "run", "--serve")["options"].serve == "9876"
    assert asked("show", "--serve", "0.0.0.0:1", "run")["options"].serve == "0.0.0.0:1"
    assert asked("replay", "run", "--publish", "--clock")["sending"].clock == 40.0
    assert asked("replay", "--publish", "--clock", "8", "run", "-l")["sending"].clock == 8.0


def test_order_and_form_of_options_do_not_matter() -> None:
    one = asked("compare", "a.yaml", "b.yaml", *SWEEP, "--starts", "0", "--set", "xi=0.1")
    other = asked(
        "compare", "--starts=0", "--set=xi=0.1", "--over=K=0:1:4", "--out=x", "a.yaml", "b.yaml"
    )
    assert one == other
    assert (one["0"], one["options"].set) == (Path("a.yaml"), ("xi=0.1",))


def test_the_last_of_an_option_counts_unless_it_is_a_list() -> None:
    given = asked(
        "sweep", *SWEEP, "--over", "xi=0.1,0.2", "--out", "y", "--set", "a=1", "--set", "b=2"
    )
    assert given["over"] == ("K=0:1:4", "xi=0.1,0.2")
    assert given["out"] == Path("y")
    assert given["gear"].set == ("a=1", "b=2")


def test_negative_numbers_are_values() -> None:
    words = ["--from", "-3", "--to=-1e-3", "--start", "-2:4", "-1.5"]
    options = asked("orbits", "--over", "delta_T", "--out", "x", *words)["options"]
    assert (options.low, options.high) == (-3.0, -1e-3)
    assert options.start == ((-2.0, 4), (-1.5, None))
    assert asked("rig make", "--out", "x", "--snr", "-6")["options"].snr == -6.0


def test_lists_and_words_that_only_look_like_others() -> None:
    setting = asked("gap bench", "--d", "3,10", "--samples", "8", "--noise", "white, steps")[
        "setting"
    ]
    assert (setting.d, setting.samples) == ((3.0, 10.0), (8.0,))
    assert setting.noise == ("white", "steps")
    assert asked("gap bench", "--table", "a", "b")["table"] == (Path("a"), Path("b"))
    options = asked("gap plan", *GAP, "--sensors", "u,u_c", "--points", "K=0", "K=1")["options"]
    assert (options.sensors, options.points) == (("u", "u_c"), ("K=0", "K=1"))
    given = asked("sweep", "--over", "K=0:1:4", "--out", "none", "--mesh", "none", "--effects", "")
    assert (given["out"], given["mesh"], given["gear"].effects) == (Path("none"), "none", "")
    assert asked("info", "--", "--json")["0"] == Path("--json")


@pytest.mark.parametrize(
    ("words", "own", "passed"),
    [
        (["--ros-args", "-p", "record:=true"], {}, ["--ros-args", "-p", "record:=true"]),
        (
            ["--parameters", "a.yaml", "--ros-args", "-r", "a:=b", "--", "--version"],
            {"parameters": Path("a.yaml"), "version": True},
            ["--ros-args", "-r", "a:=b", "--"],
        ),
    ],
)
def test_what_is_for_ros_is_handed_on_as_it_is(
    words: list[str], own: dict[str, Any], passed: list[str]
) -> None:
    call: Any = parse("run", *split_ros(words))
    assert call.func is run.run
    assert {name: call.keywords[name] for name in own} == own
    assert call.keywords["of_ros"] == passed


@pytest.mark.parametrize(
    ("verb", "words", "told"),
    [
        ("sweep", [], "--over NAME=LOW:HIGH:COUNT, --out DIR must be given"),
        ("sweep", ["--out", "x"], "--over NAME=LOW:HIGH:COUNT must be given"),
        ("gap", [], "CAMPAIGN, --nominal FILE, --out DIR must be given"),
        ("gap", ["campaign", "--out=x"], "--nominal FILE must be given"),
        ("compare", ["a"], "AUGMENTED, --over NAME=LOW:HIGH:COUNT, --out DIR must be given"),
        ("sweep", [*SWEEP, "--workers"], "--workers needs a value"),
        ("gap bench", ["--table"], "--table needs a value"),
        ("sweep", [*SWEEP, "--workers", "two"], "--workers must be a whole number, got 'two'"),
        ("sweep", [*SWEEP, "--transient", "1.5"], "--transient must be a whole number, got '1.5'"),
        ("sweep", [*SWEEP, "--workers", "0"], "--workers must be >= 1, got '0'"),
        ("rig make", ["--out=x", "--seed=-1"], "--seed must be >= 0, got '-1'"),
        (
            "orbits",
            [*ORBITS, "--start", "85:99"],
            "--start must be finite values with periods in 1 .. 64, got '85:99'",
        ),
        ("reproduce", ["--out=x", "--xi", "a"], "--xi must be a number, got 'a'"),
        ("gap live", ["--every", "0"], "--every must be > 0.0, got '0'"),
        (
            "gap bench",
            ["--snr", "loud"],
            "--snr must be finite numbers, separated by commas, got 'loud'",
        ),
        ("info", ["run", "--json=maybe"], "--json must be true or false, got 'maybe'"),
        (
            "map",
            ["--kind", "K", "--out", "x"],
            "--kind must be one of delta_T-K, delta_T-xi, Omega-T_1, got 'K'",
        ),
        ("map", ["--out", "x"], "one of --over, --kind must be given, got none"),
        (
            "replay",
            ["run", "--verify", "--publish"],
            "one of --verify, --publish must be given, got --verify and --publish",
        ),
        (
            "show",
            ["run", "--spawn", "--connect=box:1"],
            "at most one of --spawn, --save, --serve, --connect must be given, got --spawn and "
            "--connect",
        ),
        (
            "sweep",
            [*SWEEP, "--wrokers", "2"],
            "unknown arguments --wrokers 2: did you mean --workers?",
        ),
        ("rig make", ["--out", "x", "--snr", "nan"], "--snr must be < 1000, got 'nan'"),
        (
            "orbits",
            ["--over", "xi", "--from", "0", "--to", "1", "--out", "x", "--start", "1", "a", "2"],
            "--start must be values such as 85 or 85:2, got '1 a 2'",
        ),
        ("info", ["--jsn"], "unknown arguments --jsn: did you mean --json?"),
        (
            "sweep",
            ["--ovr", "K=0:1:2", "--out", "x"],
            "unknown arguments --ovr: did you mean --over?",
        ),
        (
            "sweep",
            [*SWEEP, "--trans", "2"],
            "unknown arguments --trans 2: did you mean --transient?",
        ),
        ("sweep", [*SWEEP, "--no-mesh"], "unknown arguments --no-mesh: did you mean --mesh?"),
        ("sweep", [*SWEEP, "extra"], "unknown arguments extra:"),
    ],
)
def test_wrong_arguments_give_one_line_with_the_rule(
    verb: str, words: Sequence[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*verb.split(), *words]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err == f"error: {told}{' ' if told[-1] in '?:' else ': '}see --help\n"


@pytest.mark.parametrize("out", ["", ".", "..", "made/.."])
def test_demo_does_not_replace_the_folder_that_one_is_in(
    out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    inside = tmp_path / "here"
    inside.mkdir()
    (inside / "mine.txt").write_text("mine")
    monkeypatch.chdir(inside)
    assert main(["demo", "--out", out, "--force"]) == 2
    assert "where you are, or above it: name another --out" in capsys.readouterr().err
    assert (inside / "mine.txt").read_text() == "mine"


def test_what_is_wrong_is_an_error_of_its_own() -> None:
    with pytest.raises(ArgumentError, match="RUN must be given"):
        parse("info", [])


@pytest.mark.parametrize("verb", VERBS)
def test_help_fits_a_terminal(verb: str) -> None:
    """But for examples, which are as they are written."""
    described = help_of(verb).partition("\nexample")[0]
    assert max(map(len, described.splitlines())) < 80
    assert not [line for line in help_of(verb).splitlines() if line != line.rstrip()]


def test_defaults_are_shown() -> None:
    text = " ".join(help_of("rig make").split())
    assert "--seed N of all random numbers [0]" in text
    assert "--tolerance SHARE of the parameters, as a share [0.02]" in text
    assert "--hidden draw the effects by the seed --runs N runs [8]" in text
    assert "--d D,... detectabilities to draw from [3,10]" in " ".join(
        help_of("gap bench").split()
    )
    assert gap_live.Options().seconds == float("inf")


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("map --over K=0:1:2 --over delta_T=0:9:2 --size 5 --out {}/m", "--size"),
        ("gap bench --table {}/stored --seeds 1:3 --out {}/b", "--table"),
        ("gap calibrate --evidence {}/e --seeds 1:3 --folder {}/f --out {}/w.json", "--evidence"),
        ("rig make --cycles 0 --runs 1 --held-out 0 --out {}/rigs/none", "--cycles"),
        (
            "gap plan --nominal {ROOT}/config/rig.yaml --sensors u_s_L,u_c --noise angel=1e-6 "
            "--out {}/p",
            "angel",
        ),
    ],
)
def test_what_would_be_ignored_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: str, named: str
) -> None:
    root = str(Path(__file__).parents[2])
    line = [w.replace("{ROOT}", root).replace("{}", str(tmp_path)) for w in words.split()]
    assert main(line) == 2
    assert named in capsys.readouterr().err
