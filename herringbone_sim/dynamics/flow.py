"""Interface of a periodically forced flow: its map over one forcing period, with tangent vectors.

All methods of ``dynamics`` need only this interface. The gear is one flow; the Lorenz system and
the Hénon map of the tests are others.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Protocol

import numpy as np

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.integrate import stepper
from herringbone_sim.core.mirror import has_equal_halves, state_mirror
from herringbone_sim.core.model import Model
from herringbone_sim.core.packed import LIMIT, TWO_PI
from herringbone_sim.core.sensitivity import need_tangents
from herringbone_sim.effects.assemble import changed
from herringbone_sim.errors import DivergenceError, ParameterError

MOST_ORDER = 64  # largest denominator of the control order: mesh cycles until it repeats
MOST_CYCLES = 2100  # longest forcing period; two bodies of the default gear need 2079 at most


class Flow(Protocol):
    """A map y -> y' over one forcing period and its linearisation.

    1. ``n`` is the number of states, ``period`` the time that one ``advance`` takes (1 for a map).
    2. ``advance`` does not modify its arguments, and its result depends on them alone. It depends
       on ``at``, the number of periods elapsed before y, only if the forcing differs by period.
    3. Tangent vectors are rows, (k, n), k may be 0; they are neither scaled nor orthogonalised.
    """

    @property
    def n(self) -> int: ...

    @property
    def period(self) -> float: ...

    def advance(self, y: Array, tangents: Array, at: int = 0) -> tuple[Array, Array]:
        """State (n,) and tangents (k, n) one period after y (n,) and ``tangents`` (k, n).

        Args:
            at: periods elapsed before y.

        Raises:
            DivergenceError: the state left the range of the flow.
        """
        ...


class GearFlow:
    """Flow of a gear over one forcing period, or over a given number of mesh cycles.

    Where the force is continuous in the displacement, the saltation matrix of a contact switch is
    the identity and tangents pass unchanged. Where the force jumps (damping in contact) the
    saltation matrix is applied.

    Args:
        model: see ``effects.assemble``; ``method: rk4`` can't integrate tangents.
        cycles: mesh cycles of one advance; by default the forcing period, see ``period_of``.
            Exponents and sections use 1: their forcing need not be periodic.

    Raises:
        ParameterError: ``cycles`` is None and the forcing has no period.
    """

    def __init__(self, model: Model, cycles: int | None = None) -> None:
        self.model = model
        self.cycles = period_of(model) if cycles is None else cycles
        self._stepper = stepper(model)

    @property
    def n(self) -> int:
        return self.model.n_state

    @property
    def period(self) -> float:
        """Dimensionless time tau of one advance."""
        return self.cycles * TWO_PI / self.model.packed.Omega

    def start(self) -> Array:
        """Initial state (n,) at phase 0 from the parameters; states added by effects at rest."""
        return self._stepper.start().y

    def advance(self, y: Array, tangents: Array, at: int = 0) -> tuple[Array, Array]:
        """State (n,) and tangents (k, n) one advance later, from phase 0 to phase 0.

        Args:
            at: advances elapsed before y, which sets the phase of control and effects; if one
                advance is a forcing period, it only affects rounding.

        Raises:
            DivergenceError: the state left the range of any physical motion.
            ParameterError: tangents under ``method: rk4``, which steps over the kinks of the
                force.
        """
        if len(tangents):
            need_tangents(self.model)
        y, tangents = self._stepper.advance_cycles(y, tangents, at * self.cycles, self.cycles)
        if not float(np.abs(y).max()) < LIMIT:
            raise DivergenceError(
                f"the motion left the range of any gear: displacements beyond {LIMIT:g} b_c"
            )
        return y, tangents

    def map(self, y: Array) -> tuple[Array, Array]:
        """State (n,) one advance later and the monodromy matrix M (n, n): dy' = M dy."""
        y, tangents = self.advance(y, np.eye(self.n))
        return y, tangents.T


def period_of(model: Model) -> int:
    """Forcing period of a gear in mesh cycles: that of its mesh, effects and control together.

    Raises:
        ParameterError: it is longer than 2100 mesh cycles, or infinite.
    """
    p = model.packed
    of_effects = [*p.orders, *p.load_orders, *(1.0 / p.events[:, 0])]
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
    """Forcing period of a gear in mesh cycles, as if its control were switched off.

    1 without effects, and also if ``period_of`` finds no period.
    """
    try:
        return period_of(changed(model, model.parameters.changed({"K": 0.0})))
    except ParameterError:
        return 1


def forcing_cycles(model: Model) -> int:
    """Forcing period of a gear in mesh cycles, that of control and effects together.

    Where they have none together, that of the effects, see ``effect_cycles``.
    """
    try:
        return period_of(model)
    except ParameterError:
        return effect_cycles(model)


def cycles_of(order: float, most: int = MOST_ORDER) -> int:
    """Mesh cycles after which a harmonic of an order (frequency over mesh frequency) repeats.

    Raises:
        ParameterError: the order is no ratio of whole numbers with a denominator up to ``most``.
    """
    ratio = Fraction(order).limit_denominator(most)
    if abs(float(ratio) - order) > 1e-12 * max(order, 1.0):
        raise ParameterError(
            f"a forcing repeats if its order (control_order, or that of a harmonic of an effect) "
            f"is a ratio of whole numbers with a denominator up to {most}, got {order!r}: choose "
            "such a one"
        )
    return ratio.denominator


def symmetry(model: Model) -> Indices | None:
    """Indices (n,) that swap left and right in a state, if the halves of a gear are bitwise equal.

    Else None.
    """
    return state_mirror(model) if has_equal_halves(model) else None


def settle(flow: Flow, y: Array, periods: int, at: int = 0) -> Array:
    """State (n,) after ``periods`` calls of ``flow.advance`` from y, without tangents.

    ``at`` is the number of calls before y; a call need not be a period of the forcing.
    """
    none = np.zeros((0, flow.n))
    for i in range(periods):
        y, _ = flow.advance(y, none, at + i)
    return y


def iterate(flow: Flow, y: Array, n: int, at: int = 0) -> Array:
    """Trajectory of n states (n, n_state), each a call of ``flow.advance`` after the one before.

    The first is y; ``at`` is the number of calls before it. May raise DivergenceError.
    """
    points = [y]
    for i in range(n - 1):
        points.append(settle(flow, points[-1], 1, at + i))
    return np.array(points)
