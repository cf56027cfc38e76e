"""Verbs that take gears with effects: against parameters that say the same, and against order."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from gears import PAPER

from herringbone_sim.__main__ import main
from herringbone_sim.cli.control_parts import Size
from herringbone_sim.control.amplitude import Target, run_survey
from herringbone_sim.control.runs import MotionRunner, RunSettings
from herringbone_sim.control.starts import Starts, start_states
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.exponent_methods import compare_exponents
from herringbone_sim.dynamics.flow import GearFlow, effect_cycles, settle, symmetry
from herringbone_sim.dynamics.orbits import find_orbit, multipliers
from herringbone_sim.dynamics.spectrum import lyapunov_spectrum
from herringbone_sim.dynamics.turning import SAMPLES, border_passes, displacement
from herringbone_sim.effects.assemble import build_with, changed
from herringbone_sim.effects.written import read_effects
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.parameter_file import save_parameters
from herringbone_sim.sweeps.grid import Axis

SOFT, SAME = "mean_stiffness:factor=0.95", "k_factor=0.95"
CRACK = "tooth_crack@sp/all/L:depth=0.3"
TINY = Size(2, 3, 4, (0.5, 1.0), 2, RunSettings(transient=40, cycles=40))
PIN = 2e-5
FULL = {"model": "full"}


def gear(text: str = "", **values: object):
    return build_with(Parameters(**{"delta_T": 85.0, **values}), read_effects(text))


def planet_1(value: float) -> tuple[float, ...]:
    return tuple(value if m % 3 == 0 else 0.0 for m in range(12))


@pytest.mark.parametrize(
    ("text", "values", "always"),
    [
        ("mean_stiffness@rp:factor=0.9", {"k_factor": (1.0, 1.0, 0.9, 0.9)}, {}),
        ("backlash_offset@sp/all/L:offset=1e-5", {"b_offset": (1e-5, 0.0, 0.0, 0.0)}, {}),
        ("stagger@all/all/L:phase=0.3", {"mesh_phase": (0.3, 0.0, 0.3, 0.0)}, {}),
        (f"pin_position@all/1/all:offset={PIN}", {"e_offset": planet_1(PIN)}, FULL),
        ("planet_phase@all/1/all:phase=0.2", {"mesh_phase": planet_1(0.2)}, FULL),
    ],
)
def test_the_map_is_that_of_the_parameter_that_says_the_same(text, values, always) -> None:
    """States are coordinates of the bodies: an unknown error and a known one are one to them."""
    flow, other = GearFlow(gear(text, **always)), GearFlow(gear(**always, **values))
    y = settle(other, other.start(), 30)
    for mine, wanted in zip(flow.map(y), other.map(y), strict=True):
        np.testing.assert_allclose(mine, wanted, atol=1e-10)
    assert (symmetry(flow.model) is None) == (symmetry(other.model) is None)
    passes = border_passes(flow, y[None])
    assert passes == border_passes(other, y[None])
    assert sum(passes.values()) > 0


def test_effects_stay_on_a_gear_that_changes() -> None:
    model = gear(CRACK)
    other = changed(model, model.parameters.changed({"delta_T": 80.0}))
    assert other.effects == model.effects
    assert len(other.packed.events) == 1


def test_a_displacement_is_what_samples_do_not_show() -> None:
    """Against the difference of two gears whose coordinates are the same."""
    text = "runout@sp:amplitude=2e-5; tooth_spall@sp/all/L:height=1e-5; pin_position:offset=1e-5"
    model = gear(text)
    cycles = np.arange(27 * SAMPLES) / SAMPLES
    d, rate = displacement(model, cycles)
    by_differences = np.gradient(d, 2 * np.pi / SAMPLES / model.packed.Omega, axis=0)
    assert np.abs(d).max() > 2e-5 / model.scales.b_c
    errors = np.abs(rate - by_differences)[1:-1] / np.abs(rate).max()
    assert (errors > 2e-3).sum() <= 2  # the edges of the event, where the rate has a kink
    np.testing.assert_allclose(d[0, 3], -1e-5 / model.scales.b_c)


def test_exponents_of_a_cracked_gear_need_no_period() -> None:
    """Their sum is the loss by damping; the motion repeats once a revolution of the sun."""
    found = compare_exponents(gear(CRACK), 300, 300)
    assert float(found.spectrum.exponents.sum()) == pytest.approx(found.divergence, rel=1e-9)
    assert found.symmetric is None
    assert found.longest == 64 * 27
    assert found.motion in ("P27", "a long period")
    rings = ";".join(f"tooth_crack@{mesh}:member={m}" for mesh, m in MEMBERS)
    told = compare_exponents(gear(rings), 300, 50)
    assert told.motion == "a long period, left = right"
    assert told.longest == 64


MEMBERS = (("sp", "sun"), ("rp", "ring"), ("all", "planet"))


def test_an_orbit_of_a_cracked_gear_takes_a_revolution() -> None:
    """Its multiplier is the growth that the exponent tells, over 27 mesh cycles."""
    model = gear(CRACK)
    flow = GearFlow(model)
    assert flow.cycles == 27
    y = settle(flow, flow.start(), 20)
    orbit = find_orbit(flow, y[None])
    assert orbit.converged
    assert np.abs(flow.advance(orbit.points[0], np.zeros((0, flow.n)))[0] - y).max() < 1e-6
    largest = np.log(np.abs(multipliers(orbit).all[0])) / flow.period
    once = GearFlow(model, 1)
    assert np.abs(once.advance(y, np.zeros((0, flow.n)))[0] - y).max() > 1e-4
    found = lyapunov_spectrum(once, orbit.points[0], 27 * 20, 27 * 5, k=1)
    assert found.exponents[0] == pytest.approx(largest, abs=1e-3)


def test_a_ring_has_orbits_and_all_members_together_have_none() -> None:
    assert GearFlow(gear("tooth_crack@rp/all/L:member=ring")).cycles == 77
    model = gear(";".join(f"runout@{mesh}:member={member}" for mesh, member in MEMBERS))
    with pytest.raises(ParameterError, match="repeat together after 51975: leave one out"):
        GearFlow(model)
    assert effect_cycles(model) == 1
    assert GearFlow(model, 1).cycles == 1


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def agree(one: Path, other: Path, tolerance: float = 1e-4) -> None:
    """Two tables, but for trajectories so near each other that rounding parts them."""
    rows, wanted = (
        [row for row in table(path) if "at 1e-1" not in row.get("quantity", "")]
        for path in (one, other)
    )
    assert len(rows) == len(wanted) > 0
    for mine, theirs in zip(rows, wanted, strict=True):
        for name, text in mine.items():
            value = number(theirs[name])
            if isinstance(value, str):
                assert text == value
            else:
                assert number(text) == pytest.approx(value, abs=tolerance, nan_ok=True), name


SPAN = ["--over=xi", "--from=0.17"]
SHORT = ["--transient=600", "--workers=1"]
VERBS = {
    "exponents.csv": ["exponents", "--cycles=300", "--transient=300"],
    "branches.csv": ["orbits", *SPAN, "--to=0.175", "--start=0.17", "--settle=300"],
    "basins.csv": ["basins", "--starts=5", "--points=60", *SHORT],
    "survival.csv": ["survival", *SPAN, "--to=0.18", "--values=2", "--starts=2", *SHORT],
}
CONTROL = ["control", "--only=amplitude", "--quick", "--workers=1"]


@pytest.mark.parametrize("name", VERBS)
def test_a_verb_tells_of_an_effect_what_it_tells_of_the_parameter(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    common = [*VERBS[name], f"--parameters={PAPER}", "--set=delta_T=85"]
    folders = tmp_path / "effect", tmp_path / "parameter"
    for folder, more in zip(folders, (f"--effects={SOFT}", f"--set={SAME}"), strict=True):
        assert main([*common, more, f"--out={folder}"]) == 0
        told = capsys.readouterr().out
        assert ("with effects: mean_stiffness@all/all/all:factor=0.95" in told) == (
            folder.name == "effect"
        )
        assert "not alike" not in told
    agree(*(folder / name for folder in folders))


def test_control_of_an_effect_is_that_of_the_parameter() -> None:
    """Of motions that settle: what is chaotic hangs on rounding."""
    p, settings = Parameters(delta_T=85.0), RunSettings(600, 60, exponents=True)
    sets = [p.changed({"K": K}) for K in (0.0, 0.2, 0.4)]
    runner, other = MotionRunner(actives=read_effects(SOFT)), MotionRunner()
    begin = start_states(runner, sets, Starts(1, 1)).reshape(-1, 8)
    each = [one for one in sets for _ in range(len(begin) // 3)]
    found = runner.run(each, begin, settings)
    wanted = other.run([one.changed({"k_factor": [0.95]}) for one in each], begin, settings)
    assert np.array_equal(found.period, wanted.period, equal_nan=True)
    settled = found.period > 0
    assert settled.sum() > 6
    np.testing.assert_allclose(found.end[settled], wanted.end[settled], atol=1e-5)
    np.testing.assert_allclose(found.exponent[settled], wanted.exponent[settled], atol=1e-4)


def test_control_of_a_cracked_gear_counts_periods_of_the_crack(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    runner = MotionRunner(actives=read_effects(CRACK))
    p, K = Parameters(), np.array([0.0, 0.1])
    survey = run_survey(
        runner, p, Axis("delta_T", (85.0,)), K, Starts(0, 0, running=False), RunSettings(200, 20)
    )
    assert survey.of("period").ravel().tolist() == [27.0, 27.0]
    assert survey.reached(Target(1, "zero")).all()
    monkeypatch.setattr("herringbone_sim.cli.control.QUICK", TINY)
    assert main([*CONTROL, f"--effects={CRACK}", f"--out={tmp_path}"]) == 0
    told = capsys.readouterr().out
    assert "with effects: tooth_crack@sp/all/L" in told
    assert "not alike" in told
    assert len(table(tmp_path / "amplitude.csv")) == 2 * 3 * 6


def test_reproduce_takes_effects_of_its_file(tmp_path: Path) -> None:
    """The values of scenario D that its sweep is made of: with the effect and with k_factor."""
    base, few = Parameters(), ["--only=D", "--values=2", "--compared=0", "--workers=1"]
    files = tmp_path / "effect.yaml", tmp_path / "parameter.yaml"
    save_parameters(files[0], base, actives=read_effects(SOFT))
    save_parameters(files[1], base.changed({"k_factor": [0.95]}))
    for file in files:
        out = tmp_path / file.stem
        assert main(["reproduce", f"--parameters={file}", *few, f"--out={out}"]) == 0
    agree(*(tmp_path / file.stem / "statements.csv" for file in files))
    assert "mean_stiffness" in (tmp_path / "effect" / "index.html").read_text()
    assert "mean_stiffness" not in (tmp_path / "parameter" / "index.html").read_text()


@pytest.mark.parametrize("name", ["exponents.csv", "basins.csv", "survival.csv"])
def test_halves_that_are_not_alike_are_told(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [*VERBS[name], "--effects=stagger@all/all/L:phase=0.1", "--set=delta_T=85"]
    assert main([*command, f"--out={tmp_path}"]) == 0
    told = capsys.readouterr().out
    assert told.count("left and right of this gear are not alike") == 1
    assert "left and right part" not in told
    assert "left = right" not in told


def test_a_sweep_looks_long_enough_at_what_repeats_once_a_revolution(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["sweep", "--over=delta_T=85:90:2", f"--effects={CRACK}", "--workers=1"]
    assert main([*command, f"--out={tmp_path / 'long'}"]) == 0
    told = capsys.readouterr().out
    assert "P27 100.0%" in told
    assert "not alike" in told
    assert main([*command, "--cycles=100", f"--out={tmp_path / 'short'}"]) == 0
    assert "no period is told from fewer than 135" in capsys.readouterr().out


def test_verbs_take_an_effect_with_laws_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A law that makes all meshes softer gives what the parameter gives."""
    own = tmp_path / "own.py"
    own.write_text(
        "from herringbone_sim.effects.effect import Effect, Parameter\n"
        "from herringbone_sim.effects.law import STIFFNESS, law\n"
        "@law\n"
        "def excite(theta, site, gear, now, added_states, law):\n"
        "    for m in range(law.shape[1]):\n"
        "        law[STIFFNESS, m] *= theta[0]\n"
        "EFFECT = Effect(id='own_law', text='soft', level='mesh', excite=excite,\n"
        "    parameters=(Parameter('factor', '-', 'of k', 0.5, 1.5, 0.95, 1.0),))\n"
    )
    monkeypatch.setenv("HERRINGBONE_EFFECTS", str(own))
    seen = {
        "exponents.csv": [("exponent 1", "value"), ("exponent 5", "value"), ("sum", "value")],
        "branches.csv": [("0.17", "within_re"), ("0.17", "stability")],
        "basins.csv": [("1", "share"), ("1", "exponent_per_tau")],
    }
    for name, cells in seen.items():
        common = [*VERBS[name], f"--parameters={PAPER}", "--set=delta_T=85"]
        common = [one.replace("--to=0.175", "--to=0.1704") for one in common]
        found = []
        for number_of, more in enumerate(("--effects=own_law", f"--set={SAME}")):
            assert main([*common, more, f"--out={tmp_path / name}{number_of}"]) == 0
            assert ("not alike" in capsys.readouterr().out) == (number_of == 0)
            rows = table(tmp_path / f"{name}{number_of}" / name)
            found.append([number(_cell(rows, row, column)) for row, column in cells])
        assert found[0] == pytest.approx(found[1], abs=1e-5)


def _cell(rows: list[dict[str, str]], row: str, column: str) -> str:
    """Column of the first row in which some column holds a text."""
    return next(one[column] for one in rows if row in one.values())
