"""Constants of a gear for compiled code, work arrays of its right-hand side, Numba decorators.

All is dimensionless (Eq. 17). ``y (n_state,)`` holds displacements then velocities as in
``layout.Layout.state_names``. Left and right undergo the same operations in the same order, as
rounding would otherwise break their symmetry in a chaotic transient; the compiler must therefore
not fuse or reorder arithmetic.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.cache import compiled_from, forget_stale
from herringbone_sim.core.numba_private import COMPILED, LINKED

TWO_PI = 2.0 * np.pi
LIMIT = 1e6  # b_c: deflection beyond which the motion counts as diverged

PACKAGE = Path(__file__).parents[1]
forget_stale(PACKAGE, *compiled_from(PACKAGE))

# Compiled code that Python may call; ``exposed`` is also inlined into compiled callers.
compiled: Any = njit(cache=True, **COMPILED)
exposed: Any = njit(cache=True, forceinline=True, **COMPILED)
# Code that only compiled code calls: compiled with its callers, not cached, without wrappers for
# Python. A call from Python would crash the process; a test finds such calls.
called: Any = njit(**COMPILED, **LINKED)
inlined: Any = njit(forceinline=True, **COMPILED, **LINKED)
# Inlined into its callers before they are compiled; not compiled by itself.
embedded: Any = njit(inline="always", **COMPILED)


class Packed(NamedTuple):
    """Constants of a gear in the form of the kernel, all dimensionless.

    n = n_mesh, c = n_classes, m = n_coordinate; s coordinates are added by effects (a moving ring
    or pin), each on a spring, its seat.

    Attributes:
        classes: c zeros: the length of a tuple is part of its type, so loops over c are unrolled.
        multiplicity: number of planets that each class represents.
        stiffness: (n,) mean mesh stiffness times the projection over omega_n^2 [kg].
        damping: (n,) mesh damping times the projection over omega_n [kg].
        orders: (h,) orders of the mesh frequency, not necessarily integer, of the harmonics of k
            and e.
        k_cos: (h, n) cosine amplitudes of the harmonics of k (Eq. 7), in the unit of stiffness.
        k_sin: (h, n) sine amplitudes.
        e_mean: (n,) mean error (Eq. 9) minus the displacement d_mean of effects.
        e_cos: (h, n) cosine amplitudes of the harmonics of e, minus d_cos.
        e_sin: (h, n) sine amplitudes, minus d_sin.
        d_mean: (n,) displacement that effects add to the deflection; not contained in samples.
        d_cos: (h, n) cosine amplitudes of its harmonics; no rows if it has none.
        d_sin: (h, n) sine amplitudes.
        events: (w, 3) recurring events: mesh cycles between them, mesh cycle of the first, width
            in mesh cycles.
        event_k: (w, n) relative loss of k at the middle of an event.
        event_d: (w, n) displacement at the middle of an event.
        b: (n,) half-backlash b' (Eq. 3).
        inv_M_s: (2,) inverse masses of the sun halves [1/kg].
        inv_M_p: (2, c) inverse masses of the planet halves [1/kg].
        inv_M_c: inverse mass of the carrier [1/kg].
        load_q: (2,) constant acceleration of q_S by T_1 and T_2.
        load_r: constant acceleration of r by T_2.
        control_q: (2,) factor on K cos(...), subtracted from the acceleration of q_S.
        control_r: (2,) the same for r_S.
        control_order: control frequency over mesh frequency.
        control_phase: rad.
        load_orders: (l,) orders of the mesh frequency of the harmonics of torques by effects.
        load_cos: (l, m + s) cosine amplitudes of the accelerations of coordinates by them.
        load_sin: (l, m + s) sine amplitudes.
        plain: whether there are no added coordinates, no friction and only forces k f + c v.
        extended: one zero unless ``plain``, as in ``classes``: plain gears compile without these.
        powers: whether forces are nonlinear between switches: a non-constant power in ``law``, or
            rounded corners in ``seat``.
        law: (5, n) mesh force k f (|f| / law[0])^(law[1] - 1) + c v [1 - law[2] + law[2] (|f| /
            law[4])^law[3]]; law[1] = 1 and law[2] = 0 give k f + c v.
        added_shift: (s, n) displacement of each mesh per unit of each added coordinate.
        seat: (s, 4) of the seats: stiffness, damping, half of the clearance, rounding of its
            corners.
        push: (3, m + s + 1, n + s) accelerations of the coordinates by unit forces of meshes and
            seats: [0] without friction; by friction [1] constant, [2] per mesh cycle from the
            pitch point. The last row is the carrier's, which acts on all m coordinates.
        pairs: (t, 2) rows and columns of ``push`` with non-zero entries, sorted by row.
        rubs: (r,) meshes with friction.
        K: control amplitude.
        Omega: mesh frequency over omega_n.
    """

    classes: tuple[int, ...]
    multiplicity: float
    stiffness: Array
    damping: Array
    orders: Array
    k_cos: Array
    k_sin: Array
    e_mean: Array
    e_cos: Array
    e_sin: Array
    d_mean: Array
    d_cos: Array
    d_sin: Array
    events: Array
    event_k: Array
    event_d: Array
    b: Array
    inv_M_s: Array
    inv_M_p: Array
    inv_M_c: float
    load_q: Array
    load_r: float
    control_q: Array
    control_r: Array
    control_order: float
    control_phase: float
    load_orders: Array
    load_cos: Array
    load_sin: Array
    plain: bool
    extended: tuple[int, ...]
    powers: bool
    law: Array
    added_shift: Array
    seat: Array
    push: Array
    pairs: Indices
    rubs: Indices
    K: float
    Omega: float


def of_one_type(packed: Packed) -> Packed:
    """Return the constants with the type of a plain gear's, whether the gear is plain or not.

    Code that does not read ``extended`` is then compiled once for both.
    """
    return packed._replace(extended=())


class Work(NamedTuple):
    """Work arrays of the right-hand side and of RK4; n, m and s as in ``Packed``."""

    k: Array  # (n,) stiffness at one phase
    error: Array  # (n,) e, subtracted from G q (Eqs. 15, 16) to get the deflection
    error_rate: Array  # (n,) de/dtau
    x: Array  # (n,) deflection
    v: Array  # (n,) its rate
    force: Array  # (n + s,) forces of meshes and seats
    push: Array  # (m + s,) accelerations
    slope: Array  # (4, n_state + 2 s) of the stages of RK4
    stage: Array  # (n_state + 2 s,)


def make_work(n_mesh: int, n_coordinate: int, n_added_coordinates: int = 0) -> Work:
    """Return work arrays for a gear; each added coordinate has a row of ``Packed.seat``."""
    n_all = n_coordinate + n_added_coordinates
    sizes = *(n_mesh,) * 5, n_mesh + n_added_coordinates, n_all, (4, 2 * n_all), 2 * n_all
    return Work(*(np.zeros(size) for size in sizes))
