"""Windows side by side: each as if alone, against SciPy, with the tangents of its steps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.gap.data.kinematics import bodies_to_meshes, inverse_masses
from herringbone_sim.gap.observations.windows.integrator import STATES, Forcing, WindowIntegrator

STEPS, WINDOWS, EVERY = 30, 37, 3  # windows: two full batches of lanes, and five left
MODEL = build(Parameters(model="full"))
H = 0.08 / MODEL.scales.omega_n


@pytest.fixture(scope="module")
def forcing() -> Forcing:
    """Smooth forcing with the masses, stiffness and backlash of the nominal gear."""
    rng = np.random.default_rng(0)
    t = np.arange(2 * STEPS + WINDOWS)
    M = MODEL.layout.n_mesh

    def wave(size: float) -> np.ndarray:
        return size * np.sin(0.05 * t[:, None] + rng.uniform(0.0, 6.0, M))

    k = MODEL.scales.omega_n**2 * float(np.mean(1.0 / inverse_masses(MODEL)))
    ones = np.ones((len(t), M))
    return Forcing(
        bodies_to_meshes(MODEL),
        inverse_masses(MODEL),
        1e3 * np.sin(0.05 * t[:, None] + rng.uniform(0.0, 6.0, STATES // 2)),
        k * (1.0 + wave(0.2)),
        MODEL.damping_n_s_per_m * ones,
        wave(1e-5),
        wave(1e-2),
        2e-5 * ones,
        3e-5 * ones,
        wave(100.0),
    )


@pytest.fixture(scope="module")
def starts() -> np.ndarray:
    """Start states with some meshes in contact on either flank, some on none."""
    sizes = 3e-5 * np.repeat([1.0, MODEL.scales.omega_n], STATES // 2)
    return sizes * np.random.default_rng(1).standard_normal((WINDOWS, STATES))


def test_windows_follow_the_equation_of_motion(forcing: Forcing, starts: np.ndarray) -> None:
    """Against SciPy at tolerance 1e-10; 2e-3 of the motion is what contact within a step costs."""
    found = WindowIntegrator(np.arange(WINDOWS), STEPS, H, forcing).states(starts)
    half = STATES // 2

    def at(values: np.ndarray, t: float, first: int) -> np.ndarray:
        i = first + 2.0 * t / H
        n = min(int(i), first + 2 * STEPS - 1)
        return np.asarray(values[n] + (i - n) * (values[n + 1] - values[n]))

    def slope(t: float, y: np.ndarray, first: int) -> np.ndarray:
        now = {name: at(getattr(forcing, name), t, first) for name in Forcing._fields[2:]}
        x, v = forcing.G @ y[:half] + now["offset"], forcing.G @ y[half:] + now["rate"]
        f = np.maximum(x - now["plus"], 0.0) - np.maximum(-x - now["minus"], 0.0)
        force = now["k"] * f + now["c"] * v + now["extra_force"]
        return np.append(y[half:], forcing.inverse_masses * (now["tau"] - force @ forcing.G))

    x = found[..., :half] @ forcing.G.T
    assert x.max() > 3e-5  # drive flank
    assert x.min() < -4e-5  # back flank
    assert np.abs(x).min() < 1e-6  # neither
    size = np.sqrt(np.mean(found**2, axis=(0, 1)))
    for w in (0, 16, WINDOWS - 1):
        end = solve_ivp(slope, (0.0, STEPS * H), starts[w], args=(w,), rtol=1e-10, atol=1e-13).y[
            :, -1
        ]
        assert np.all(np.abs(found[w, -1] - end) < 2e-3 * size)


@pytest.mark.parametrize("number", [1, 3, 5, 8, 12, 16, 17])
def test_a_window_does_not_depend_on_those_beside_it(
    number: int, forcing: Forcing, starts: np.ndarray
) -> None:
    every = WindowIntegrator(np.arange(WINDOWS), STEPS, H, forcing)
    some = WindowIntegrator(np.arange(number), STEPS, H, forcing)
    assert np.array_equal(some.states(starts[:number]), every.states(starts)[:number])
    assert np.array_equal(
        some.tangents(starts[:number], EVERY), every.tangents(starts, EVERY)[:number]
    )


def test_tangents_are_derivatives_of_the_states(forcing: Forcing, starts: np.ndarray) -> None:
    """By differences of a hundred-millionth of the motion; a contact changes in few of them."""
    integrator = WindowIntegrator(np.arange(WINDOWS), STEPS, H, forcing)
    tangents = integrator.tangents(starts, EVERY)
    sizes = 3e-13 * np.repeat([1.0, MODEL.scales.omega_n], STATES // 2)
    for i in (0, 2, 5, 9, 17):
        moved = sizes[i] * np.eye(STATES)[i]
        apart = integrator.states(starts + moved) - integrator.states(starts - moved)
        differences = apart[:, EVERY::EVERY] / (2.0 * sizes[i])
        scale = np.abs(tangents[..., i]).max(axis=(0, 1))
        off = np.abs(differences - tangents[..., i]) / scale
        assert np.quantile(off, 0.99) < 1e-5


def test_tangents_of_intervals_make_up_those_of_the_window(
    forcing: Forcing, starts: np.ndarray
) -> None:
    integrator = WindowIntegrator(np.arange(WINDOWS), STEPS, H, forcing)
    steps, whole = integrator.tangents(starts, 1, restart=True), integrator.tangents(starts, STEPS)
    product = np.broadcast_to(np.eye(STATES), (WINDOWS, STATES, STATES))
    for q in range(STEPS):
        product = steps[:, q] @ product
    assert product == pytest.approx(whole[:, 0], rel=1e-9, abs=1e-9 * np.abs(whole).max())
