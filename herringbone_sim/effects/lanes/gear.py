"""Data of sixteen gears (lanes) that are integrated side by side by the laws of their effects.

The lane is the last axis of arrays, but the first one of those that laws not written for lanes
read: such a law is called lane by lane and needs the entries of a lane in one contiguous array.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.core.lanes.vector import LANES
from herringbone_sim.core.model import Model
from herringbone_sim.effects.dormand_prince import CompiledGear
from herringbone_sim.effects.gear import LANE_DRIVE, LANE_EXCITE, LANE_REACT, pointers
from herringbone_sim.effects.lanes.progress import ROWS

# Rows of ``LaneGear.scalars``, as fields of ``core.packed.Packed`` and of
# ``dormand_prince.CompiledGear``.
INV_SUN, LOAD_Q, CONTROL_Q, CONTROL_R = 0, 2, 4, 6
INV_CARRIER, LOAD_R, CONTROL_ORDER, CONTROL_PHASE = 8, 9, 10, 11
CONTROL, OMEGA, MULTIPLICITY, PROJECTION, SI = 12, 13, 14, 15, 16
INV_PLANET = SI + 5


class LawConstants(NamedTuple):
    """Constants of v gears: of all gears in the queue, or of those in the lanes."""

    theta: tuple[Array, ...]  # (v, p) of each effect
    site: tuple[Array, ...]  # (v, rows, n)
    gear: Array  # (v, rows, n)
    now: Array  # (v, 5) as in ``effects.law``
    events: Array  # (v, w, 3) events, see ``core.packed.Packed``
    flat: Array  # (v, all) entries of ``LaneGear.flat``; unused in the lanes


class LaneGear(NamedTuple):
    """The gears in the lanes; n meshes, b bodies, s = size of a state, l = LANES."""

    e: Any  # ``gear.Kernel``
    vector: tuple[Any, Any, Any]  # excite, react, drive of each effect, for lanes
    written: NDArray[np.bool_]  # (effects,) whether the laws of each are written for lanes
    flat: Array  # (all, l) constants; theta, site, gear, scalars, now and unit are views of it
    theta: tuple[Array, ...]  # (p, l) of each effect
    site: tuple[Array, ...]  # (rows, n, l)
    gear: Array  # (rows, n, l)
    scalars: Array  # (rows, l) one number a gear, rows as above
    now: Array  # (5, l)
    unit: Array  # (s, l) as in ``dormand_prince.CompiledGear``
    single_constants: LawConstants  # constants for laws that are not written for lanes
    single: Single
    w: LaneScratch
    r: LaneTrial
    n_state: int
    reacts: bool
    controlled: bool  # whether any gear has a control
    singly: bool  # whether any law is not written for lanes


class Single(NamedTuple):
    """Work arrays, lane first, that laws not written for lanes read and change."""

    added_states: Array  # (l, states of effects)
    slope: Array  # (l, states of effects)
    law: Array  # (l, 5, n)
    x: Array  # (l, n)
    v: Array  # (l, n)
    force: Array  # (l, n)
    torque: Array  # (l, b)


class LaneScratch(NamedTuple):
    """Work arrays as ``effects.gear.Scratch``, and motion without the effects' displacements."""

    contact_state: Array  # (n, l)
    law: Array  # (5, n, l)
    x: Array  # (n, l)
    v: Array  # (n, l)
    force: Array  # (n, l)
    torque: Array  # (b, l)
    clamp_shift: Array  # (n, l)
    plain: Array  # (n, l) deflection with the nominal error [m]
    rate: Array  # (n, l) its rate [m/s]


class LaneTrial(NamedTuple):
    """Work arrays as ``dormand_prince.Trial``, and the progress of each lane."""

    counters: NDArray[np.int64]  # (4, l) see ``progress``
    y: Array  # (7, s, l)
    slope: Array  # (7, s, l)
    clamp_shift: Array  # (7, n, l)
    margin: Array  # (5, 2 n, l), row ``contact.SPARE`` for work
    margin_rate: Array  # (5, n, l)
    sign: Array  # (n, l)
    along: Array  # (7, s, l)
    direction: Array  # (s, l)
    was: Array  # (s, l)
    z: Array  # (s, l)
    tangent: Array  # (k, s, l), k is 0 or 1
    spent: Array  # (l, n, 3)
    progress: Array  # (rows, l) see ``progress``


