"""``import herringbone_sim as hb``: what its names give, held against the rooms below."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from recording_support import NAMES as CHANNELS
from recording_support import foreign_file, make_rows, write_run

import herringbone_sim as hb
from herringbone_sim.api import NAMES
from herringbone_sim.api.diagnosis import Diagnosis
from herringbone_sim.core import integrate
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.dynamics.spectrum import kaplan_yorke
from herringbone_sim.effects.effect import Locus
from herringbone_sim.errors import AnalysisError, ParameterError
from herringbone_sim.gap.report import Cause, Estimate
from herringbone_sim.recording.parameter_file import load_gear

PAPER = "config/paper.yaml"


@pytest.fixture(scope="module", autouse=True)
def in_the_repository(pytestconfig):
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(pytestconfig.rootpath)
        yield


def test_every_name_is_there_and_no_other():
    assert set(NAMES) <= set(dir(hb))
    assert all(getattr(hb, name) is not None for name in NAMES)
    with pytest.raises(AttributeError, match="has no attribute 'bifurcations'"):
        hb.bifurcations  # noqa: B018


def test_the_import_alone_loads_nothing_heavy():
    """Half a second is promised; what costs time are these libraries, so none is loaded."""
    heavy = ["numba", "scipy", "matplotlib", "pandas", "rerun", "pyarrow", "rclpy"]
    code = f"import sys, herringbone_sim; print([n for n in {heavy} if n in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_run_has_the_samples_of_the_stepper_and_goes_on_where_it_ended():
    whole = hb.simulate(cycles=40, delta_T=20.0)
    series, _ = integrate.simulate(build(Parameters(delta_T=20.0)), cycles=40)
    assert np.array_equal(whole.samples.data, series.data)
    first = hb.simulate(cycles=25, delta_T=20.0)
    second = hb.simulate(cycles=15, delta_T=20.0, start=first)
    assert np.array_equal(np.concatenate([first["x_sp_L"], second["x_sp_L"]]), whole["x_sp_L"])


def test_a_run_shows_itself_and_gives_its_channels_to_pandas_and_xarray():
    run = hb.simulate(PAPER, cycles=200, delta_T=90.0)
    assert "motion: P1" in repr(run)
    assert "<table>" in run._repr_html_()
    assert "data:image/png;base64" in run._repr_html_()
    table, data = run.to_pandas(), run.to_xarray()
    assert np.array_equal(table["F_sp_L"], run["F_sp_L"])
    assert np.array_equal(data["time"], run.t)
    assert data["x_sp_L"].attrs["units"] == "m"


def test_a_run_too_short_for_an_analysis_shows_itself_too():
    run = hb.simulate(cycles=1)
    assert "not known: an analysis needs" in repr(run)
    assert "run" in run._repr_html_()


def test_a_recorded_run_is_read_as_it_was_simulated(tmp_path):
    run = hb.read_run(write_run(tmp_path, n=500))
    assert np.array_equal(run.samples.data, make_rows(0, 500))
    assert run.changes[0].values["K"] == 0.5
    with pytest.raises(hb.HerringboneError, match="nothing"):
        hb.read_run(tmp_path / "nothing")


def test_a_recorded_run_holds_no_state_to_go_on_from(tmp_path):
    with pytest.raises(hb.HerringboneError, match="start must be a run of simulate"):
        hb.simulate(cycles=2, start=hb.read_run(write_run(tmp_path, n=500)))


def test_effects_and_changes_make_the_gear_that_they_say():
    plain = hb.simulate(PAPER, cycles=30, delta_T=20.0)
    cracked = hb.simulate(
        PAPER, cycles=30, delta_T=20.0, effects="mean_stiffness@sp/all/L:factor=0.9"
    )
    weaker = hb.Parameters(**{**vars(load_gear(PAPER)[0]), "delta_T": 20.0})
    assert np.array_equal(hb.simulate(weaker, cycles=30)["x_sp_L"], plain["x_sp_L"])
    assert not np.array_equal(cracked["x_sp_L"], plain["x_sp_L"])
    assert "mean_stiffness" in repr(cracked)


def test_a_diagram_has_the_periods_of_the_sweep_and_keeps_them_where_asked(tmp_path):
    values = np.linspace(84.0, 90.0, 4)
    found = hb.bifurcation(PAPER, start=["fixed", "down"], folder=tmp_path, delta_T=values)
    assert found.period.tolist() == [1.0] * 4
    assert (found.exponent < 0).all()
    assert len(found.to_pandas()) == 8
    assert {path.name for path in tmp_path.iterdir()} == {"fixed", "down"}
    assert "P1 100.0%" in repr(found)
    assert found.plot()._repr_png_().startswith(b"\x89PNG")


def test_a_diagram_takes_a_parameter_that_is_a_list_beside_the_swept_one():
    found = hb.bifurcation(PAPER, delta_T=[85.0, 90.0], k_factor=(1.0, 1.0, 0.99, 0.99))
    assert found.values.tolist() == [85.0, 90.0]
    assert found.diagram.axis.name == "delta_T"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"delta_T": 20.0}, "goes over one parameter"),
        ({"delta_T": [10.0, 20.0], "xi": [0.1, 0.2]}, "goes over one parameter"),
        ({"delta_T": [10.0, 20.0], "start": "sideways"}, "start must be of"),
        ({"delta_T": [20.0, 10.0]}, "must be finite and increase"),
        ({"k_factor": (1.0, 1.0, 1.0, 1.0)}, "over one parameter that is a number"),
        ({"delta_T": np.zeros((2, 2))}, "over one parameter that is a number"),
        ({"model": ["a", "b"]}, "over one parameter that is a number"),
    ],
)
def test_a_diagram_that_cannot_be_is_refused(given, message):
    with pytest.raises(hb.HerringboneError, match=message):
        hb.bifurcation(PAPER, **given)


def test_orbits_name_their_boundaries():
    """P1 over xi: left and right part at .1621, a flip follows at .1624 (docs/boundaries.md)."""
    found = hb.orbits(PAPER, over="xi", between=(0.16, 0.17), start=[0.168], max_period=1)
    table = found.boundaries()
    assert table["kind"].tolist() == ["transverse", "flip"]
    assert np.allclose(table["xi"], [0.16213, 0.16244], atol=1e-4)
    assert set(found.to_pandas()["stability"]) > {"stable"}


def test_motions_from_random_starts_have_shares_that_sum_to_one():
    found = hb.basins(PAPER, starts=16, transient=400, delta_T=90.0)
    table = found.to_pandas()
    assert table["share"].sum() == pytest.approx(1.0)
    assert table["starts"].sum() == 16
    assert ((table["low"] <= table["share"]) & (table["share"] <= table["high"])).all()


def test_the_catalogue_lists_every_effect():
    from herringbone_sim.effects.registry import effects

    assert set(hb.catalogue().to_pandas()["effect"]) <= set(effects())
    assert [name for name, _ in hb.catalogue().facts()] == list(effects())


def test_no_warning_that_the_paper_s_gear_cannot_be_assembled(recwarn):
    hb.simulate(PAPER, cycles=2)
    assert not recwarn.list


def test_what_is_not_installed_is_said_with_its_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(hb.HerringboneError, match=r"pip install 'herringbone_sim\[notebook\]'"):
        hb.catalogue().to_pandas()


def test_a_diagram_observes_as_long_as_effects_and_control_need():
    """A run-out repeats after 27 mesh cycles, a control of order 0.05 after 20."""
    turned = hb.bifurcation(
        PAPER, delta_T=[86.0, 90.0], effects="runout@sp:amplitude=2e-6,member=sun"
    )
    assert turned.period.tolist() == [27.0, 27.0]
    steered = hb.bifurcation(
        PAPER, delta_T=[88.0, 90.0], K=0.05, control_order=0.05, transient=600
    )
    assert steered.period.tolist() == [40.0, 40.0]


def test_the_dimension_of_a_motion_with_equal_halves_is_that_of_the_symmetric_part():
    found = hb.exponents(PAPER, delta_T=20.0, cycles=300, transient=300)
    whole = kaplan_yorke(np.asarray(found.spectrum))
    assert found.methods.symmetric is not None
    own = float(dict(found.facts())["Kaplan-Yorke dimension"])
    assert 1.0 < own < 4.0 < whole


def test_a_run_goes_on_with_its_relative_motion_in_a_changed_gear():
    before = hb.simulate(PAPER, cycles=20)
    same = hb.simulate(PAPER, cycles=1, start=before)
    for changes in ({"Omega": 1.2}, {"e_m": 0.5}, {"K": 0.1}):
        changed = hb.simulate(PAPER, cycles=1, start=before, **changes)
        for name in ("x_sp_L", "x_rp_R"):
            assert changed[name][0] == pytest.approx(same[name][0], rel=1e-9)
        assert changed["v_sp_L"][0] == pytest.approx(same["v_sp_L"][0], rel=1e-9)
    for changes in ({"model": "full"}, {"effects": "ring_flexibility@rp"}):
        with pytest.raises(hb.HerringboneError, match="start must be a run"):
            hb.simulate(PAPER, cycles=1, start=before, **changes)


def test_one_start_of_orbits_needs_no_list():
    found = hb.orbits(PAPER, between=(84.0, 86.0), start=85.0)
    assert len(found.branches) == 1


def test_numbers_of_numpy_are_starts_of_orbits():
    assert hb.orbits(PAPER, between=(84, 86), start=np.int64(85)).branches


@pytest.mark.parametrize(
    ("ask", "kind", "words"),
    [
        (lambda: hb.simulate(PAPER, cycles=0), ParameterError, "cycles must be at least 1, got 0"),
        (lambda: hb.bifurcation(PAPER, delta_T=["a", 1.0]), ParameterError, "must be numbers"),
        (lambda: hb.simulate(PAPER, cycles=30).plot("xx"), AnalysisError, "mesh must be one of"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(ask, kind, words):
    with pytest.raises(kind, match=words):
        ask()


def test_a_run_goes_on_in_si_units_in_a_gear_of_other_scales():
    """The first sample, 1/2000 of a cycle on, has x and v as in an unchanged gear."""
    before = hb.simulate(PAPER, cycles=20)
    same = hb.simulate(PAPER, cycles=1, start=before)
    for changes in ({"k_m_sp": 6e9}, {"I_s": 0.08}, {"b_c": 2e-4}, {"omega_n": 5000.0}):
        changed = hb.simulate(PAPER, cycles=1, start=before, **changes)
        for name in ("x_sp_L", "x_rp_R", "v_sp_L", "v_rp_R"):
            assert changed[name][0] == pytest.approx(same[name][0], rel=1e-9), (changes, name)


def test_a_run_goes_on_with_the_states_of_its_effects_in_si_units():
    gear = {"gear": PAPER, "effects": "ring_flexibility@rp"}
    before = hb.simulate(cycles=20, **gear)
    same = hb.simulate(cycles=1, start=before, **gear)
    changed = hb.simulate(cycles=1, start=before, k_m_sp=6e9, **gear)
    assert changed["v_rp_R"][0] == pytest.approx(same["v_rp_R"][0], rel=1e-9)


def test_a_run_of_a_gear_that_can_not_be_shows_itself():
    run = hb.simulate(PAPER, cycles=60)
    hot = replace(run, parameters={**run.parameters, "delta_T": 900.0})
    assert "not known: delta_T = 900 K" in repr(hot)
    assert "<table>" in hot._repr_html_()


def test_channels_of_another_program_are_given_to_xarray_without_a_unit(tmp_path):
    rows = np.column_stack([make_rows(0, 500), np.arange(500.0)])
    foreign_file(tmp_path / "rig.mcap", [rows], names=(*CHANNELS, "oil_temp"))
    data = hb.read_run(tmp_path / "rig.mcap").to_xarray()
    assert data["x_sp_L"].attrs["units"] == "m"
    assert "units" not in data["oil_temp"].attrs


def test_the_picture_of_exponents_names_the_motion_once():
    found = hb.exponents(PAPER, cycles=300, transient=200, delta_T=90.0)
    assert found.plot().figure.get_suptitle().strip() == found.title()


def test_a_segment_that_is_not_there_is_named():
    run = hb.simulate(PAPER, cycles=60)
    with pytest.raises(AnalysisError, match="index of one of 1, got 5"):
        run.plot(segment=5)


def test_what_has_no_place_is_shown_without_one():
    causes = (
        Cause("pin_position", Locus("all", "2", "all"), 0.9, {"offset": Estimate(3e-6)}),
        Cause("unknown", Locus(), 0.1),
    )
    diagnosis = Diagnosis(SimpleNamespace(causes=causes), None, None, None)
    assert diagnosis.facts() == [("90.0%", "pin_position at all/2/all"), ("10.0%", "unknown")]
