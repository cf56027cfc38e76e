"""Eqs. (1)-(11) of the paper, by hand and against the kernel's compiled forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from herringbone_sim.core import mesh
from herringbone_sim.core.model import errors_at, half_backlashes, mean_stiffness, mesh_phases
from herringbone_sim.core.scaling import scales
from herringbone_sim.errors import ParameterError
from herringbone_sim.gap.data.mesh_excitation import waves

finite = st.floats(-1e3, 1e3)


def test_thermal_loss_of_a_sun_mesh_by_hand():
    """Eq. (2) at 50 K with gamma 1.18e-5: strain 5.9e-4, z_s + z_p = 52, m_t 4.161198 mm.

    5.9e-4 x 1.00059 x 4.161198e-3 x pi = 7.717496e-6, and
    4.161198e-3 x 5.9e-4 x 52 x 0.3420201 / 2 = 2.183209e-5.
    """
    loss = mesh.thermal_backlash_loss(50.0, 1.18e-5, 4.161198e-3, 27 + 25, np.radians(20.0))
    assert loss == pytest.approx(7.717496e-6 + 2.183209e-5, rel=2e-6)


def test_thermal_loss_of_a_ring_mesh_by_hand():
    """Eq. (2) as printed takes z_r + z_p = 102: the second part is 4.282449e-5."""
    loss = mesh.thermal_backlash_loss(50.0, 1.18e-5, 4.161198e-3, 77 + 25, np.radians(20.0))
    assert loss == pytest.approx(7.717496e-6 + 4.282449e-5, rel=2e-6)


def test_half_backlash_by_hand(gear):
    """Eq. (3), b scaled: 0.6 x 1e-4 - 2.954959e-5 / 2 and 0.6 x 1e-4 - 5.054199e-5 / 2."""
    half = gear(delta_T=50.0).half_backlash_m
    assert half == pytest.approx([4.522520e-5] * 2 + [3.472901e-5] * 2, rel=1e-6)


def test_ring_meshes_may_lose_what_the_sun_meshes_lose(gear):
    half = gear(delta_T=50.0, thermal_rp="sun").half_backlash_m
    assert half == pytest.approx([4.522520e-5] * 4, rel=1e-6)


def test_cooling_gains_backlash_and_a_cold_gear_keeps_it(gear):
    assert gear(delta_T=0.0).half_backlash_m == pytest.approx([6e-5] * 4, rel=1e-15)
    assert np.all(gear(delta_T=-50.0).half_backlash_m > 6e-5)


def test_each_mesh_has_its_own_backlash(uneven, gear):
    more = np.array(uneven().parameters.b_offset)
    plain = gear(model="full").half_backlash_m
    assert uneven().half_backlash_m == pytest.approx(plain + more, rel=1e-14)


def test_heat_that_takes_more_backlash_than_there_is_is_refused(gear):
    p = gear(delta_T=0.0).parameters.changed({"delta_T": 300.0})
    with pytest.raises(ParameterError, match=r"delta_T = 300 K .* rp_L .* b' of -.* Eq\. \(3\)"):
        half_backlashes(p, scales(p))


@given(x=finite, b=st.floats(0.0, 1e3))
def test_backlash_function_is_odd_continuous_and_free_inside(x, b):
    """Eqs. (1), (4): slope 1 outside the backlash, 0 inside."""
    f = mesh.backlash(x, b)
    assert f == -mesh.backlash(-x, b)
    assert abs(f) == pytest.approx(max(abs(x) - b, 0.0))
    assert f * x >= 0.0


def test_backlash_function_keeps_the_shape_of_its_input():
    f = mesh.backlash(np.array([[-2.0, -1.0, 0.5], [1.0, 1.5, 3.0]]), 1.0)
    assert f.tolist() == [[-1.0, 0.0, 0.0], [0.0, 0.5, 2.0]]


@pytest.mark.parametrize("k_amp", [(), (0.25,), (0.3, 0.2, -0.1)])
def test_stiffness_of_the_model_is_equation_7(uneven, k_amp):
    """Order j of mesh m at j (phase + its mesh phase) + phi_a; one order is Eq. (8)."""
    model = uneven(k_amp=k_amp, mesh_phase=tuple(np.linspace(0.0, 2.0, 12)))
    p, phase = model.parameters, np.linspace(-3.0, 9.0, 50)
    k = waves(model, phase, 0.0).k
    for m, (k_m, shift) in enumerate(zip(mean_stiffness(p), mesh_phases(p), strict=True)):
        orders = [np.cos((j + 1) * (phase + shift) + p.phi_a[m]) for j in range(len(k_amp))]
        terms = sum(a * wave for a, wave in zip(k_amp, orders, strict=True))
        assert k[:, m] == pytest.approx(k_m * (1.0 + terms), rel=1e-13)


def test_damping_by_hand():
    """Eq. (11): 2 x 0.07 sqrt(1.5e9 / (1/3 + 1/6)) = 0.14 sqrt(3e9) = 7668.116."""
    assert mesh.damping(0.07, 1.5e9, 3.0, 6.0) == pytest.approx(7668.116, rel=1e-6)


def test_damping_of_the_meshes(uneven):
    """Eq. (11) with M = I / r_b^2 of sun or ring and planet, times each mesh's own factor."""
    model = uneven()
    r = 0.5 * 4e-3 / np.cos(np.radians(16.0)) * np.array([27, 25, 77])
    r *= np.cos(np.arctan(np.tan(np.radians(20.0)) / np.cos(np.radians(16.0))))
    sun, planet, ring = np.array([0.008, 0.007, 0.125]) / r**2
    c_sp = 0.14 * np.sqrt(1.5e9 / (1.0 / sun + 1.0 / planet))
    c_rp = 0.14 * np.sqrt(1.2e9 / (1.0 / ring + 1.0 / planet))
    expected = np.repeat([c_sp, c_rp], 6) * model.parameters.c_factor
    assert model.damping_n_s_per_m == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("phase", [0.0, 0.4, 2.9, 6.2])
def test_errors_of_the_model_are_equation_9(uneven, phase):
    """Order j of mesh m at j (phase + its mesh phase) + phi_b; the rate by differences."""
    model = uneven(e_mean=0.1, mesh_phase=tuple(np.linspace(0.0, 2.0, 12)))
    p = model.parameters
    shift = mesh_phases(p)
    e, rate = errors_at(model, phase)
    for m in range(12):
        terms = [
            a * p.e_m * p.e_factor[m] * np.sin((j + 1) * (phase + shift[m]) + p.phi_b[m])
            for j, a in enumerate(p.e_amp)
        ]
        assert e[m] == pytest.approx(0.1 + p.e_offset[m] / p.b_c + sum(terms), abs=1e-12)
    d = 1e-6
    slope = (errors_at(model, phase + d)[0] - errors_at(model, phase - d)[0]) / (2.0 * d)
    assert rate == pytest.approx(p.Omega * slope, abs=1e-8)
