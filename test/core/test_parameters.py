"""Every rule of the parameters: what is taken, refused, or warned about, and in which words."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from herringbone_sim.core import parameters
from herringbone_sim.core.parameters import (
    Parameters,
    ParameterWarning,
    coerce,
    from_mapping,
    meaning,
    names,
    to_mapping,
)
from herringbone_sim.errors import ParameterError

NUMBERS = [name for name in names() if not isinstance(getattr(Parameters, name), str)]
BOUNDED = [name for name in NUMBERS if math.isfinite(meaning(name).low)]
CHOSEN = [name for name in names() if meaning(name).choices]
LIVE = {
    *("K", "delta_T", "xi", "T_1", "Omega", "control_phase", "samples_per_cycle"),
}


def like(name, value):
    """Value as a list where the field is one."""
    default = getattr(Parameters, name)
    return tuple(value for _ in default) or (value,) * 3 if isinstance(default, tuple) else value


@pytest.mark.parametrize(
    "name", [n for n in NUMBERS if not isinstance(getattr(Parameters, n), int)]
)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_numbers_must_be_finite(name, value):
    with pytest.raises(ParameterError, match=rf"{name} .*must be finite, got .*{value}"):
        Parameters(**{name: like(name, value)})


@pytest.mark.parametrize("name", BOUNDED)
def test_values_outside_the_range_are_refused_with_the_range(name):
    about = meaning(name)
    step = 1 if isinstance(getattr(Parameters, name), int) else 1e-6
    for outside in (about.low - step, about.high * 1.001 + step):
        value = int(outside) if step == 1 else outside
        with pytest.raises(ParameterError, match=rf"{name} \[.*must lie in .* \.\. .*got"):
            Parameters(**{name: like(name, value)})


@pytest.mark.parametrize("name", CHOSEN)
def test_a_choice_is_refused_with_the_choices(name):
    with pytest.raises(ParameterError, match=rf"{name} must be one of .*, got 'guess'"):
        Parameters(**{name: "guess"})


@pytest.mark.parametrize("name", names())
def test_every_parameter_has_unit_and_meaning(name):
    about = meaning(name)
    assert about.unit
    assert len(about.text) > 5


def test_only_these_are_live():
    assert set(parameters.live_names()) == LIVE


def test_unknown_names_are_refused_with_those_there_are():
    with pytest.raises(ParameterError, match="no parameter 'delta_t'; there are model, n_planets"):
        from_mapping({"delta_t": 1.0})
    with pytest.raises(ParameterError, match="no parameter 'k'"):
        meaning("k")


@pytest.mark.parametrize(
    ("name", "value", "taken"),
    [
        ("K", 1, 1.0),
        ("delta_T", np.float64(3.5), 3.5),
        ("order", 14.0, 14),
        ("k_amp", 0.2, (0.2,)),
        ("k_amp", np.float32(0.25), (0.25,)),
        ("k_amp", np.int64(0), (0.0,)),
        ("k_amp", [0, 0.1], (0.0, 0.1)),
        ("k_factor", np.array([2.0]), (2.0,)),
        ("model", "full", "full"),
    ],
)
def test_values_are_taken_in_the_type_of_their_field(name, value, taken):
    got = coerce(name, value)
    assert got == taken
    assert type(got) is type(taken)


@pytest.mark.parametrize(
    ("name", "value", "kind"),
    [
        ("K", "0.3", "float"),
        ("K", True, "float"),
        ("K", None, "float"),
        ("K", [0.1], "float"),
        ("order", 12.5, "int"),
        ("order", math.nan, "int"),
        ("order", math.inf, "int"),
        ("z_s", "27", "int"),
        ("k_amp", "25", "a list of numbers"),
        ("k_amp", ["0.25"], "a list of numbers"),
        ("k_amp", [True], "a list of numbers"),
        ("k_amp", True, "a list of numbers"),
        ("k_amp", [None], "a list of numbers"),
        ("k_amp", None, "a list of numbers"),
    ],
)
def test_values_of_another_type_are_refused(name, value, kind):
    with pytest.raises(ParameterError, match=rf"{name} must be {kind}, got"):
        coerce(name, value)


@pytest.mark.parametrize(
    "values",
    [
        {"xi": "0.07"},
        {"xi": None},
        {"xi": (0.07,)},
        {"xi": True},
        {"z_s": 27.5},
        {"z_s": 27.0},
        {"k_amp": 0.25},
        {"k_amp": ("0.25",)},
        {"k_amp": (True,)},
        {"model": 3},
    ],
    ids=str,
)
def test_a_set_of_wrong_types_can_not_be_built(values):
    (name,) = values
    with pytest.raises(ParameterError, match=f"{name} must be"):
        Parameters(**values)


@pytest.mark.parametrize("model", ["reduced", "full"])
@pytest.mark.parametrize(
    ("name", "reduced", "full"),
    [
        ("I_s_factor", 2, 2),
        ("I_p_factor", 2, 6),
        ("k_factor", 4, 12),
        ("phi_a", 4, 12),
        ("e_factor", 4, 12),
        ("e_offset", 4, 12),
        ("phi_b", 4, 12),
        ("mesh_phase", 4, 12),
        ("c_factor", 4, 12),
        ("b_offset", 4, 12),
        ("control_on", 4, 4),
        ("initial_x", 4, 4),
        ("initial_v", 4, 4),
    ],
)
def test_lengths_of_lists(name, reduced, full, model):
    n = full if model == "full" else reduced
    for right in (1, n):
        Parameters(model=model, **{name: (1.0,) * right})
    for wrong in (0, n - 1 if n > 2 else 3, n + 1):
        with pytest.raises(ParameterError, match=rf"{name} must have 1 or {n} .*got {wrong}"):
            Parameters(model=model, **{name: (1.0,) * wrong})


def test_length_of_planet_angle():
    Parameters(planet_angle=(0.0, 120.0, 240.0))
    with pytest.raises(ParameterError, match="planet_angle must have 0 or 3 values"):
        Parameters(planet_angle=(0.0, 120.0))


@pytest.mark.parametrize("name", ["I_s_factor", "I_p_factor", "k_factor"])
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_factors_that_divide_must_be_positive(name, value):
    with pytest.raises(ParameterError, match=f"{name} must be positive, got {value}"):
        Parameters(**{name: (value,)})


@pytest.mark.parametrize("k_amp", [(1.0,), (0.6, 0.4), (-0.5, 0.3, 0.3)])
def test_stiffness_must_stay_positive(k_amp):
    with pytest.raises(ParameterError, match="k_amp must sum to less than 1"):
        Parameters(k_amp=k_amp)


def test_higher_harmonics_within_the_sum_are_taken():
    assert Parameters(k_amp=(0.6, -0.2, 0.1)).k_amp == (0.6, -0.2, 0.1)


@pytest.mark.parametrize("z_r", [27, 20])
def test_a_ring_no_larger_than_the_sun_is_refused(z_r):
    with pytest.raises(ParameterError, match=rf"z_r > z_s, got {z_r} and 27"):
        Parameters(z_r=z_r)


def warnings_of(**values):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        Parameters(**values)
    assert all(issubclass(w.category, ParameterWarning) for w in caught)
    return [str(w.message) for w in caught]


def test_the_papers_gear_is_warned_about_and_runs():
    """(27 + 77) / 3 = 34.667: three equally spaced planets can't be assembled."""
    (text,) = warnings_of()
    assert "(z_s + z_r) / N to be whole, got 104 / 3 = 34.667" in text
    assert "runs all the same" in text


