"""What the kernel reads and scribbles on: the packed model and the scratch of a run.

All is dimensionless (Eq. 17). ``y (n_state,)`` holds displacements then velocities as
``layout.Layout.state_names`` says. Left and right see the same operations in the same order, or
rounding breaks their symmetry in a chaotic transient; no fused or reordered arithmetic therefore.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from herringbone_sim.core.cache import compiled_from, forget_stale

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

TWO_PI = 2.0 * np.pi

PACKAGE = Path(__file__).parents[1]
forget_stale(PACKAGE, *compiled_from(PACKAGE))

# Without Numba's reference counting nothing can be allocated within, and nothing is counted: the
# counting of a dozen arrays a call cost a third of the time.
compiled: Any = njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
inlined: Any = njit(cache=True, nogil=True, error_model="numpy", forceinline=True, _nrt=False)
# Becomes a part of its callers before they are compiled, and is not compiled by itself.
embedded: Any = njit(nogil=True, error_model="numpy", inline="always", _nrt=False)


class Packed(NamedTuple):
    """The model as the kernel reads it; n = n_mesh, c = n_classes, all dimensionless.

    Attributes:
        classes: c zeros: a tuple's length is part of its type, so loops over c are unrolled.
        multiplicity: planets that one class stands for.
        stiffness: (n,) mean mesh stiffness times the projection over omega_n^2 [kg].
        damping: (n,) mesh damping times the projection over omega_n [kg].
        orders: (h,) of the mesh frequency, whole or not, of the harmonics of k and e.
        k_cos: (h, n) cosine amplitudes of the harmonics of k (Eq. 7), as stiffness.
        k_sin: (h, n) sine amplitudes.
        e_mean: (n,) mean error (Eq. 9), less the displacement d_mean of effects.
        e_cos: (h, n) cosine amplitudes of the harmonics of e, less d_cos.
        e_sin: (h, n) sine amplitudes, less d_sin.
        d_mean: (n,) displacement that effects add to the deflection, and samples do not show.
        d_cos: (h, n) cosine amplitudes of its harmonics; no row where it has none.
        d_sin: (h, n) sine amplitudes.
        windows: (w, 3) events that come once in a while: mesh cycles between them, mesh cycle of
            the first, width in mesh cycles.
        window_k: (w, n) share of k that an event takes, at its middle.
        window_d: (w, n) displacement that it adds, at its middle.
        b: (n,) half-backlash b' in force (Eq. 3).
        inv_M_s: (2,) of the sun halves [1/kg].
        inv_M_p: (2, c) of the planet halves [1/kg].
        inv_M_c: of the carrier [1/kg].
        load_q: (2,) constant acceleration of q_S by T_1 and T_2.
        load_r: constant acceleration of r by T_2.
        control_q: (2,) share of K cos(...) taken off the acceleration of q_S.
        control_r: (2,) share taken off the acceleration of r_S.
        control_order: control frequency over mesh frequency.
        control_phase: rad.
        K: control amplitude.
        load_orders: (l,) of the mesh frequency, of the harmonics of further torques.
        load_cos: (l, m + s) cosine amplitudes of the accelerations that they give the coordinates.
        load_sin: (l, m + s) sine amplitudes.
        plain: whether all that follows is empty.
        extended: one zero where it is not, as in ``classes``: plain gears compile without it.
        powers: whether forces are not linear between switches: a power in ``law`` that is no
            constant, or rounded corners in ``seat``.
        law: (5, n) force of a mesh, k f (|f| / law[0])^(law[1] - 1) + c v [1 - law[2] + law[2]
            (|f| / law[4])^law[3]]; exponents 1 and share 0 give k f + c v.
        own_shift: (s, n) displacement of the meshes by s further coordinates.
        seat: (s, 4) their springs: stiffness, damping, half of the free play, rounding of its
            corners.
        push: (3, m + s + 1, n + s) what forces 1 of the meshes and of those springs add to the
            accelerations of the coordinates, the last row being that of the carrier, which all
            coordinates of the layout share: without friction; by friction, its first part and
            that in proportion to the turn s from the pitch point.
        pairs: (t, 2) rows and columns of ``push`` that hold anything.
        rubs: (r,) meshes with friction.
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


class AnyWork(NamedTuple):
    """Scratch of a gear with powers; p, n and s as in ``Work`` and ``Packed``."""

    rate: Array  # (p + 1, n + s) series of the rate of deflection, seats included
    depth: Array  # (p + 1, n) series of |f|
    spring: Array  # (p + 1, n) series of the spring's part of the force over k, by its law
    damper: Array  # (p + 1, n) series of the factor on c v, by its law
    soft: Array  # (p + 1, n) series of the derivative of the force by the deflection
    damp: Array  # (p + 1, n) series of the derivative by the rate
    power: Array  # (p + 1, n) series of a power of |f|
    give: Array  # (p + 1, s) series of the derivative of seats' forces by the displacement
    corner: Array  # (6, p + 1, s) series of both corners of a free play
    deep: Array  # (n,) 1 where the law bends, 0 where |f| is so small that it is taken linear
    at: Array  # (n,) where in the step a law begins or ceases to bend