def lane_gear(
    models: Sequence[Model], gears: Sequence[CompiledGear], tangents: int
) -> tuple[LaneGear, LawConstants]:
    """Return lanes, still without values, for gears of one layout with the same effects.

    Also returns the constants of each gear. ``gears``: ``LawStepper.gear`` of each model.
    """
    constants = _law_constants_of(models, gears)
    mine = LawConstants(*(_lanes_of(part) for part in constants))
    flat = np.zeros((constants.flat.shape[1], LANES))
    views, first = [], 0
    for shape in (
        *(
            part.shape[1:]
            for part in (*constants.theta, *constants.site, constants.gear, constants.now)
        ),
        (INV_PLANET + 2 * models[0].layout.n_classes,),
        gears[0].unit.shape,
    ):
        size = int(np.prod(shape))
        views.append(flat[first : first + size].reshape(*shape, LANES))
        first += size
    k, template = len(constants.theta), gears[0]
    n, s, n_added_states = (
        template.w.force.size,
        template.unit.size,
        template.unit.size - template.n_state,
    )
    effects = models[0].effects
    return LaneGear(
        e=template.e,
        vector=pointers(effects, (LANE_EXCITE, LANE_REACT, LANE_DRIVE), lanes=True),
        written=np.array([*(a.effect.lanes for a in effects), *[False] * (k - len(effects))]),
        flat=flat,
        theta=tuple(views[:k]),
        site=tuple(views[k : 2 * k]),
        gear=views[2 * k],
        now=views[2 * k + 1],
        scalars=views[2 * k + 2],
        unit=views[2 * k + 3],
        single_constants=mine,
        single=_single(n, n_added_states, template.w.torque.size),
        w=_scratch(n, template.w.torque.size),
        r=_trial(n, s, tangents),
        n_state=template.n_state,
        reacts=template.reacts,
        controlled=any(model.packed.K != 0.0 for model in models),
        singly=not all(a.effect.lanes for a in effects),
    ), constants


def _law_constants_of(models: Sequence[Model], gears: Sequence[CompiledGear]) -> LawConstants:
    def stacked(parts: Sequence[Array]) -> Array:
        return np.array(parts)

    theta = tuple(map(stacked, zip(*(gear.theta for gear in gears), strict=True)))
    site = tuple(map(stacked, zip(*(gear.site for gear in gears), strict=True)))
    gear, now = stacked([g.gear for g in gears]), stacked([g.now for g in gears])
    rows = stacked([_constants(*pair) for pair in zip(models, gears, strict=True)])
    parts = [part.reshape(len(gears), -1) for part in (*theta, *site, gear, now, rows)]
    events = stacked([g.p.events for g in gears])
    return LawConstants(theta, site, gear, now, events, np.concatenate(parts, axis=1))


def _lanes_of(part: Any) -> Any:
    if isinstance(part, tuple):
        return tuple(_lanes_of(array) for array in part)
    return np.zeros((LANES, *part.shape[1:]))


def _constants(model: Model, gear: CompiledGear) -> Array:
    p = model.packed
    rows = [*p.inv_M_s, *p.load_q, *p.control_q, *p.control_r, p.inv_M_c, p.load_r]
    rows += [p.control_order, p.control_phase, p.K, p.Omega, p.multiplicity]
    rows += [gear.g.projection, *gear.si, *p.inv_M_p.ravel(), *gear.unit]
    return np.array(rows)


def _zeros(*sizes: Any) -> list[Array]:
    return [np.zeros(size) for size in sizes]


def _single(n: int, n_added_states: int, bodies: int) -> Single:
    sizes = n_added_states, n_added_states, (5, n), n, n, n, bodies
    return Single(*(np.zeros((LANES, *np.atleast_1d(size))) for size in sizes))


def _scratch(n: int, bodies: int) -> LaneScratch:
    shapes = [(n,), (5, n), (n,), (n,), (n,), (bodies,), (n,), (n,), (n,)]
    return LaneScratch(*_zeros(*((*shape, LANES) for shape in shapes)))


def _trial(n: int, s: int, tangents: int) -> LaneTrial:
    shapes = [(7, s), (7, s), (7, n), (5, 2 * n), (5, n), (n,), (7, s)]
    shapes += [(s,), (s,), (s,), (tangents, s)]
    rest = _zeros(*((*shape, LANES) for shape in shapes), (LANES, n, 3), (ROWS, LANES))
    return LaneTrial(np.zeros((4, LANES), dtype=np.int64), *rest)
