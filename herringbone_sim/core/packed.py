"""Data and work arrays of the kernel: the packed model and the arrays of a run.

All is dimensionless (Eq. 17). ``y (n_state,)`` holds displacements then velocities as in
``layout.Layout.state_names``. Left and right undergo the same operations in the same order, as
rounding would otherwise break their symmetry in a chaotic transient; arithmetic is therefore never
fused or reordered.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.core.cache import compiled_from, forget_stale
from herringbone_sim.core.numba_private import COMPILED, LINKED

Indices = NDArray[np.int64]

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
    """The model as the kernel reads it; n = n_mesh, c = n_classes, all dimensionless.

    Attributes:
        classes: c zeros: the length of a tuple is part of its type, so loops over c are unrolled.
        multiplicity: number of planets that one class represents.
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
        windows: (w, 3) recurring events: mesh cycles between them, mesh cycle of the first, width
            in mesh cycles.
        window_k: (w, n) relative loss of k at the middle of an event.
        window_d: (w, n) displacement at the middle of an event.
        b: (n,) half-backlash b' (Eq. 3).
        inv_M_s: (2,) of the sun halves [1/kg].
        inv_M_p: (2, c) of the planet halves [1/kg].
        inv_M_c: of the carrier [1/kg].
        load_q: (2,) constant acceleration of q_S by T_1 and T_2.
        load_r: constant acceleration of r by T_2.
        control_q: (2,) share of K cos(...) subtracted from the acceleration of q_S.
        control_r: (2,) share subtracted from the acceleration of r_S.
        control_order: control frequency over mesh frequency.
        control_phase: rad.
        load_orders: (l,) orders of the mesh frequency of the harmonics of further torques.
        load_cos: (l, m + s) cosine amplitudes of the accelerations that they give the coordinates.
        load_sin: (l, m + s) sine amplitudes.
        plain: whether all of the following is empty.
        extended: one zero if it is not, as in ``classes``, so that plain gears compile without it.
        powers: whether forces are nonlinear between switches: a non-constant power in ``law``, or
            rounded corners in ``seat``.
        law: (5, n) mesh force k f (|f| / law[0])^(law[1] - 1) + c v [1 - law[2] + law[2] (|f| /
            law[4])^law[3]]; exponents 1 and share 0 give k f + c v.
        own_shift: (s, n) displacement of the meshes by s further coordinates.
        seat: (s, 4) their springs: stiffness, damping, half of the clearance, rounding of its
            corners.
        push: (3, m + s + 1, n + s) accelerations of the coordinates by unit forces of the meshes
            and of those springs, the last row for the carrier, which acts on all coordinates of
            the layout; without friction, by friction (constant part), and by friction in
            proportion to the turn s from the pitch point.
        pairs: (t, 2) rows and columns of ``push`` with non-zero entries.
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
    windows: Array
    window_k: Array
    window_d: Array
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
    own_shift: Array
    seat: Array
    push: Array
    pairs: Indices
    rubs: Indices
    K: float
    Omega: float


def of_one_type(packed: Packed) -> Packed:
    """The model with the type of a plain one, for code that has no part for plain gears alone.

    Such code is compiled once for both kinds.
    """
    return packed._replace(extended=())


class Work(NamedTuple):
    """Work arrays of the right-hand side and of RK4; n = n_mesh, m = coordinates, s further
    ones.
    """

    k: Array  # (n,) stiffness at one phase
    error: Array  # (n,) e, taken off G q to get the deflection
    error_rate: Array  # (n,) de/dtau
    x: Array  # (n,) deflection
    v: Array  # (n,) its rate
    force: Array  # (n + s,) forces of meshes and seats
    push: Array  # (m + s,) accelerations
    slope: Array  # (4, n_state + 2 s) of the stages of RK4
    stage: Array  # (n_state + 2 s,)


def make_work(n_mesh: int, n_coordinate: int, n_own: int = 0) -> Work:
    """Work arrays for a gear.

    Args:
        n_own: number of further coordinates, as rows of ``Packed.seat``.
    """
    n_all = n_coordinate + n_own
    sizes = *(n_mesh,) * 5, n_mesh + n_own, n_all, (4, 2 * n_all), 2 * n_all
    return Work(*(np.zeros(size) for size in sizes))
