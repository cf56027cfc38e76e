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

TWO_PI = 2.0 * np.pi

PACKAGE = Path(__file__).parents[1]
forget_stale(PACKAGE, *compiled_from(PACKAGE))

# Without Numba's reference counting nothing can be allocated within, and nothing is counted: the
# counting of a dozen arrays a call cost a third of the time.
compiled: Any = njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
inlined: Any = njit(cache=True, nogil=True, error_model="numpy", forceinline=True, _nrt=False)


class Packed(NamedTuple):
    """The model as the kernel reads it; n = n_mesh, c = n_classes, all dimensionless.

    Attributes:
        classes: c zeros: a tuple's length is part of its type, so loops over c are unrolled.
        multiplicity: planets that one class stands for.
        stiffness: (n,) mean mesh stiffness times the projection over omega_n^2 [kg].
        damping: (n,) mesh damping times the projection over omega_n [kg].
        k_cos: (h, n) cosine amplitudes of the harmonics of k (Eq. 7), as stiffness.
        k_sin: (h, n) sine amplitudes.
        e_mean: (n,) mean error (Eq. 9).
        e_cos: (g, n) cosine amplitudes of the harmonics of e.
        e_sin: (g, n) sine amplitudes.
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
        Omega: mesh frequency over omega_n.
    """

    classes: tuple[int, ...]
    multiplicity: float
    stiffness: Array
    damping: Array
    k_cos: Array
    k_sin: Array
    e_mean: Array
    e_cos: Array
    e_sin: Array
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
    K: float
    Omega: float


class Work(NamedTuple):
    """Scratch of one integration, made once outside the loop; p = order, n, m = coordinates."""

    k: Array  # (p + 1, n) series of the stiffness
    error: Array  # (p + 1, n) series of e, taken off G q to get the deflection
    error_rate: Array  # (n,) de/dtau at one phase
    cos: Array  # (p + 1,) series of one harmonic
    sin: Array  # (p + 1,)
    inverse: Array  # (p + 2,) 1 / i
    load: Array  # (p + 1, m) series of the outer acceleration
    none_n: Array  # (p + 1, n) zeros
    none_m: Array  # (p + 1, m) zeros
    q: Array  # (p + 1, m) series of the displacements
    v: Array  # (p + 1, m) series of the velocities
    x: Array  # (p + 1, n) series of the deflections
    f: Array  # (p + 1, n) the same where in contact, else 0
    contact: Array  # (n,) -1 back, 0 separated, 1 drive
    now: Array  # (n,) contact during the step, when ``contact`` has switched already
    next: Array  # (n,) contact after the switch
    at: Array  # (n,) where in the step a mesh switches, 2 when it does not
    end: Array  # (n,) deflection at the end of the step
    end_slope: Array  # (n,) its rate
    closed: Array  # (n,) 1 in contact, 0 separated
    force: Array  # (n,) one order of the mesh forces
    rate: Array  # (4, n_state) stages of RK4
    stage: Array  # (n_state,)


def make_work(n_mesh: int, n_coordinate: int, order: int) -> Work:
    """Scratch for a run (order is that of the Taylor series; RK4 takes any)."""
    p = order + 1

    def zeros(*shape: int) -> Array:
        return np.zeros(shape)

    return Work(
        k=zeros(p, n_mesh),
        error=zeros(p, n_mesh),
        error_rate=zeros(n_mesh),
        cos=zeros(p),
        sin=zeros(p),
        inverse=1.0 / np.maximum(np.arange(p + 1.0), 1.0),
        load=zeros(p, n_coordinate),
        none_n=zeros(p, n_mesh),
        none_m=zeros(p, n_coordinate),
        q=zeros(p, n_coordinate),
        v=zeros(p, n_coordinate),
        x=zeros(p, n_mesh),
        f=zeros(p, n_mesh),
        contact=zeros(n_mesh),
        now=zeros(n_mesh),
        next=zeros(n_mesh),
        at=zeros(n_mesh),
        end=zeros(n_mesh),
        end_slope=zeros(n_mesh),
        closed=zeros(n_mesh),
        force=zeros(n_mesh),
        rate=zeros(4, 2 * n_coordinate),
        stage=zeros(2 * n_coordinate),
    )
