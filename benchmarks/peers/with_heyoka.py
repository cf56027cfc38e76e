"""heyoka's rows: Taylor series of adaptive step with terminal events at each switch of contact.

The contact of each mesh is a runtime parameter, so one compilation serves all values; an event
changes it. heyoka wants that done in Python: the callbacks write through memoryviews, which is
the cheapest way found. Batches of 8 fill a vector register of 512 bits. A second form has the
backlash as ``relu`` without events: the series is then cut by no kink and loses its order.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Sequence
from typing import Any

import heyoka as hy
import numpy as np

from benchmarks.peers import problem
from benchmarks.peers.methods import OrbitMethod, SweepMethod
from benchmarks.peers.problem import (
    B_RP,
    B_SP,
    FROM_HALF,
    LEFT,
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


def _meshes(y: Sequence[Any]) -> list[Any]:
    """Deflections of sun meshes, then ring meshes, from displacements of suns, then planets."""
    sides = len(y) // 2
    return [*(y[s] - y[sides + s] for s in range(sides)), *y[sides:]]


def _accelerations(p: Array, force: Sequence[Any], load: float) -> list[Any]:
    """Accelerations of suns, then planets; the forces of one half stand for both."""
    sides = len(force) // 2
    total = (2.0 / sides) * hy.sum(list(force))
    suns = [load * p[problem.LOAD_Q] - p[problem.N_S] * f for f in force[:sides]]
    planets = [
        load * p[problem.LOAD_R] + p[problem.I_P] * (sun - ring)
        for sun, ring in zip(force[:sides], force[sides:], strict=True)
    ]
    of_carrier = p[problem.N_C] * total
    return [a - 2.0 * of_carrier for a in suns] + [a - of_carrier for a in planets]


class Heyoka:
    """Integrator of so many orbits at once.

    Runtime parameters, n = meshes of each: 1 in contact, or 0; its offset; its backlash.

    Args:
        p: constants of the gear; its backlash may differ from lane to lane, see ``start``.
        tolerance: heyoka's, which sets its order too.
        lanes: batch size.
        sides: 2, or 1 for one half that stands for both.
        tangent: whether a tangent vector runs along.
        events: whether switches are events; ``relu`` otherwise.
    """

    def __init__(
        self,
        p: Array,
        tolerance: float,
        lanes: int,
        sides: int = 2,
        tangent: bool = False,
        events: bool = True,
    ) -> None:
        self.sides, self.n = sides, 2 * sides
        equations, x = self._motion(p, not events, "y", 1.0)
        if tangent:
            equations += self._motion(p, False, "z", 0.0)[0]
        pairs = [(m, side) for m in range(self.n) for side in (1.0, -1.0)] if events else []
        self._views: list[tuple[Any, ...]] = []
        self.callbacks = [self._callback(m, side) for m, side in pairs]
        found = [
            hy.t_event_batch(x[m] - side * self._par(2, m), callback=callback)
            for (m, side), callback in zip(pairs, self.callbacks, strict=True)
        ]
        state, pars = np.zeros((len(equations), lanes)), np.zeros((3 * self.n, lanes))
        self.ta = hy.taylor_adaptive_batch(
            equations, state, tol=tolerance, t_events=found, pars=pars
        )
        self._look()

    def _par(self, kind: int, m: int) -> Any:
        return hy.par[kind * self.n + m]

    def _motion(
        self, p: Array, smooth: bool, name: str, load: float
    ) -> tuple[list[Any], list[Any]]:
        """Equations of the motion (load 1) or of a tangent vector (0), and the deflections."""
        y = hy.make_vars(*(f"{name}{k}" for k in range(2 * self.n)))
        cos = hy.cos(hy.time)
        e, rate = load * p[problem.E] * hy.sin(hy.time), load * p[problem.E] * cos
        k = [p[problem.K_SP] + p[problem.K_SP_1] * cos, p[problem.K_RP] + p[problem.K_RP_1] * cos]
        c = [p[problem.C_SP], p[problem.C_RP]]
        x, v = [d - e for d in _meshes(y[: self.n])], [d - rate for d in _meshes(y[self.n :])]
        force = [
            k[m // self.sides] * self._spring(x[m], m, smooth, load) + c[m // self.sides] * v[m]
            for m in range(self.n)
        ]
        rates = [*y[self.n :], *_accelerations(p, force, load)]
        return list(zip(y, rates, strict=True)), x

    def _spring(self, x: Any, m: int, smooth: bool, load: float) -> Any:
        if smooth:
            return hy.relu(x - self._par(2, m)) - hy.relu(-x - self._par(2, m))
        return self._par(0, m) * x - load * self._par(1, m)

    def _look(self) -> None:
        """Views of what the callbacks read and write; in one half every mesh is its own twin."""
        pars, state = ([memoryview(row) for row in a] for a in (self.ta.pars, self.ta.state))
        for m in range(self.n):
            twin = m ^ (self.sides - 1)
            places = (m, self.n + m, twin, self.n + twin, 2 * self.n + m)
            sun = (state[m], state[twin]) if m < self.sides else (state[0], state[0])
            of_planet = (state[self.sides + k % self.sides] for k in (m, twin))
            self._views.append((*(pars[k] for k in places), *of_planet, *sun))

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
        """Put lanes at phase 0 in states y (lanes, 2 n or 4 n) of gears p (lanes, 15)."""
        self.ta.set_time(0.0)
        if self.ta.with_events:
            self.ta.reset_cooldowns()
        self.ta.state[:] = y.T
        level = np.repeat(p[:, [B_SP, B_RP]].T, self.sides, axis=0)
        x = np.array(_meshes(list(y.T[: self.n])))
        side = np.where(x > level, 1.0, np.where(x < -level, -1.0, 0.0))
        self.ta.pars[:] = np.concatenate([np.abs(side), side * level, level])

    def to(self, cycle: int) -> Array:
        """States (lanes, n) at a mesh cycle."""
        self.ta.propagate_until(cycle * TWO_PI)
        return self.ta.state.T.copy()


def orbit_methods() -> list[OrbitMethod]:
    """Rows of work (a)."""
    batch = f"batch of {LANES}"
    kinds = [
        ("events", 1, 2),
        (f"events, {batch}", LANES, 2),
        (f"events, {batch}, half", LANES, 1),
    ]
    found = [_on_orbit(*kind, tolerance) for kind in kinds for tolerance in TOLERANCES]
    return [*found, _on_orbit("relu, no events", 1, 2, 1e-9, events=False)]


def _on_orbit(
    name: str, lanes: int, sides: int, tolerance: float, events: bool = True
) -> OrbitMethod:
    p = constants(rig())
    solver = Heyoka(p, tolerance, lanes, sides, events=events)
    one = orbit_start()[LEFT] if sides == 1 else orbit_start()
    y, many = np.repeat(one[None], lanes, axis=0), np.repeat(p[None], lanes, axis=0)

    def run(cycles: int) -> Array:
        solver.start(y, many)
        end = solver.to(cycles)[-1]
        return end[FROM_HALF] if sides == 1 else end

    return OrbitMethod(f"heyoka, {name}", f"tolerance {tolerance:g}", run, lanes)


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
    began = time.thread_time()
    for _ in range(calls):
        switch(None, 1, 0)
    each = (time.thread_time() - began) / calls * 1e6
    a_cycle = solver.calls / cycles
    return (
        f"heyoka calls back {a_cycle:.1f} times a mesh cycle into Python; called from Python that "
        f"takes {a_cycle * each:.1f} us of its cost, which a C++ program would not pay"
    )


@functools.cache
def _sweeper(tolerance: float, sides: int, tangent: bool) -> Heyoka:
    return Heyoka(constants(paper(0.0)), tolerance, LANES, sides, tangent)


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
        solver = _sweeper(tolerance, 1, False)
        solver.start(starts[:, LEFT], p)
        halves = [solver.to(TRANSIENT + i) for i in range(OBSERVED)]
        return np.stack(halves, axis=1)[..., FROM_HALF]

    def run(values: Array) -> Array:
        return _in_batches(values, sections)

    return [
        SweepMethod("heyoka, events, batch of 8, half", f"tolerance {tolerance:g}", run, most=80)
    ]


def exponent_methods(cycles: int) -> list[SweepMethod]:
    """Row of work (c): the tangent vector runs along and is set to length 1 every cycle."""
    tolerance = 1e-6

    def exponents(starts: Array, p: Array) -> Array:
        plain, both = _sweeper(tolerance, 2, False), _sweeper(tolerance, 2, True)
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