def test_a_copy_does_not_warn_again_of_the_same():
    p = Parameters()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert p.changed({"delta_T": 30}).changed({"K": 0.1}).delta_T == 30.0
        assert caught == []
        p.changed({"z_p": 26})
    (one,) = caught
    assert "got 77" in str(one.message)
    assert Path(one.filename) == Path(__file__)


def test_a_copy_leaves_the_set_alone_and_is_checked():
    p = Parameters()
    before = to_mapping(p)
    with pytest.raises(ParameterError, match="xi"):
        p.changed({"xi": -1.0})
    assert p.changed({"xi": 0.2}) != p
    assert to_mapping(p) == before


def test_given_planet_angles_need_no_equal_spacing():
    assert warnings_of(planet_angle=(0.0, 360.0 * 34 / 104, 360.0 * 70 / 104)) == []
    assert "33.800" in warnings_of(planet_angle=(0.0, 117.0, 360.0 * 70 / 104))[0]
    touching = warnings_of(planet_angle=(0.0, 360.0 * 3 / 104, 360.0 * 70 / 104))
    assert "touch" in touching[0]


def test_slow_meshes_and_high_harmonics_get_more_steps():
    """The step stays short against the natural period and the fastest excitation."""
    for values, least in (
        ({"Omega": 0.25}, 64),
        ({"k_amp": (0.1,) * 8}, 128),
        ({"e_amp": (1.0, 0.5, 0.2)}, 48),
        ({"control_order": 10.0}, 160),
        ({"Omega": 3.0}, 16),
    ):
        assert Parameters(**values).steps == least
    assert Parameters(Omega=0.25, method="rk4").steps == 16


def test_a_gear_that_can_be_assembled_raises_no_warning():
    assert warnings_of(z_s=28, z_p=25, z_r=78, n_planets=2) == []


def test_axes_that_are_not_concentric_are_warned_about():
    (text,) = warnings_of(z_s=28, z_p=24, z_r=77)
    assert "z_r = z_s + 2 z_p = 76, got 77" in text


def test_neighbouring_planets_that_touch_are_warned_about():
    """(27 + 25) sin(pi / 8) = 19.9 < 27."""
    (text,) = warnings_of(n_planets=8)
    assert "neighbouring planets touch" in text
    assert "= 19.9 must exceed z_p + 2 = 27" in text


@given(xi=st.floats(0.0, 2.0), K=st.floats(-10.0, 10.0), seed=st.integers(0, 2**31 - 1))
def test_a_set_goes_through_a_mapping_unchanged(xi, K, seed):
    p = Parameters(xi=xi, K=K, seed=seed, k_amp=(0.1, 0.2))
    assert from_mapping(to_mapping(p)) == p


def test_a_mapping_holds_lists_and_every_name():
    values = to_mapping(Parameters())
    assert tuple(values) == names()
    assert values["control_on"] == [1.0] * 4


def test_changed_takes_integers_and_checks_as_when_built():
    assert Parameters().changed({"K": 1, "xi": 0.1}) == Parameters(K=1.0, xi=0.1)
    with pytest.raises(ParameterError, match="K"):
        Parameters().changed({"xi": 0.1, "K": math.nan})


@pytest.mark.parametrize(
    ("least", "samples", "steps"), [(16, 16, 16), (16, 5, 20), (16, 100, 100), (20, 16, 32)]
)
def test_the_grid_has_enough_steps_and_a_whole_number_to_a_sample(least, samples, steps):
    assert Parameters(steps_per_cycle=least, samples_per_cycle=samples).steps == steps
