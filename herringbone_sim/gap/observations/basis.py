"""Functions of what is measured, of which the curves of effects are made.

Each function has a slot of the law, values over the samples and, for displacements, a rate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.gap.observations.law import Law, Motion

Array = NDArray[np.float64]
Values = Callable[[Motion, Law], Array]
ORDERS = tuple(range(1, 9))  # mesh orders below which a tooth flank's own form lies
TURNS = (1, 2, 3)  # harmonics of a turn
LOADS_M = np.array([1e-7, 5e-7, 2e-6, 8e-6, 3e-5, 1e-4])  # |f| from a static to a violent load


@dataclass(frozen=True)
class Function:
    """One function of the samples.

    Attributes:
        name: unique.
        slot: of the law, see ``law.SLOTS``.
        values: (motion, law) -> (n,) or (n, n_mesh).
        rate: the same of its time derivative, for displacements that move.
        bent: (motion, amplitudes (n_mesh,)) -> what they add to the slot and its rate, where that
            is not the amplitudes times ``values``; these are then the slope at zero.
        meshes: numbers of the only ones it acts on; None for all.
    """

    name: str
    slot: str
    values: Values
    rate: Values | None = None
    bent: Callable[[Motion, Array], tuple[Array, Array]] | None = None
    meshes: tuple[int, ...] | None = None

    def acts_on(self, mesh: int) -> bool:
        return self.meshes is None or mesh in self.meshes


def wave(name: str, slot: str, order: float, sine: bool) -> Function:
    """cos or sin of ``order`` times the mesh phase."""
    trig = np.sin if sine else np.cos
    other = np.cos if sine else np.sin
    sign = 1.0 if sine else -1.0

    def values(m: Motion, _: Law) -> Array:
        return np.asarray(trig(order * m.phase))

    def rate(m: Motion, _: Law) -> Array:
        return np.asarray(sign * order * m.omega * other(order * m.phase))

    return Function(name, slot, values, rate)


def waves(slot: str, label: str, orders: dict[str, float]) -> list[Function]:
    return [
        wave(f"{label} {key} {'sin' if sine else 'cos'}", slot, order, sine)
        for key, order in orders.items()
        for sine in (False, True)
    ]


def hat(knots: Array, i: int, at: Array) -> Array:
    """Piecewise linear hat i over knots; the outermost hold beyond them."""
    y = np.zeros(len(knots))
    y[i] = 1.0
    return np.asarray(np.interp(at, knots, y))


def load_hats(slot: str, label: str) -> list[Function]:
    """Hats over log |f|."""
    knots = np.log(LOADS_M)

    def made(i: int) -> Function:
        def values(_: Motion, law: Law) -> Array:
            return hat(knots, i, np.log(np.maximum(np.abs(law.f), 1e-12)))

        return Function(f"{label} {i}", slot, values)

    return [made(i) for i in range(len(knots))]


def constant(name: str, slot: str) -> Function:
    return Function(name, slot, lambda m, law: np.ones(len(m.phase)))


def column(function: Function, m: Motion, law: Law) -> Array:
    """(n, n_mesh) change of the force by one unit of a function."""
    g = function.values(m, law)
    g = g[:, None] if g.ndim == 1 else g
    slot = function.slot
    if slot == "kappa":
        return law.k * law.f * g
    if slot == "mean_kappa":
        return m.k_m * law.f * g
    if slot == "d":
        moved = law.k * (law.drive + law.back) * g
        if function.rate is not None:
            rate = function.rate(m, law)
            moved = moved + law.c * (rate[:, None] if rate.ndim == 1 else rate)
        return moved
    if slot == "b_plus":
        return -law.k * law.drive * g
    if slot == "b_minus":
        return law.k * law.back * g
    if slot == "gamma":
        return law.damper * g
    return np.broadcast_to(g, m.x.shape)
