"""Basis functions of measured quantities; effects on the force law are weighted sums of them.

Each function acts in one term (slot) of the law, see ``law.LawChange``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.gap.residuals.mesh_law import Law, MeshMotion

Values = Callable[[MeshMotion, Law], Array]
# Mesh orders of waves of the stiffness and of the tooth profile, chosen.
ORDERS = tuple(range(1, 9))
TURNS = tuple(range(1, 7))  # harmonics of a revolution, chosen: long waves of a pitch error
# Knots over the deflection |f| [m], chosen: from static to violent load.
LOADS_M = np.array([1e-7, 5e-7, 2e-6, 8e-6, 3e-5, 1e-4, 3e-4, 1e-3])


@dataclass(frozen=True)
class Function:
    """One basis function.

    Attributes:
        name: unique name.
        slot: field of ``law.LawChange`` that it adds to, or ``body``: a force on the carrier [N].
        values: (motion, law) -> (n,) or (n, n_mesh): what a unit amplitude adds to the slot.
        rate: (motion, law) -> time derivative of ``values``, for slot ``d``; None: zero.
        nonlinear: (motion, amplitudes (n_mesh,)) -> change of the slot and of its rate, where
            these are not proportional to the amplitudes; ``values`` is then the slope at zero.
        meshes: indices of the meshes that it acts on; None: all.
        by_law: whether ``values`` or ``rate`` depend on the law, beside the motion; if not, they
            are also evaluated with an empty one.
    """

    name: str
    slot: str
    values: Values
    rate: Values | None = None
    nonlinear: Callable[[MeshMotion, Array], tuple[Array, Array]] | None = None
    meshes: tuple[int, ...] | None = None
    by_law: bool = False

    def acts_on(self, mesh: int) -> bool:
        """Whether it acts on the mesh with this index."""
        return self.meshes is None or mesh in self.meshes


def harmonic_functions(slot: str, label: str, orders: dict[str, float]) -> list[Function]:
    """Return cos and sin of the mesh phase times each order, named ``LABEL KEY cos`` (``sin``).

    ``orders``: periods per mesh cycle, by key.
    """

    def made(key: str, order: float, sine: bool) -> Function:
        trig, other, sign = (np.sin, np.cos, 1.0) if sine else (np.cos, np.sin, -1.0)

        def values(m: MeshMotion, _: Law) -> Array:
            return np.asarray(trig(order * m.phase))

        def rate(m: MeshMotion, _: Law) -> Array:
            return np.asarray(sign * order * m.omega * other(order * m.phase))

        return Function(f"{label} {key} {'sin' if sine else 'cos'}", slot, values, rate)

    return [made(key, order, sine) for key, order in orders.items() for sine in (False, True)]


def hat(knots: Array, i: int, at: Array) -> Array:
    """Evaluate the hat function of knot i at ``at``; constant beyond the outermost knots."""
    y = np.zeros(len(knots))
    y[i] = 1.0
    return np.asarray(np.interp(at, knots, y))


def load_hat_functions(slot: str, label: str) -> list[Function]:
    """Return hat functions of log |f|, f the deflection, at ``LOADS_M``; named ``LABEL i``."""
    knots = np.log(LOADS_M)

    def made(i: int) -> Function:
        def values(_: MeshMotion, law: Law) -> Array:
            return hat(knots, i, np.log(np.maximum(np.abs(law.f), 1e-12)))

        return Function(f"{label} {i}", slot, values, by_law=True)

    return [made(i) for i in range(len(knots))]


def constant_function(name: str, slot: str) -> Function:
    """Return the function that is 1 at all samples."""
    return Function(name, slot, lambda m, law: np.ones(len(m.phase)))


def force_column(function: Function, m: MeshMotion, law: Law) -> Array:
    """Derivative (n, n_mesh) of the mesh forces by the amplitude of a function, in newtons."""
    g = function.values(m, law)
    g = g[:, None] if g.ndim == 1 else g
    slot = function.slot
    if slot == "kappa":
        return m.k * law.f * g
    if slot == "mean_kappa":
        return m.k_m * law.f * g
    if slot == "d":
        moved = law.k * (law.contact_drive + law.contact_back) * g
        if function.rate is not None:
            rate = function.rate(m, law)
            moved = moved + law.c * (rate[:, None] if rate.ndim == 1 else rate)
        return moved
    if slot == "b_plus":
        return -law.k * law.contact_drive * g
    if slot == "b_minus":
        return law.k * law.contact_back * g
    if slot == "gamma":
        return law.damper * g
    return np.broadcast_to(g, m.x.shape)
