"""Simulate a rig of the damper: a driven mass on a spring with play and a damper.

M dv/dt + F(x, v) = P cos(phase), F = K g(x) + C v + force of the effects, with g(x) the
displacement beyond the play.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from herringbone_sim.arrays import Array

M, K, C, PLAY = 2.0, 2e4, 60.0, 5e-4  # [kg], [N/m], [N s/m], half play [m]
M_SHARE, K_SHARE, C_SHARE = 0.01, 0.02, 0.04  # tolerances, chosen as in a data sheet
SIGMA = {"x": 2e-6, "v": 2e-4, "F": 0.1}  # noise [m], [m/s], [N], chosen
OFFSET = 0.1  # standard deviation of the random offset of F in a run [N]
STEP, RUN_S, SETTLING_S = 5e-4, 1.8, 1.2  # sampling step, recording, transient before it [s]
SUBSTEPS = 10  # integration steps per sample
OPERATING_POINTS = ((7, 30), (9, 60), (11, 40), (14, 40), (17, 60))  # [Hz], [N]
SLIDING_SPEED = 3e-4  # velocity over which friction changes sign, about the noise of v [m/s]
# Moderate sizes, chosen: [N], ``cubic`` [N/m^3], ``play`` [m], ``gain`` relative. ``maxwell`` and
# ``smooth`` are not in the catalogue.
MODERATE_SIZES = {"coulomb": 0.5, "presliding": 0.5, "stribeck": 0.5, "cubic": 5e6, "play": 3e-5}
MODERATE_SIZES |= {"gain": 0.01, "maxwell": 0.3, "smooth": 0.5}


@dataclass(frozen=True)
class Run:
    """Recording of one run; arrays (n,), with sensor errors and noise.

    Attributes:
        phase: phase of the drive [rad].
        P: amplitude of the drive [N].
        x, v, F: displacement [m], velocity [m/s], force of the mass on the ground [N].
    """

    phase: Array
    P: float
    x: Array
    v: Array
    F: Array


MAXWELL_TRAVEL, MAXWELL_RATE = 5e-4, 60.0  # Maxwell branch: travel per unit of s [m], rate [1/s]


@njit(cache=True)
def law(x, v, s, p):  # type: ignore[no-untyped-def]
    """Force [N], and time derivative [1/s] of the state s of presliding or of a Maxwell branch.

    Args:
        x, v: displacement [m] and velocity [m/s].
        s: state of presliding if p[5] is not 0, else of the Maxwell branch.
        p: (11,) parameters, see the first line of the body.
    """
    k, c, play, friction, ratio, presliding, cubic, maxwell, smooth, a, b = p
    out = x - min(max(x, -play), play)
    slide = np.tanh(v / SLIDING_SPEED) * (1.0 + ratio * np.exp(-((v / b) ** 2)))
    force = k * out + c * v + friction * slide + cubic * x**3 + (presliding + maxwell) * s
    force += smooth * np.cos(0.1 * x / a + 3.0 * v + 50.0 * b)
    return force, (v - abs(v) * s) / a if presliding else v / MAXWELL_TRAVEL - MAXWELL_RATE * s


@njit(cache=True)
def response(n, mass, P, omega, p):  # type: ignore[no-untyped-def]
    """Response of the rig from x = 2 mm, v = 0 to P cos(omega t), by 4th-order Runge-Kutta.

    Args:
        n: number of samples, ``STEP`` apart.
        mass, P, omega: [kg], [N], [rad/s].
        p: (11,) parameters of the force law, in the order in which ``law`` unpacks them.

    Returns:
        (n, 3) x [m], v [m/s] and force F [N], without noise, gain error or offset.
    """
    samples, h = np.empty((n, 3)), STEP / SUBSTEPS
    x, v, s = 2e-3, 0.0, 0.0
    for i in range(n * SUBSTEPS):
        if i % SUBSTEPS == 0:
            samples[i // SUBSTEPS] = x, v, law(x, v, s, p)[0]
        dx, dv, ds, to_x, to_v, to_s = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for at, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            now = v + at * h * dv
            force, ds = law(x + at * h * dx, now, s + at * h * ds, p)
            dx, dv = now, (P * np.cos(omega * (i + at) * h) - force) / mass
            to_x, to_v, to_s = to_x + weight * dx, to_v + weight * dv, to_s + weight * ds
        x, v, s = x + h / 6.0 * to_x, v + h / 6.0 * to_v, s + h / 6.0 * to_s
    return samples


def simulate(effect: str, seed: int) -> list[Run]:
    """Simulate the five runs of a rig with an effect, or ``none``, of half to twice moderate size.

    ``seed`` determines tolerances, size and shape of the effect, and noise.
    """
    rng = np.random.default_rng(seed)
    mass, gain, p = draw_rig(effect, rng)
    return [
        record(2.0 * np.pi * hertz, float(P), mass, gain, p, rng) for hertz, P in OPERATING_POINTS
    ]


def draw_rig(effect: str, rng: np.random.Generator) -> tuple[float, float, Array]:
    """Draw a rig with an effect: mass [kg], gain of F and the (11,) parameters of ``law``."""
    shares = rng.uniform(-1.0, 1.0, 3) * [M_SHARE, K_SHARE, C_SHARE]
    mass, k, c = (1.0 + shares) * [M, K, C]
    size = dict.fromkeys(MODERATE_SIZES, 0.0)
    if effect != "none":
        sign = rng.choice([-1.0, 1.0]) if effect in ("cubic", "play", "gain") else 1.0
        size[effect] = sign * MODERATE_SIZES[effect] * 2.0 ** rng.uniform(-1.0, 1.0)
    friction = size["coulomb"] + size["stribeck"]
    ratio = 10.0 ** rng.uniform(-0.1, 0.3) if effect == "stribeck" else 0.0
    travel, falling = 10.0 ** rng.uniform(-4.0, -3.2), 10.0 ** rng.uniform(-1.7, -1.0)
    rest = size["presliding"], size["cubic"], size["maxwell"], size["smooth"], travel, falling
    law_numbers = np.array([k, c, PLAY + size["play"], friction, ratio, *rest])
    return float(mass), 1.0 + size["gain"], law_numbers


def record(
    omega: float, P: float, mass: float, gain: float, p: Array, rng: np.random.Generator
) -> Run:
    """Simulate one run with sensor errors and noise; ``omega`` in rad/s, P in N, mass in kg."""
    passed, n = round(SETTLING_S / STEP), round(RUN_S / STEP)
    x, v, F = response(passed + n, mass, P, omega, p)[passed:].T
    noise = rng.normal(size=(3, n)) * np.array([list(SIGMA.values())]).T
    F = gain * F + OFFSET * rng.normal()
    phase = omega * STEP * np.arange(passed, passed + n, dtype=np.float64)
    return Run(phase, P, x + noise[0], v + noise[1], F + noise[2])
