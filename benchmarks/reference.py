"""An independent integration of a gear with effects: their own laws, DOP853, located events.

It shares with the kernel of the gear no more than Newton's law of the bodies. Its steps end where
a law has a kink: a border of contact, a change of sign of a mesh force, the pitch point, an edge
of a tooth event.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model
from herringbone_sim.effects.assemble import by_laws
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.gear import pointers_allowed
from herringbone_sim.effects.law_stepper import LawStepper
from herringbone_sim.effects.run import forces_of_state, slope_of

PLAY = 2


class Reference:
    """dy/dtau of a gear with effects by their laws, and what switches in it."""

    def __init__(self, model: Model, actives: Sequence[Active]) -> None:
        self._gear = LawStepper(by_laws(model, actives)).gear
        self._bare, g = model.bare, self._gear
        self._head = (g.e, g.site, g.theta, g.gear, model.bare, g.si, g.now)
        self.unit = g.unit
        self.n_added_states = g.unit.size - model.layout.n_state

    def slope(self, tau: float, y: Array) -> Array:
        phase, cycle = self._place(tau)
        dy = np.empty_like(y)
        slope_of(*self._head, cycle, phase, y, self._gear.w, self._gear.g, dy)
        return dy

    def margins(self, tau: float, y: Array) -> Array:
        """What switches where it changes its sign: contact of each mesh, then its force."""
        phase, cycle = self._place(tau)
        w = self._gear.w
        self._gear.now[0] = 2 * np.pi * cycle + phase
        forces_of_state(*self._head, y, w, self._gear.g)
        return np.concatenate([(w.x - w.law[PLAY]) * 1e5, (w.x + w.law[PLAY]) * 1e5, w.force])

    def _place(self, tau: float) -> tuple[float, int]:
        turn = tau * self._bare.Omega / (2 * np.pi)
        cycle = int(np.floor(turn + 1e-13))
        return 2 * np.pi * (turn - cycle), cycle


def in_si(model: Model, y: Array, n_added_states: int) -> Array:
    """The state as the effects' own laws take it: further coordinates in pairs, SI units.

    Pins and rings that do not move have states there, and none in the slots.
    """
    n, s, scales = model.layout.n_state, model.n_added_coordinates, model.scales
    added: Array = np.zeros(n_added_states)
    added[: 2 * s : 2] = y[n : n + s] * scales.b_c
    added[1 : 2 * s : 2] = y[n + s :] * scales.velocity_m_per_s
    return np.concatenate([y[:n], added])


def integrate(
    model: Model,
    actives: Sequence[Active],
    y: Array,
    cycle: int,
    cycles: int,
    edges: Sequence[float] = (),
    tolerance: float = 1e-12,
) -> Array:
    """State after so many mesh cycles, own states of effects in SI units behind the others.

    Args:
        edges: mesh cycles at which the excitation has a kink, beside each half cycle.
    """
    gear = Reference(model, actives)
    period = 2 * np.pi / model.bare.Omega
    ends = np.unique([*np.arange(2 * cycle + 1, 2 * (cycle + cycles) + 1) / 2, *edges])
    ends = ends[(ends > cycle) & (ends <= cycle + cycles)]
    tau = cycle * period
    with pointers_allowed():
        for end in ends * period:
            while tau < end:
                tau, y = _piece(gear, tau, y, float(end), tolerance)
    return y


def _piece(
    gear: Reference, tau: float, y: Array, end: float, tolerance: float
) -> tuple[float, Array]:
    """Up to the next kink, and just beyond it."""
    solver = _solver(gear, tau, y, end, tolerance)
    before = gear.margins(tau, y)
    while solver.status == "running":
        start = solver.t
        solver.step()
        after = gear.margins(solver.t, solver.y)
        crossed = np.flatnonzero(np.sign(before) * np.sign(after) < 0)
        if len(crossed):
            dense = solver.dense_output()
            at = min(_root(gear, dense, int(k), start, solver.t) for k in crossed)
            past = min(at + 1e-13, end)
            if past - tau > 1e-12:
                exact = _solver(gear, tau, y, at, tolerance)
                while exact.status == "running":
                    exact.step()
                return past, exact.y + (past - at) * gear.slope(past, exact.y)
        before = after
    return float(solver.t), solver.y


def _solver(gear: Reference, tau: float, y: Array, end: float, tolerance: float) -> DOP853:
    scale = tolerance * gear.unit
    return DOP853(gear.slope, tau, y, end, rtol=tolerance, atol=scale, max_step=0.2)


def _root(gear: Reference, dense: Any, k: int, start: float, end: float) -> float:
    """Where margin k changes its sign."""
    return float(brentq(lambda at: gear.margins(at, dense(at))[k], start, end, xtol=1e-15))
