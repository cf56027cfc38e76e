"""Names and sizes: the recorded channels are a contract with every reader of a recording."""

from __future__ import annotations

import pytest

from herringbone_sim.core.layout import Layout, describe, unit_of

REDUCED = Layout(n_classes=1, numbered=False)
FULL = Layout(n_classes=3, numbered=True)


def test_sizes_of_three_planets():
    """9 bodies and 12 meshes; 8 coordinates, as the rigid rotation is taken out."""
    assert (FULL.n_mesh, len(FULL.bodies), FULL.n_coordinate, FULL.n_state) == (12, 9, 8, 16)


def test_sizes_of_the_reduced_model():
    assert (REDUCED.n_mesh, REDUCED.n_coordinate, REDUCED.n_state) == (4, 4, 8)


def test_reduced_names_leave_the_planet_out():
    assert REDUCED.meshes == ("sp_L", "sp_R", "rp_L", "rp_R")
    assert REDUCED.bodies == ("s_L", "s_R", "c", "p_L", "p_R")
    assert REDUCED.state_names == ("q_L", "q_R", "r_L", "r_R", "dq_L", "dq_R", "dr_L", "dr_R")


def test_full_meshes_run_over_kind_then_side_then_planet():
    assert FULL.meshes[:7] == ("sp1_L", "sp2_L", "sp3_L", "sp1_R", "sp2_R", "sp3_R", "rp1_L")
    assert FULL.bodies == ("s_L", "s_R", "c", "p1_L", "p2_L", "p3_L", "p1_R", "p2_R", "p3_R")


@pytest.mark.parametrize("layout", [REDUCED, FULL], ids=["reduced", "full"])
def test_channels_are_unique_and_all_described(layout):
    channels = layout.channels
    assert channels[:5] == ("t", "phase", "K", "delta_T", "T_1")
    assert len(set(channels)) == len(channels) == 5 + 3 * layout.n_mesh + len(layout.bodies)
    for name in channels:
        about = describe(name)
        assert about["name"] == name
        assert about["unit"] == unit_of(name)
        assert about["meaning"]


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("t", "s"),
        ("phase", "rad"),
        ("delta_T", "K"),
        ("T_1", "N m"),
        ("x_sp1_L", "m"),
        ("v_rp_R", "m/s"),
        ("F_sp3_R", "N"),
        ("u_c", "m"),
    ],
)
def test_units(name, unit):
    assert unit_of(name) == unit


def test_meaning_names_the_mesh():
    assert describe("F_sp2_R")["meaning"] == "normal mesh force k f(x) + c v of mesh sp2_R"


def test_sensors_that_no_run_of_the_node_records_are_described_too():
    assert describe("F_pin2") == {
        "name": "F_pin2",
        "unit": "N",
        "meaning": "sum of the normal mesh forces of both halves of planet 2",
    }
    assert describe("F_pin")["meaning"].endswith("planet (all alike)")
    assert describe("a_s_L")["meaning"] == "angular acceleration times base radius of body s_L"
    for name in (*FULL.channels_of("a"), *REDUCED.channels_of("pin")):
        assert describe(name)["unit"] == unit_of(name)


def test_a_foreign_name_has_no_unit():
    with pytest.raises(KeyError):
        unit_of("temperature_1")


@pytest.mark.parametrize("name", ["temperature_1", "F_pinx", "F_pin_L"])
def test_a_foreign_name_has_no_meaning(name):
    with pytest.raises(KeyError):
        describe(name)
