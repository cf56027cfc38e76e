"""heyoka's rows: Taylor series of adaptive step with terminal events at each switch of contact.

The contact of each mesh is a runtime parameter, so one compilation serves all values; an event
changes it. heyoka wants that done in Python: the callbacks write through memoryviews, which is
the cheapest way found. Batches of 8 fill a vector register of 512 bits. A second form has the
backlash as ``relu`` without events: the series is then cut by no kink and loses its order.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any

import heyoka as hy
import numpy as np

from benchmarks.peers import problem
from benchmarks.peers.methods import OrbitMethod, SweepMethod
from benchmarks.peers.problem import (
    B_RP,
    B_SP,
    OBSERVED,
    TRANSIENT,
    Array,
    constants,
    initial_tangent,
    orbit_start,
    paper,
    rig,
    zero_start,
)
from herringbone_sim.core.packed import TWO_PI

TOLERANCES = (1e-5, 1e-6, 1e-7, 1e-9, 1e-12)
LANES = 8
TWIN = 1e-9  # the other side switches along when it is that near
CLOSED, OFFSET, LEVEL = 0, 4, 8  # places of the runtime parameters, each (4,)
DIMENSIONS = 12


def _meshes(y: list[Any]) -> list[Any]:
    return [y[0] - y[2], y[1] - y[3], y[2], y[3]]


def _accelerations(p: Array, force: list[Any], load: float) -> list[Any]:
    total = (force[0] + force[2]) + (force[1] + force[3])
    suns = [load * p[problem.LOAD_Q] - p[problem.N_S] * force[s] for s in (0, 1)]
    planets = [
        load * p[problem.LOAD_R] + p[problem.I_P] * (force[s] - force[2 + s]) for s in (0, 1)
    ]
    return [a - p[problem.TWO_N_C] * total for a in suns] + [
        a - p[problem.N_C] * total for a in planets
    ]


def _motion(p: Array, smooth: bool, names: str, load: float) -> tuple[list[Any], list[Any]]:
    """Equations of the motion (load 1) or of a tangent vector (load 0), and the deflections."""
    y = hy.make_vars(*(f"{names}{k}" for k in range(8)))
    cos = hy.cos(hy.time)
    e, rate = load * p[problem.E] * hy.sin(hy.time), load * p[problem.E] * cos
    k = [p[problem.K_SP] + p[problem.K_SP_1] * cos, p[problem.K_RP] + p[problem.K_RP_1] * cos]
    c = [p[problem.C_SP], p[problem.C_RP]]
    x = [d - e for d in _meshes(y[:4])]
    v = [d - rate for d in _meshes(y[4:])]
    level = [hy.par[LEVEL + m] for m in range(4)]
    if smooth:
        f = [hy.relu(x[m] - level[m]) - hy.relu(-x[m] - level[m]) for m in range(4)]
    else:
        f = [hy.par[CLOSED + m] * x[m] - load * hy.par[OFFSET + m] for m in range(4)]
    force = [k[m // 2] * f[m] + c[m // 2] * v[m] for m in range(4)]
    rates = [*y[4:], *_accelerations(p, force, load)]
    return list(zip(y, rates, strict=True)), x


class Heyoka:
    """Integrator of so many orbits at once.

    Args:
        p: constants of the gear; its backlash may differ from lane to lane, see ``start``.
        tolerance: heyoka's, which sets its order too.
        lanes: batch size.
        tangent: whether a tangent vector runs along.
        events: whether switches are events; ``relu`` otherwise.
    """

    def __init__(
        self, p: Array, tolerance: float, lanes: int, tangent: bool = False, events: bool = True
    ) -> None:
        equations, x = _motion(p, not events, "y", 1.0)
        if tangent:
            equations += _motion(p, False, "z", 0.0)[0]
        self._views: list[tuple[Any, ...]] = []
        pairs = [(m, side) for m in range(4) for side in (1.0, -1.0)] if events else []
        self.callbacks = [self._callback(m, side) for m, side in pairs]
        found = [
            hy.t_event_batch(x[m] - side * hy.par[LEVEL + m], callback=callback)
            for (m, side), callback in zip(pairs, self.callbacks, strict=True)
        ]
        self.ta = hy.taylor_adaptive_batch(
            equations,
            np.zeros((len(equations), lanes)),
            tol=tolerance,
            t_events=found,
            pars=np.zeros((DIMENSIONS, lanes)),
        )
        pars, state = ([memoryview(row) for row in a] for a in (self.ta.pars, self.ta.state))
        for m, twin in enumerate((1, 0, 3, 2)):
            places = (m, OFFSET + m, twin, OFFSET + twin, LEVEL + m)
            sun = (state[m], state[twin]) if m < 2 else (state[0], state[0])
            rows = (state[2 + m % 2], state[2 + twin % 2], *sun)
            self._views.append((*(pars[k] for k in places), *rows))

    def _callback(self, m: int, side: float) -> Callable[[Any, int, int], bool]:
        """Contact of mesh m, and of its twin where both are alike, at its level on one side."""

        def switch(_: Any, direction: int, lane: int) -> bool:
            closed, offset, twin, twin_offset, level, r, r_twin, q, q_twin = self._views[m]
            if direction * side > 0.0:
                closed[lane] = 1.0
                offset[lane] = side * level[lane]
            else:
                closed[lane] = offset[lane] = 0.0
            if -TWIN < (q[lane] - q_twin[lane]) - (r[lane] - r_twin[lane]) < TWIN:
                twin[lane], twin_offset[lane] = closed[lane], offset[lane]
            return True

        return switch

    def start(self, y: Array, p: Array) -> None:
        """Put lanes at phase 0 in states y (lanes, 8 or 16) of gears p (lanes, 15)."""
        self.ta.set_time(0.0)
        if self.ta.with_events:
            self.ta.reset_cooldowns()
        self.ta.state[:] = y.T
        level = p[:, [B_SP, B_SP, B_RP, B_RP]].T
        x = np.array(_meshes(list(y.T[:4])))
        side = np.where(x > level, 1.0, np.where(x < -level, -1.0, 0.0))
        self.ta.pars[CLOSED:OFFSET] = np.abs(side)
        self.ta.pars[OFFSET:LEVEL] = side * level
        self.ta.pars[LEVEL:] = level

    def to(self, cycle: int) -> Array:
        """States (lanes, n) at a mesh cycle."""
        self.ta.propagate_until(cycle * TWO_PI)
        return self.ta.state.T.copy()


def orbit_methods() -> list[OrbitMethod]:
    """Rows of work (a)."""
    found = [_on_orbit("heyoka, events", t, 1) for t in TOLERANCES]
    found += [_on_orbit(f"heyoka, events, batch of {LANES}", t, LANES) for t in TOLERANCES]
    return found + [_on_orbit("heyoka, relu without events", t, 1, False) for t in (1e-9, 1e-15)]


def _on_orbit(family: str, tolerance: float, lanes: int, events: bool = True) -> OrbitMethod:
    p = constants(rig())
    solver = Heyoka(p, tolerance, lanes, events=events)
    y, many = np.repeat(orbit_start()[None], lanes, axis=0), np.repeat(p[None], lanes, axis=0)

    def run(cycles: int) -> Array:
        solver.start(y, many)
        return solver.to(cycles)[-1]

    return OrbitMethod(family, f"tolerance {tolerance:g}", run, lanes)


class Counting(Heyoka):
    """Counts its callbacks."""

    calls = 0

    def _callback(self, m: int, side: float) -> Callable[[Any, int, int], bool]:
        switch = super()._callback(m, side)

        def count(ta: Any, direction: int, lane: int) -> bool:
            self.calls += 1
            return switch(ta, direction, lane)

        return count


def note() -> str:
    """Callbacks a mesh cycle on work (a), and what they cost when called from Python."""
    p, cycles, calls = constants(rig()), 200, 20_000
    solver = Counting(p, 1e-6, 1)
    solver.start(orbit_start()[None], p[None])
    solver.to(cycles)
    switch = Heyoka(p, 1e-6, 1).callbacks[0]
    began = time.perf_counter()
    for _ in range(calls):
        switch(None, 1, 0)
    each = (time.perf_counter() - began) / calls * 1e6
    a_cycle = solver.calls / cycles
    return (
        f"heyoka calls back {a_cycle:.1f} times a mesh cycle into Python; called from Python that "
        f"takes {a_cycle * each:.1f} us of its cost, which a C++ program would not pay"
    )


@functools.cache
def _sweeper(tolerance: float, tangent: bool) -> Heyoka:
    return Heyoka(constants(paper(0.0)), tolerance, LANES, tangent)


def _in_batches(values: Array, one: Callable[[Array, Array], Array]) -> Array:
    """Results (n, ...) of all values, eight at a time; the last batch is filled up."""
    found = []
    for first in range(0, len(values), LANES):
        some = np.resize(values[first : first + LANES], LANES)
        models = [paper(value) for value in some]
        starts = np.array([zero_start(model) for model in models])
        found.append(one(starts, np.array([constants(model) for model in models])))
    return np.concatenate(found)[: len(values)]


def diagram_methods() -> list[SweepMethod]:
    """Row of work (b)."""
    tolerance = 1e-6

    def sections(starts: Array, p: Array) -> Array:
        solver = _sweeper(tolerance, False)
        solver.start(starts, p)
        return np.stack([solver.to(TRANSIENT + i) for i in range(OBSERVED)], axis=1)

    def run(values: Array) -> Array:
        return _in_batches(values, sections)

    return [SweepMethod("heyoka, events, batch of 8", f"tolerance {tolerance:g}", run, most=80)]


def exponent_methods(cycles: int) -> list[SweepMethod]:
    """Row of work (c): the tangent vector runs along and is set to length 1 every cycle."""
    tolerance = 1e-6

    def exponents(starts: Array, p: Array) -> Array:
        plain, both = _sweeper(tolerance, False), _sweeper(tolerance, True)
        plain.start(starts, p)
        z = np.tile(initial_tangent(), (LANES, 1))
        both.start(np.hstack([plain.to(TRANSIENT), z]), p)
        growth = np.zeros(LANES)
        for cycle in range(1, cycles + 1):
            length = np.linalg.norm(both.to(cycle)[:, 8:], axis=1)
            both.ta.state[8:] /= length
            growth += np.log(length)
        return growth / (cycles * TWO_PI)

    def run(values: Array) -> Array:
        return _in_batches(values, exponents)

    return [SweepMethod("heyoka, events, batch of 8", f"tolerance {tolerance:g}", run, most=40)]
