"""Integrate all bodies over short windows, with tangents: Runge-Kutta 4, compiled.

Nine body rotations u and their rates: d2u/dt2 = M^-1 (tau - G' F), x = G u - e + d,
F = k f(x) + c v + extra_force, Eqs. (12) to (16) with the rigid rotation included. Contact is not
located; the error counts as noise, see ``windows.INTEGRATION_ERROR``.

Windows are integrated side by side, in lanes (``core.lanes.vector``). Where there are two lanes or
more for each, they divide the columns of its tangent among them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.core.lanes.vector import LANES, choose, fma, give, load, store, take

STATES = 18  # nine rotations [m] and their rates [m/s]
BODIES = STATES // 2
BODIES_PER_MESH = 3  # bodies that a mesh depends on: two gears and the carrier
STAGES = 4  # of Runge-Kutta


class Forcing(NamedTuple):
    """Coefficients of the equation of motion at every half step: (n, n_mesh) unless stated.

    Attributes:
        G: (n_mesh, 9) displacements of the meshes by rotations of the bodies.
        inverse_masses: (9,) 1/M [1/kg].
        tau: (n, 9) forces on the bodies at their base radii [N].
        k, c: stiffness [N/m], damping [N s/m].
        offset, rate: -e + d [m] and its rate [m/s].
        plus, minus: half-backlash on drive and back flank [m].
        extra_force: force independent of the motion [N].
    """

    G: Array
    inverse_masses: Array
    tau: Array
    k: Array
    c: Array
    offset: Array
    rate: Array
    plus: Array
    minus: Array
    extra_force: Array


class WindowIntegrator:
    """Integrates W windows from any start states.

    Args:
        first: (W,) index of the half step at which each window starts.
        steps: steps per window.
        h: step [s].
        forcing: at every half step.
    """

    def __init__(self, first: NDArray[np.int64], steps: int, h: float, forcing: Forcing) -> None:
        self.forcing = Forcing(*(np.ascontiguousarray(array) for array in forcing))
        self._first, self._steps, self._h = first, steps, h
        self._moved = np.argsort(forcing.G == 0.0, axis=1, kind="stable")[:, :BODIES_PER_MESH]

    def states(self, starts: Array) -> Array:
        """States (W, steps + 1, 18) from start states (W, 18), rotations [m] and rates [m/s]."""
        states = np.empty((len(starts), self._steps + 1, STATES))
        for at in self._batches():
            nothing = np.empty((len(starts[at]), 0, STATES, STATES))
            self._integrate(at, starts, states[at], nothing, self._steps, False)
        return states

    def tangents(self, starts: Array, every: int, restart: bool = False) -> Array:
        """Derivatives (W, steps / every, 18, 18) of the states after every ``every`` steps.

        Exact derivatives of the Runge-Kutta steps, by the start state of the window or, with
        ``restart``, by the state ``every`` steps before.

        Args:
            starts: (W, 18) start states [m], [m/s].
            every: a divisor of the number of steps.
            restart: see above.
        """
        tangents = np.empty((len(starts), self._steps // every, STATES, STATES))
        for at in self._batches():
            states = np.empty((len(starts[at]), self._steps + 1, STATES))
            self._integrate(at, starts, states, tangents[at], every, restart)
        return tangents

    def _batches(self) -> list[slice]:
        """Windows that are integrated side by side."""
        return [slice(i, i + LANES) for i in range(0, len(self._first), LANES)]

    def _integrate(
        self, at: slice, starts: Array, states: Array, tangents: Array, every: int, restart: bool
    ) -> None:
        """Write states and tangents of some windows; see ``_rollout``."""
        states[:, 0] = starts[at]
        first = np.resize(self._first[at], LANES)
        _rollout(self.forcing, self._moved, first, self._h, every, restart, states, tangents)


@njit(cache=True, nogil=True)
def _read(forcing, at, rows):  # type: ignore[no-untyped-def]
    """Write the forcing at half steps ``at`` (lanes,) to rows (7 n_mesh + 9, lanes).

    They are k, c, offset, rate, plus, minus and extra_force of all meshes, then tau.
    """
    _, _, tau, k, c, offset, rate, plus, minus, extra_force = forcing
    M = k.shape[1]
    _read_part(k, at, 0, rows)
    _read_part(c, at, M, rows)
    _read_part(offset, at, 2 * M, rows)
    _read_part(rate, at, 3 * M, rows)
    _read_part(plus, at, 4 * M, rows)
    _read_part(minus, at, 5 * M, rows)
    _read_part(extra_force, at, 6 * M, rows)
    _read_part(tau, at, 7 * M, rows)


@njit(cache=True, nogil=True)
def _read_part(values, at, first, rows):  # type: ignore[no-untyped-def]
    """Write rows ``at`` (lanes,) of ``values`` to ``rows``, from row ``first`` on."""
    for m in range(values.shape[1]):
        for lane in range(LANES):
            rows[first + m, lane] = values[at[lane], m]


@njit(cache=True, nogil=True, error_model="numpy")
def _rollout(forcing, moved, first, h, every, restart, states, tangents):  # type: ignore[no-untyped-def]
    """Integrate n windows from ``states[:, 0]``, and their tangents.

    Args:
        forcing: see ``Forcing``.
        moved: (n_mesh, 3) indices of the bodies that the meshes depend on.
        first: (lanes,) half step at which each window starts; lane i has window i modulo n.
        h: step.
        every, restart: see ``WindowIntegrator.tangents``.
        states: (n, steps + 1, 18); all but the first are written.
        tangents: (n, intervals, 18, 18); where there are no intervals, none are computed.
    """
    M, mobility = len(moved), forcing.inverse_masses
    n, steps, intervals = states.shape[0], states.shape[1] - 1, tangents.shape[1]
    copies = LANES // n
    passes = -(-STATES // copies) if intervals else 0
    columns = np.empty((passes, STATES, LANES))
    _unit(columns, n)
    half, sixth, third = 0.5 * h, h / 6.0, h / 3.0
    G, pull = np.empty((2, M, BODIES_PER_MESH))
    for m in range(M):
        for p in range(BODIES_PER_MESH):
            G[m, p] = forcing.G[m, moved[m, p]]
            pull[m, p] = -mobility[moved[m, p]] * G[m, p]
    y, z = np.empty((2, STATES, LANES))
    slopes = np.empty((STAGES, STATES, LANES))
    stiffness, damping = np.empty((2, STAGES, M, LANES))
    work = np.empty((3, STATES, LANES))
    for i in range(STATES):
        for lane in range(LANES):
            y[i, lane] = states[lane % n, 0, i]
    rows = np.empty((3, 7 * M + BODIES, LANES))
    _read(forcing, first, rows[2])
    for q in range(steps):
        rows[0] = rows[2]
        _read(forcing, first + (2 * q + 1), rows[1])
        _read(forcing, first + (2 * q + 2), rows[2])
        for s in range(STAGES):
            j = 0 if s == 0 else (2 if s == 3 else 1)
            for i in range(STATES):
                if s == 0:
                    give(z, i, take(y, i))
                else:
                    give(z, i, fma(h if s == 3 else half, load(slopes, s - 1, i), take(y, i)))
            for i in range(BODIES):
                store(slopes, s, i, take(z, BODIES + i))
                store(slopes, s, BODIES + i, mobility[i] * load(rows, j, 7 * M + i))
            for m in range(M):
                x, v = load(rows, j, 2 * M + m), load(rows, j, 3 * M + m)
                for p in range(BODIES_PER_MESH):
                    x = fma(G[m, p], take(z, moved[m, p]), x)
                    v = fma(G[m, p], take(z, BODIES + moved[m, p]), v)
                over, under = x - load(rows, j, 4 * M + m), x + load(rows, j, 5 * M + m)
                drive, back = over > 0.0, under < 0.0
                k = choose(drive | back, load(rows, j, m), 0.0)
                c = load(rows, j, M + m)
                force = fma(c, v, load(rows, j, 6 * M + m))
                force = fma(k, choose(drive, over, under), force)
                store(stiffness, s, m, k)
                store(damping, s, m, c)
                for p in range(BODIES_PER_MESH):
                    i = BODIES + moved[m, p]
                    store(slopes, s, i, fma(pull[m, p], force, load(slopes, s, i)))
        for i in range(STATES):
            inner = load(slopes, 1, i) + load(slopes, 2, i)
            outer = load(slopes, 0, i) + load(slopes, 3, i)
            end = fma(sixth, outer, fma(third, inner, take(y, i)))
            give(y, i, end)
            for w in range(n):
                states[w, q + 1, i] = y[i, w]
        for p in range(passes):
            _advance(columns[p], stiffness, damping, G, moved, pull, h, work)
        if passes and (q + 1) % every == 0:
            for column in range(STATES):
                p, copy = column // copies, column % copies
                for i in range(STATES):
                    for w in range(n):
                        tangents[w, q // every, i, column] = columns[p, i, copy * n + w]
            if restart:
                _unit(columns, n)


@njit(cache=True, nogil=True)
def _unit(columns, n):  # type: ignore[no-untyped-def]
    """Write columns of the unit matrix, (passes, 18, lanes), for n windows."""
    for p in range(columns.shape[0]):
        for lane in range(LANES):
            for i in range(STATES):
                columns[p, i, lane] = 1.0 if i == p * (LANES // n) + lane // n else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _advance(column, stiffness, damping, G, moved, pull, h, work):  # type: ignore[no-untyped-def]
    """Advance a column (18, lanes) of the tangent by a step: derivative of Runge-Kutta's.

    Args:
        stiffness, damping: (stages, n_mesh, lanes) of the meshes at the stages of the step.
        G, moved, pull: see ``_rollout``.
        work: (3, 18, lanes) overwritten.
    """
    half, sixth, third = 0.5 * h, h / 6.0, h / 3.0
    z, slope, end = work[0], work[1], work[2]
    for i in range(STATES):
        give(end, i, take(column, i))
    for s in range(STAGES):
        for i in range(STATES):
            if s == 0:
                give(z, i, take(column, i))
            else:
                give(z, i, fma(h if s == 3 else half, take(slope, i), take(column, i)))
        for i in range(BODIES):
            give(slope, i, take(z, BODIES + i))
            give(slope, BODIES + i, 0.0)
        for m in range(len(G)):
            a, b, d = moved[m, 0], moved[m, 1], moved[m, 2]
            x = fma(G[m, 0], take(z, a), fma(G[m, 1], take(z, b), G[m, 2] * take(z, d)))
            a, b, d = BODIES + a, BODIES + b, BODIES + d
            v = fma(G[m, 0], take(z, a), fma(G[m, 1], take(z, b), G[m, 2] * take(z, d)))
            force = fma(load(stiffness, s, m), x, load(damping, s, m) * v)
            give(slope, a, fma(pull[m, 0], force, take(slope, a)))
            give(slope, b, fma(pull[m, 1], force, take(slope, b)))
            give(slope, d, fma(pull[m, 2], force, take(slope, d)))
        for i in range(STATES):
            weight = sixth if s == 0 or s == 3 else third
            give(end, i, fma(weight, take(slope, i), take(end, i)))
    for i in range(STATES):
        give(column, i, take(end, i))
