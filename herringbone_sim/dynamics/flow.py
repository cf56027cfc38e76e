"""A flow as a map over one period of its forcing, with tangent vectors running along.

All methods of ``dynamics`` ask for no more than this: the gear is one flow, the Lorenz system and
the Hénon map of the tests are others.
"""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.batch import alike_halves
from herringbone_sim.core.batch import layout_mirror as mirror
from herringbone_sim.core.model import Model, initial_state
from herringbone_sim.core.packed import TWO_PI, make_work
from herringbone_sim.core.run import LIMIT, crosser
from herringbone_sim.errors import DivergenceError, ParameterError

Array = NDArray[np.float64]

MOST_ORDER = 64  # largest denominator of an order of the control
MOST_CYCLES = 2100  # of a period: any two members of the nominal rig meet again within 2079


class Flow(Protocol):
    """A map y -> y' and its linear part.

    1. ``n`` is the number of states, ``period`` the time that one ``advance`` takes (1 for a map).
    2. ``advance`` leaves its arguments as they are, and its result depends on them alone. Where
       the forcing repeats with each advance it does not depend on ``at``.
    3. Tangent vectors are rows here, (k, n), k may be 0; they are neither scaled nor turned.
    """

    @property
    def n(self) -> int: ...

    @property
    def period(self) -> float: ...

    def advance(self, y: Array, tangents: Array, at: int = 0) -> tuple[Array, Array]:
        """State (n,) and tangents (k, n) one period later, when ``at`` periods have passed.

        Raises:
            DivergenceError: the state left the range of the flow.
        """
        ...


class GearFlow:
    """A gear over one period of its forcing, or over mesh cycles of which it takes more.

    Where force is continuous in the displacement the saltation matrix of a switch of contact is
    the identity: tangents pass unchanged. Where it jumps (damping in contact) they jump with it.

    Args:
        model: see ``effects.assemble``; with ``method: rk4`` it has no tangents.
        cycles: mesh cycles that one advance takes; a period of the forcing by default. Exponents
            and sections need none: they take the cycles one by one, whatever comes when.

    Raises:
        ParameterError: no cycles were given, and the forcing has no period, see ``period_of``.
    """

    def __init__(self, model: Model, cycles: int | None = None) -> None:
        layout, p = model.layout, model.parameters
        self.model = model
        self.cycles = period_of(model) if cycles is None else cycles
        self._work = make_work(layout.n_mesh, layout.n_coordinate, p.order, model.n_own)
        self._cross = crosser(p.method, model.packed.plain)

    @property
    def n(self) -> int:
        return self.model.n_state

    @property
    def period(self) -> float:
        """Dimensionless time tau that one advance takes."""
        return self.cycles * TWO_PI / self.model.packed.Omega

    def start(self) -> Array:
        """Initial state (n,) at phase 0 by the parameters, further coordinates at rest."""
        return np.concatenate([initial_state(self.model), np.zeros(2 * self.model.n_own)])

    def advance(self, y: Array, tangents: Array, at: int = 0) -> tuple[Array, Array]:
        """State (n,) and tangents (k, n) one period later, from phase 0 to phase 0.

        Args:
            at: advances that the gear has run before; where one is a period of the forcing, this
                changes nothing but rounding.

        Raises:
            DivergenceError: the state left the range of any physical motion.
            ParameterError: tangents under ``method: rk4``, which steps over the kinks.
        """
        p = self.model.parameters
        if len(tangents) and p.method == "rk4":
            raise ParameterError("tangents need method: taylor, got rk4: change method")
        y, tangents = np.array(y, dtype=float), np.array(tangents, dtype=float)
        first = at * self.cycles
        self._cross(self.model.packed, self._work, y, tangents, None, first, self.cycles, p.steps)
        if not float(np.abs(y).max()) < LIMIT:
            raise DivergenceError(
                f"the motion left the range of any gear: displacements beyond {LIMIT:g} b_c"
            )
        return y, tangents

    def map(self, y: Array) -> tuple[Array, Array]:
        """State (n,) one period later, and the monodromy matrix (n, n) there: dy' = M dy."""
        y, tangents = self.advance(y, np.eye(self.n))
        return y, tangents.T


def period_of(model: Model) -> int:
    """Mesh cycles after which the excitation of a gear, effects included, repeats.

    Raises:
        ParameterError: it repeats only after more than 2100 mesh cycles, or never.
    """
    p = model.packed
    of_effects = [*p.orders, *p.load_orders, *(1.0 / p.windows[:, 0])]
    each = [cycles_of(float(order), MOST_CYCLES) for order in of_effects]
    each += [cycles_of(p.control_order)] if p.K else []
    cycles = math.lcm(*each)
    if cycles > MOST_CYCLES:
        raise ParameterError(
            f"a periodic orbit needs a forcing that repeats within {MOST_CYCLES} mesh cycles; "
            f"control and effects of this gear repeat together after {cycles}: leave one out"
        )
    return cycles


def effect_cycles(model: Model) -> int:
    """Mesh cycles after which the effects of a gear repeat, whatever its control does.

    1 without effects, and where they repeat too late for any period to be told, see ``period_of``.
    """
    try:
        return period_of(replace(model, packed=model.packed._replace(K=0.0)))
    except ParameterError:
        return 1


def cycles_of(order: float, most: int = MOST_ORDER) -> int:
    """Mesh cycles after which a harmonic of this order of the mesh frequency repeats.

    Raises:
        ParameterError: more than ``most``.
    """
    ratio = Fraction(order).limit_denominator(most)
    if abs(float(ratio) - order) > 1e-12 * max(order, 1.0):
        raise ParameterError(
            f"a forcing repeats if its order (control_order, or that of a harmonic of an effect) "
            f"is a ratio of whole numbers with a denominator up to {most}, got {order!r}: choose "
            "such a one"
        )
    return ratio.denominator


def symmetry(model: Model) -> NDArray[np.int64] | None:
    """``mirror`` where left and right of a gear are alike to the last bit, else None."""
    return mirror(model.layout) if alike_halves(model) else None


def settle(flow: Flow, y: Array, periods: int, at: int = 0) -> Array:
    """State (n,) after so many periods, ``at`` of which had passed before; without tangents."""
    none = np.zeros((0, flow.n))
    for i in range(periods):
        y, _ = flow.advance(y, none, at + i)
    return y