class Work(NamedTuple):
    """Scratch of one integration, made once outside the loop; p = order, n, m = coordinates."""

    k: Array  # (p + 1, n) series of the stiffness
    error: Array  # (p + 1, n) series of e, taken off G q to get the deflection
    error_rate: Array  # (n,) de/dtau at one phase
    cos: Array  # (p + 1,) series of one harmonic
    sin: Array  # (p + 1,)
    product: Array  # (p + 1,) series of one stiffness times that of a window
    inverse: Array  # (p + 2,) 1 / i
    load: Array  # (p + 1, m + s) series of the outer acceleration
    none_n: Array  # (p + 1, n) zeros
    none_m: Array  # (p + 1, m + s) zeros
    q: Array  # (p + 1, m + s) series of the displacements
    v: Array  # (p + 1, m + s) series of the velocities
    x: Array  # (p + 1, n + s) series of the deflections, of seats behind those of meshes
    f: Array  # (p + 1, n + s) the same where in contact, else 0
    contact: Array  # (n + s,) -1 back, 0 separated, 1 drive
    now: Array  # (n + s,) contact during the step, when ``contact`` has switched already
    next: Array  # (n + s,) contact after the switch
    at: Array  # (n + s,) where in the step a mesh switches, 2 when it does not
    end: Array  # (n + s,) deflection at the end of the step
    end_slope: Array  # (n + s,) its rate
    closed: Array  # (n + s,) 1 in contact, 0 separated
    force: Array  # (n + s,) one order of the forces of meshes and seats
    forces: Array  # (p + 1, n + s) series of them, of gears that are not plain
    damping: Array  # (n + s,) in the present contact, as the next three of gears not plain
    border: Array  # (n + s,) half of the play
    sign: Array  # (n,) of the mesh force; 0 where not known yet
    sign_at: Array  # (n,) where in the step it changes
    jump: Array  # (n,) of the mesh force at a switch, over the rate of deflection
    pitch: Array  # (3,) turn from the pitch point, its side, turn of the step
    mix: Array  # (2, t) accelerations of ``Packed.pairs`` by a force and by its order before
    rate: Array  # (4, n_state + 2 s) stages of RK4
    stage: Array  # (n_state + 2 s,)
    push: Array  # (m + s,) accelerations at one phase
    any: AnyWork  # of gears with powers


def make_work(n_mesh: int, n_coordinate: int, order: int, n_own: int = 0) -> Work:
    """Scratch for a run (order is that of the Taylor series; RK4 takes any).

    Args:
        n_own: further coordinates, as rows of ``Packed.seat``.
    """
    p = order + 1
    n_all, n_row = n_coordinate + n_own, n_mesh + n_own

    def zeros(*shape: int) -> Array:
        return np.zeros(shape)

    return Work(
        k=zeros(p, n_mesh),
        error=zeros(p, n_mesh),
        error_rate=zeros(n_mesh),
        cos=zeros(p),
        sin=zeros(p),
        product=zeros(p),
        inverse=1.0 / np.maximum(np.arange(p + 1.0), 1.0),
        load=zeros(p, n_all),
        none_n=zeros(p, n_mesh),
        none_m=zeros(p, n_all),
        q=zeros(p, n_all),
        v=zeros(p, n_all),
        x=zeros(p, n_row),
        f=zeros(p, n_row),
        contact=zeros(n_row),
        now=zeros(n_row),
        next=zeros(n_row),
        at=zeros(n_row),
        end=zeros(n_row),
        end_slope=zeros(n_row),
        closed=zeros(n_row),
        force=zeros(n_row),
        forces=zeros(p, n_row),
        damping=zeros(n_row),
        border=zeros(n_row),
        sign=zeros(n_mesh),
        sign_at=zeros(n_mesh),
        jump=zeros(n_mesh),
        pitch=zeros(3),
        mix=zeros(2, (n_all + 1) * n_row),
        rate=zeros(4, 2 * n_all),
        stage=zeros(2 * n_all),
        push=zeros(n_all),
        any=AnyWork(
            rate=zeros(p, n_row),
            depth=zeros(p, n_mesh),
            spring=zeros(p, n_mesh),
            damper=zeros(p, n_mesh),
            soft=zeros(p, n_mesh),
            damp=zeros(p, n_mesh),
            power=zeros(p, n_mesh),
            give=zeros(p, n_own),
            corner=zeros(6, p, n_own),
            deep=zeros(n_mesh),
            at=zeros(n_mesh),
        ),
    )
