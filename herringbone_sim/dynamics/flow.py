"""A flow as a map over one period of its forcing, with tangent vectors running along.

All methods of ``dynamics`` ask for no more than this: the gear is one flow, the Lorenz system and
the Hénon map of the tests are others.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.layout import Layout
from herringbone_sim.core.model import Model, initial_state
from herringbone_sim.core.packed import TWO_PI, make_work
from herringbone_sim.core.run import LIMIT, cross
from herringbone_sim.errors import DivergenceError, ParameterError

Array = NDArray[np.float64]

MOST_CYCLES = 64


class Flow(Protocol):
    """A map y -> y' and its linear part.

    1. ``n`` is the number of states, ``period`` the time that one ``advance`` takes (1 for a map).
    2. ``advance`` leaves its arguments as they are, and its result depends on them alone.
    3. Tangent vectors are rows here, (k, n), k may be 0; they are neither scaled nor turned.
    """

    @property
    def n(self) -> int: ...

    @property
    def period(self) -> float: ...

    def advance(self, y: Array, tangents: Array) -> tuple[Array, Array]:
        """State (n,) and tangents (k, n) one period later; DivergenceError out of range."""
        ...


class GearFlow:
    """A gear over one period of its forcing: a mesh cycle, or as many as the control needs.

    The saltation matrix of a switch of contact is the identity (force is continuous in the
    displacement), so tangents pass unchanged and see the new stiffness from there on.

    Args:
        model: see ``core.model.build``; with ``method: rk4`` it has no tangents.

    Raises:
        ParameterError: a control whose order does not repeat within 64 mesh cycles.
    """

    def __init__(self, model: Model) -> None:
        layout, p = model.layout, model.parameters
        self.model = model
        self.cycles = cycles_of(p.control_order) if p.K else 1
        self._work = make_work(layout.n_mesh, layout.n_coordinate, p.order)

    @property
    def n(self) -> int:
        return self.model.layout.n_state

    @property
    def period(self) -> float:
        """Period of the forcing in dimensionless time tau."""
        return self.cycles * TWO_PI / self.model.packed.Omega

    def start(self) -> Array:
        """Initial state (n,) at phase 0 by the parameters."""
        return initial_state(self.model)

    def advance(self, y: Array, tangents: Array) -> tuple[Array, Array]:
        """State (n,) and tangents (k, n) one period later, from phase 0 to phase 0.

        Raises:
            DivergenceError: the state left the range of any physical motion.
            ParameterError: tangents under ``method: rk4``, which steps over the kinks.
        """
        p = self.model.parameters
        if len(tangents) and p.method == "rk4":
            raise ParameterError("tangents need method: taylor, got rk4: change method")
        y, tangents = np.array(y, dtype=float), np.array(tangents, dtype=float)
        cross(
            self.model.packed, self._work, y, tangents, 0, self.cycles, p.steps, p.method == "rk4"
        )
        if not float(np.abs(y).max()) < LIMIT:
            raise DivergenceError(
                f"the motion left the range of any gear: displacements beyond {LIMIT:g} b_c"
            )
        return y, tangents

    def map(self, y: Array) -> tuple[Array, Array]:
        """State (n,) one period later, and the monodromy matrix (n, n) there: dy' = M dy."""
        y, tangents = self.advance(y, np.eye(self.n))
        return y, tangents.T


def cycles_of(control_order: float) -> int:
    """Mesh cycles after which a control of this order repeats."""
    ratio = Fraction(control_order).limit_denominator(MOST_CYCLES)
    if abs(float(ratio) - control_order) > 1e-12 * max(control_order, 1.0):
        raise ParameterError(
            f"control_order must be a ratio of whole numbers with a denominator up to "
            f"{MOST_CYCLES} for a flow that repeats, got {control_order!r}"
        )
    return ratio.denominator


def mirror(layout: Layout) -> NDArray[np.int64]:
    """Indices (n_state,) that swap left and right: ``y[mirror(layout)]`` is the mirrored state."""
    m, c = layout.n_coordinate, layout.n_classes
    one = np.concatenate([[1, 0], 2 + np.roll(np.arange(2 * c), c)])
    return np.concatenate([one, m + one])


def symmetry(model: Model) -> NDArray[np.int64] | None:
    """``mirror`` where left and right of a gear are alike to the last bit, else None."""
    c = model.layout.n_classes
    for value in model.packed:
        if isinstance(value, np.ndarray) and value.size:
            sides = (
                value.reshape(-1, 2, c) if value.shape[-1] == 4 * c else value.reshape(1, 2, -1)
            )
            if not np.array_equal(sides[:, 0], sides[:, 1]):
                return None
    return mirror(model.layout)


def settle(flow: Flow, y: Array, periods: int) -> Array:
    """State (n,) after so many periods, without tangents."""
    none = np.zeros((0, flow.n))
    for _ in range(periods):
        y, _ = flow.advance(y, none)
    return y
