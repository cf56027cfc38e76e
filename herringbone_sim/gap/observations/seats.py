"""Parts that move by themselves, driven by the mesh forces: a ring on its spring, a loose pin.

Their displacement follows from the recorded forces by their own equation of motion; a free
amplitude near one allows for what the equation leaves out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import cont2discrete, lfilter, ss2tf

from herringbone_sim.diagnosis.search import Hypothesis
from herringbone_sim.effects.effect import Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.gap.observations import balance, force_law
from herringbone_sim.gap.observations.basis import Function
from herringbone_sim.gap.observations.gear import Amplitudes, Gear
from herringbone_sim.gap.observations.law import Law, Motion, law, on_meshes
from herringbone_sim.gap.observations.places import Places, Weights

Array = NDArray[np.float64]

RING_N_PER_M = np.geomspace(3e8, 3e11, 13)
RING_RATIO = 0.05
CLEARANCES_M = np.geomspace(1e-6, 5e-5, 6)
SEAT_N_PER_M = 1e11
SEAT_RATIO = 0.1


def measured(m: Motion, law: Law) -> Array:
    """Forces that drive: as recorded, else by the law."""
    return np.where(np.isfinite(m.F), m.F, law.force)


def ring_motion(gear: Gear, theta: Array, m: Motion, F: Array) -> Array:
    """(n, 2, 2) turn [m] of both sides of the ring, and its rate.

    M_r u'' = cos beta F - k u - c u'.

    Args:
        theta: stiffness [N/m] and damping ratio.
        F: (n, n_mesh) forces that drive it [N].
    """
    s = gear.model.scales
    stiffness, ratio = theta
    damping = 2.0 * ratio * np.sqrt(stiffness * s.M_r)
    h = float(m.times[1] - m.times[0])
    system = (
        np.array([[0.0, 1.0], [-stiffness / s.M_r, -damping / s.M_r]]),
        np.array([[0.0], [1.0 / s.M_r]]),
        np.eye(2),
        np.zeros((2, 1)),
    )
    b, a = ss2tf(*cont2discrete(system, h, "foh")[:4])
    n = F.shape[1]
    load = s.cos_beta * F[:, n // 2 :].reshape(len(F), 2, -1).sum(axis=2)
    found = np.stack([lfilter(row, a, load - load[0], axis=0) for row in b], axis=2)
    found[:, :, 0] += load[0] / stiffness
    return found


def ring_function(gear: Gear, theta: Array, label: str) -> Function:
    """d = -u cos beta of the ring on the meshes of its side."""

    def motion(m: Motion, law: Law, rate: int) -> Array:
        u = ring_motion(gear, theta, m, measured(m, law))[:, :, rate]
        out = np.zeros_like(m.x)
        half = out.shape[1] // 2
        out[:, half:] = -gear.model.scales.cos_beta * np.repeat(u, half // 2, axis=1)
        return out

    return Function(label, "d", lambda m, law: motion(m, law, 0), lambda m, law: motion(m, law, 1))


@njit(cache=True)
def _seat(P, y, mass, k, c, half, h, parts):  # type: ignore[no-untyped-def]
    """w and its rate (n, 2) of a pin with play, semi-implicit Euler in parts of a sample."""
    n = P.size
    out = np.zeros((n, 2))
    w, v = 0.0, 0.0
    dt = h / parts
    for i in range(n):
        out[i, 0], out[i, 1] = w, v
        if i + 1 == n:
            break
        for q in range(parts):
            s = (q + 0.5) / parts
            load = P[i] + s * (P[i + 1] - P[i])
            yy = y[i] + s * (y[i + 1] - y[i])
            g = w - half if w > half else (w + half if w < -half else 0.0)
            v += dt * ((load - k * g - c * v) / mass - yy)
            w += dt * v
    return out


def pin_meshes(gear: Gear, locus: Locus) -> tuple[list[int], float]:
    """Meshes of a pin, and its mass [kg]; half of it where one side is free alone."""
    at = np.flatnonzero(locus.mask(gear.model.layout)).tolist()
    return at, gear.model.parameters.m_p * len(at) / 4.0


def bearing_motion(gear: Gear, locus: Locus, theta: Array, m: Motion, F: Array) -> Array:
    """(n, 2) way [m] of a pin in the carrier and its rate.

    m (w'' + y'') = P - H with P = cos beta sum F of its meshes, y'' the carrier's acceleration,
    H = k g(w) + c w' of the seat.

    Args:
        theta: clearance [m], stiffness [N/m] and damping ratio of the seat.
        F: (n, n_mesh) forces that drive it [N].
    """
    s = gear.model.scales
    clearance, stiffness, ratio = theta
    at, mass = pin_meshes(gear, locus)
    damping = 2.0 * ratio * np.sqrt(stiffness * mass)
    h = float(m.times[1] - m.times[0])
    P = s.cos_beta * F[:, at].sum(axis=1)
    T_2 = 2.0 * m.point["T_1"] * s.r_bc / s.r_bs
    y = (s.cos_beta * F.sum(axis=1) - T_2 / s.r_bc) / s.M_c
    y += m.point["K"] * s.b_c * s.omega_n**2 * np.cos(m.phase) / s.cos_beta
    parts = max(4, int(np.ceil(h * np.sqrt(stiffness / mass) / 0.2)))
    return np.asarray(_seat(P, y, mass, stiffness, damping, clearance, h, parts))


def bearing_functions(
    gear: Gear, locus: Locus, theta: Array, label: str
) -> tuple[Function, Function]:
    """d = -w cos beta on the meshes of a loose pin, and -m w'' on the carrier [N]."""
    s = gear.model.scales
    at, mass = pin_meshes(gear, locus)

    def spread(values: Array, shape: tuple[int, ...]) -> Array:
        out = np.zeros(shape)
        out[:, at] = -s.cos_beta * values[:, None]
        return out

    def motion(m: Motion, law: Law) -> Array:
        return bearing_motion(gear, locus, theta, m, measured(m, law))

    def on_carrier(m: Motion, law: Law) -> Array:
        return -mass * np.gradient(motion(m, law)[:, 1], m.times)

    shift = Function(
        label,
        "d",
        lambda m, law: spread(motion(m, law)[:, 0], m.x.shape),
        lambda m, law: spread(motion(m, law)[:, 1], m.x.shape),
    )
    return shift, Function(f"{label} carrier", "body", on_carrier)


@dataclass(frozen=True)
class Seat:
    """A part that moves by itself, with its parameters.

    Attributes:
        effect, locus: as in the catalogue.
        theta: stiffness [N/m] and damping ratio; of a pin after its clearance [m].
    """

    effect: str
    locus: Locus
    theta: tuple[float, ...]

    def functions(self, gear: Gear, label: str) -> tuple[Function, ...]:
        if self.effect == "ring_flexibility":
            return (ring_function(gear, np.array(self.theta), label),)
        return bearing_functions(gear, self.locus, np.array(self.theta), label)

    def place(self, places: Places, label: str) -> Hypothesis:
        """With its amplitude as coefficient."""
        return _placed(places, self, label)


def _placed(places: Places, seat: Seat, label: str) -> Hypothesis:
    """A part with its amplitude, which is one but for what the equation leaves out."""
    gear = places.gear
    weights: Weights = {label: seat.locus.mask(gear.model.layout)}
    names: tuple[str, ...] = ("stiffness", "damping")
    if seat.effect == "bearing_clearance":
        names = ("clearance", *names)
        push = np.zeros(len(gear.model.layout.bodies))
        push[2] = 1.0
        weights[balance.NAME, f"{label} carrier"] = balance.accelerations(gear.model) @ push
    main = places.coefficient("amplitude", weights, 0.1, center=1.0)
    options = tuple(zip(names, seat.theta, strict=True))
    return Hypothesis(seat.effect, options, seat.locus, (main,), 1, seat)


def candidates(gear: Gear) -> Iterator[Seat]:
    """Rings and pins over a grid of their main parameter."""
    effects = known_effects()
    for locus in effects["ring_flexibility"].candidates(gear.model.layout):
        for stiffness in RING_N_PER_M:
            yield Seat("ring_flexibility", locus, (float(stiffness), RING_RATIO))
    for locus in effects["bearing_clearance"].candidates(gear.model.layout):
        for clearance in CLEARANCES_M:
            yield Seat("bearing_clearance", locus, (float(clearance), SEAT_N_PER_M, SEAT_RATIO))


class Trial:
    """Squares that the force law leaves with a seat, calibration held.

    Args:
        gear: with its runs.
        amplitudes: of the calibration.
    """

    def __init__(self, gear: Gear, amplitudes: Amplitudes) -> None:
        self.gear = gear
        self._changes, self._forces = [], []
        self._without: dict[Locus, float] = {}
        for r, g in enumerate(gear.runs):
            of_law = {f: a[r] for f, a in amplitudes.get(force_law.NAME, {}).items()}
            change = gear.change_of(g.some, of_law)
            self._changes.append(change)
            self._forces.append(measured(g.some, law(g.some, change)))

    def left(self, seat: Seat | None, locus: Locus, every: int = 1) -> float:
        """Squares left on the meshes of a locus, of every so-manieth run."""
        at = np.flatnonzero((locus.mask(self.gear.model.layout) > 0.0) & ~self.gear.modelled)
        left = 0.0
        runs = list(zip(self.gear.runs, self._forces, self._changes, strict=True))
        for g, F, whole in runs[::every]:
            m, change = on_meshes(g.some, whole, at)
            if seat is not None:
                way, rate = self._way(seat, g.some, F, at)
                change.d, change.d_rate = change.d + way, change.d_rate + rate
            now = law(m, change)
            left += float(np.sum(((m.F - now.force) / now.sigma) ** 2))
        return left

    def fall(self, seat: Seat) -> float:
        """Squares that a seat takes off, of every other run."""
        if seat.locus not in self._without:
            self._without[seat.locus] = self.left(None, seat.locus, 2)
        return self._without[seat.locus] - self.left(seat, seat.locus, 2)

    def _way(self, seat: Seat, m: Motion, F: Array, at: NDArray[np.int64]) -> tuple[Array, Array]:
        """Displacement and rate on some meshes."""
        theta = np.array(seat.theta)
        cos_beta = self.gear.model.scales.cos_beta
        if seat.effect == "ring_flexibility":
            side = (at % (F.shape[1] // 2)) // (F.shape[1] // 4)
            u = -cos_beta * ring_motion(self.gear, theta, m, F)[:, side]
            return u[:, :, 0], u[:, :, 1]
        w = -cos_beta * bearing_motion(self.gear, seat.locus, theta, m, F)
        return w[:, :1], w[:, 1:]

    def fitted(self, seat: Seat, tries: int = 50) -> Seat:
        """Parameters that leave least, by Nelder and Mead over their logarithms."""
        start = np.log(seat.theta)

        def cost(log: Array) -> float:
            inside = np.clip(log, start - REACH, start + REACH)
            return self.left(replace(seat, theta=tuple(np.exp(inside).tolist())), seat.locus)

        found = minimize(
            cost,
            start,
            method="Nelder-Mead",
            options={
                "maxfev": tries,
                "xatol": 1e-3,
                "fatol": 1.0,
                "initial_simplex": _simplex(start),
            },
        )
        inside = np.clip(found.x, start - REACH, start + REACH)
        return replace(seat, theta=tuple(np.exp(inside).tolist()))


REACH = np.log(30.0)  # a parameter is sought within one and a half decades of the grid


def _simplex(start: Array) -> Array:
    """Corners half an order of magnitude apart."""
    return np.vstack([start, start + 0.6 * np.eye(len(start))])


def proposals(gear: Gear, amplitudes: Amplitudes, per_effect: int = 1) -> list[Seat]:
    """The most promising rings and pins, fitted."""
    trial = Trial(gear, amplitudes)
    ranked = sorted(candidates(gear), key=trial.fall, reverse=True)
    found: dict[str, list[Seat]] = {}
    for seat in ranked:
        of = found.setdefault(seat.effect, [])
        if len(of) < per_effect and all(seat.locus != other.locus for other in of):
            of.append(seat)
    return [trial.fitted(seat) for of in found.values() for seat in of]
