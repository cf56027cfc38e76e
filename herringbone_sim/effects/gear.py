"""Data of a gear and its active effects in the form that compiled laws read, SI units."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple

import numpy as np
from numba import float64, types, void

from herringbone_sim.arrays import Array, Flags, Indices
from herringbone_sim.core.model import Model
from herringbone_sim.core.numba_private import NumbaExperimentalFeatureWarning, wrapper_address
from herringbone_sim.effects.effect import Active, Effect
from herringbone_sim.effects.instant import FREE
from herringbone_sim.effects.law import no_excite, no_react

_ROW, _ROWS = float64[::1], float64[:, ::1]
_HEAD = (_ROW, _ROWS, _ROWS, _ROW, _ROW)
EXCITE = void(*_HEAD, _ROWS)
REACT = void(*_HEAD, _ROW, _ROW, _ROWS, _ROW, _ROW)
DRIVE = void(*_HEAD, _ROW, _ROW)
_LANE_ROW, _LANE_ROWS = _ROWS, float64[:, :, ::1]
_LANE_HEAD = (_LANE_ROW, _LANE_ROWS, _LANE_ROWS, _LANE_ROW, _LANE_ROW)
LANE_EXCITE = void(*_LANE_HEAD, _LANE_ROWS)
LANE_REACT = void(*_LANE_HEAD, _LANE_ROW, _LANE_ROW, _LANE_ROWS, _LANE_ROW, _LANE_ROW)
LANE_DRIVE = void(*_LANE_HEAD, _LANE_ROW, _LANE_ROW)
SLOTS = 4
_NOTHING = Active(Effect("nothing", "fills a slot", "mesh", ()), ())


class _Pointer:
    """Function pointer to a compiled law, so that one compiled kernel runs with any laws.

    The Numba type is computed once, because Numba asks for it at every call.
    """

    def __init__(self, function: Any, signature: Any) -> None:
        function.compile(signature)
        self._address = wrapper_address(function, signature)
        self._numba_type_ = types.FunctionType(signature)

    def __wrapper_address__(self) -> int:
        return int(self._address)


class Kernel(NamedTuple):
    """Function pointers of the laws of n active effects, for compiled code; n with padding.

    Effects that do nothing pad n to a multiple of four: the length of a tuple is part of its Numba
    type, so compiled code would be compiled again for every number of effects.

    Attributes:
        excite, react, drive: function pointer of each effect.
        first: (n + 1,) index of the first state of each effect, then the number of all states.
        n_active: number of effects without padding.
        acts: (n, 2) whether each effect has ``excite`` and ``react``; laws that do nothing are not
            called.
    """

    excite: tuple[Any, ...]
    react: tuple[Any, ...]
    drive: tuple[Any, ...]
    first: Indices
    n_active: int
    acts: Flags


class Laws(NamedTuple):
    """Function pointers and constants of active effects, in the order of compiled functions.

    Attributes:
        kernel: the laws.
        site: (rows, n_mesh) mesh constants of each effect, from ``Effect.place``.
        theta: (p,) parameters of each effect.
    """

    kernel: Kernel
    site: tuple[Array, ...]
    theta: tuple[Array, ...]

    @property
    def n_added_states(self) -> int:
        """Number of states that the effects add."""
        return int(self.kernel.first[-1])


def acting(actives: Sequence[Active]) -> list[Active]:
    """Return the effects that change the motion, all but sensor effects, ``last`` ones last."""
    chosen = [active for active in actives if active.effect.level != "sensor"]
    return sorted(chosen, key=lambda active: active.effect.last)


def laws(model: Model, actives: Sequence[Active]) -> Laws:
    """Return laws and constants of the effects that change the motion, in the order of ``acting``.

    Raises:
        ParameterError: a locus that the gear lacks, or a mesh without the effect's member.
    """
    mine = acting(actives)
    chosen = _padded(mine)
    sizes = [active.effect.states(model) for active in chosen]
    acts = [(a.effect.excite is not no_excite, a.effect.react is not no_react) for a in chosen]
    return Laws(
        kernel=Kernel(
            *pointers(mine, (EXCITE, REACT, DRIVE)),
            first=np.cumsum([0, *sizes]),
            n_active=len(mine),
            acts=np.array(acts),
        ),
        site=tuple(_site(model, active) for active in chosen),
        theta=tuple(np.array(active.theta, dtype=float) for active in chosen),
    )


def _padded(actives: Sequence[Active]) -> list[Active]:
    """Append effects that do nothing up to a multiple of ``SLOTS``, at least ``SLOTS``."""
    return [*actives, *[_NOTHING] * (-len(actives) % SLOTS or (0 if actives else SLOTS))]


def pointers(
    actives: Sequence[Active], signatures: tuple[Any, Any, Any], lanes: bool = False
) -> tuple[tuple[Any, ...], tuple[Any, ...], tuple[Any, ...]]:
    """Return function pointers to excite, react and drive of effects, padded as in ``Kernel``.

    ``signatures`` are those of Numba for the three. With ``lanes``, effects whose laws are not
    written for lanes get laws that do nothing.
    """
    chosen = [
        active.effect if active.effect.lanes or not lanes else _NOTHING.effect
        for active in actives
    ]
    padded = [*chosen, *(active.effect for active in _padded(actives)[len(actives) :])]
    kinds = ([getattr(effect, name) for effect in padded] for name in ("excite", "react", "drive"))
    excite, react, drive = (
        tuple(_pointer(function, signature) for function in functions)
        for functions, signature in zip(kinds, signatures, strict=True)
    )
    return excite, react, drive


def _site(model: Model, active_effect: Active) -> Array:
    """Return the mesh constants ``site`` (rows, n_mesh) of an active effect."""
    mask = active_effect.locus.mask(model.layout)
    rows: Array = np.ascontiguousarray(
        active_effect.effect.place(model, mask, active_effect.chosen), dtype=float
    )
    return rows


_pointers: dict[tuple[Any, Any], Any] = {}


def _pointer(function: Any, signature: Any) -> Any:
    """Return the cached function pointer of a law; the law itself where Numba is disabled."""
    if not hasattr(function, "compile"):
        return function
    key = (function, signature)
    if key not in _pointers:
        _pointers[key] = _Pointer(function, signature)
    return _pointers[key]


def gear_table(model: Model) -> Array:
    """Return the mesh constants (4 + 4 orders, n_mesh) of a gear without effects, SI units.

    Rows: mean k, c, b', mean e; then for each order cosine and sine amplitude of k, and of e.
    """
    p, s = model.bare, model.scales
    stiff = s.omega_n**2 / s.projection
    orders = max(len(p.k_cos), len(p.e_cos))
    table = np.zeros((4 + 4 * orders, model.layout.n_mesh))
    table[0] = p.stiffness * stiff
    table[1] = model.damping_n_s_per_m
    table[2] = model.half_backlash_m
    table[3] = p.e_mean * s.b_c
    for j in range(len(p.k_cos)):
        table[4 + 4 * j], table[5 + 4 * j] = p.k_cos[j] * stiff, p.k_sin[j] * stiff
    for j in range(len(p.e_cos)):
        table[6 + 4 * j], table[7 + 4 * j] = p.e_cos[j] * s.b_c, p.e_sin[j] * s.b_c
    return table


class Scratch(NamedTuple):
    """Work arrays of the laws, SI units; n = n_mesh, s = states of effects, b = bodies."""

    contact_state: Indices  # (n,) contact state imposed on each mesh (-1, 0, 1), or FREE
    law: Array  # (5, n) as in ``effects.law``
    x: Array  # (n,) deflection with the effects' displacements
    v: Array  # (n,) its rate
    force: Array  # (n,) mesh forces
    torque: Array  # (b,) torques of effects over base radius
    driving: Array  # (n,) mesh forces between samples
    stage: Array  # (s,) states of effects at an RK4 stage
    slope: Array  # (4, s) rates of the states at the RK4 stages
    clamp_shift: Array  # (n,) added to the deflection of a mesh that is FREE


def scratch(model: Model, n_added_states: int) -> Scratch:
    """Return zeroed work arrays for a model with ``n_added_states``; all meshes FREE."""
    n = model.layout.n_mesh
    sizes = ((5, n), n, n, n, len(model.layout.bodies), n, n_added_states, (4, n_added_states), n)
    free = np.full(n, FREE, dtype=np.int64)
    return Scratch(free, *(np.zeros(size) for size in sizes))


_lock = threading.Lock()
_inside = 0  # number of ``pointers_allowed`` that are entered
_filters = ExitStack()  # restores the warning filters, which are global to the process


@contextmanager
def pointers_allowed() -> Iterator[None]:
    """Suppress Numba's warning that calls through function pointers are experimental.

    Several threads may be inside at a time: the last to leave restores the warning filters.
    """
    global _inside
    with _lock:
        if _inside == 0:
            _filters.enter_context(warnings.catch_warnings())
            warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if _inside == 0:
                _filters.close()
