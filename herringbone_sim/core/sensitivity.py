"""Derivatives of the state by parameters: what is differentiated, and in which units.

A column is dy/dtheta at the same mesh phase, all else of the parameter set held: y in the units of
the gear at theta itself (b_c, and b_c omega_n for velocities), as they are in SI where theta moves
these units. What is not in a column: a start that the parameter moves (columns start at zero
unless they are given), and the time of a sample, where theta moves the mesh frequency. A
parameter that moves omega_n, as k_m_sp does, moves the mesh frequency Omega omega_n with it; give
``omega_n`` to hold it.

The kernel takes constants of theta + eps and theta - eps, see ``columns``. They are brought to the
length b_c of the gear at theta and to a unit of time in which the mesh frequency is the same:
then phase and time are one, and a step is as long beside it as in the run. The velocities of a
column in that unit of time differ from those above by d ln(mesh frequency)/dtheta times v.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.columns import Near
from herringbone_sim.core.lanes import columns as lane_columns
from herringbone_sim.core.lanes.packed import Work as LaneWork
from herringbone_sim.core.lanes.vector import LANES
from herringbone_sim.core.model import Model
from herringbone_sim.core.packed import Packed, Work, make_work
from herringbone_sim.errors import ParameterError

Array = NDArray[np.float64]

# Constants of the excitation of a motion, errors and loads with it.
EXCITATION = (
    *("stiffness", "k_cos", "k_sin", "e_mean", "e_cos", "e_sin"),
    *("windows", "window_k", "window_d", "load_q", "load_r", "load_cos", "load_sin"),
    *("K", "control_q", "control_r", "control_phase"),
)


# Scratch that neighbours in lanes have for themselves; the rest is that of the run.
OF_NEIGHBOURS = (
    *("y", "k", "error", "scale", "load", "q", "v", "x", "f", "force"),
    *("mesh", "lane", "bump"),
)


@dataclass(frozen=True)
class Direction:
    """A parameter to differentiate by: the gear on both sides of its value.

    Attributes:
        name: as it is written, for errors.
        plus, minus: gears of theta + step and theta - step.
        step: in the unit of theta.
    """

    name: str
    plus: Model
    minus: Model
    step: float


class Directions:
    """All parameters of one run, for the kernel.

    Args:
        model: the gear at theta.
        directions: p of them.

    Raises:
        ParameterError: gears with other things in them than ``model``, or ``method: rk4``.

    Attributes:
        packed: (2 p, ...) each field of plus and minus in turn, in the units of ``model``.
        step: (p,).
        clock: (p,) d ln(mesh frequency)/dtheta.
        excites: (p,) whether k, e or the loads differ between both sides.
    """

    def __init__(self, model: Model, directions: Sequence[Direction]) -> None:
        if model.parameters.method == "rk4":
            raise ParameterError("derivatives need method: taylor, got rk4: change method")
        pairs = [(one.plus, one.minus) for one in directions]
        for one, pair in zip(directions, pairs, strict=True):
            if any(_sizes(near.packed) != _sizes(model.packed) for near in pair):
                raise ParameterError(
                    f"no derivative by {one.name}: there the gear gets or loses a harmonic, an "
                    "event, friction or a coordinate; give it a value away from there"
                )
        self._model = model
        self._gears = [brought_to(model, near) for pair in pairs for near in pair]
        self.packed = stacked(self._gears)
        self.step = np.array([one.step for one in directions])
        self.excites = np.array(
            [
                any(not np.array_equal(getattr(a, n), getattr(b, n)) for n in EXCITATION)
                for a, b in zip(self._gears[::2], self._gears[1::2], strict=True)
            ]
        )
        speeds = [[near.scales.omega_n * near.packed.Omega for near in pair] for pair in pairs]
        self.clock = -np.diff(np.log(speeds), axis=1)[:, 0] / (2.0 * self.step)

    def near(self, work: Work, y: Array, columns: Array) -> Near:
        """Columns (p, n_state) at a state for the kernel, with the switches of a run's scratch."""
        layout, n_own = self._model.layout, self._model.n_own
        order = len(work.k) - 1
        scratch = make_work(layout.n_mesh, layout.n_coordinate, order, n_own)
        of_run = work.any
        n = self._model.n_state
        inner = columns if len(columns) else np.zeros((len(self.step), n))
        return Near(
            packed=self.packed,
            step=self.step,
            excites=self.excites,
            columns=self.asked(y, inner),
            more=np.zeros((len(self.step), n)),
            moved=np.zeros((len(self.step), layout.n_mesh)),
            pair=np.zeros((2, n)),
            work=scratch._replace(
                contact=work.now if self._model.packed.plain else work.contact,
                any=scratch.any._replace(deep=of_run.deep, sign=of_run.sign),
            ),
        )

    def models(self) -> list[Model]:
        """Neighbours plus and minus of each parameter in turn, with ``packed`` as in the run."""
        return [replace(self._model, packed=packed) for packed in self._gears]

    def asked(self, y: Array, columns: Array) -> Array:
        """Columns (p, n_state) of users at a state y (n_state,) as the kernel takes them."""
        whole: Array = columns - self.clock[:, None] * velocities(self._model, y)
        return whole

    def told(self, y: Array, columns: Array) -> Array:
        """Columns (..., p, n_state) of the kernel at states (..., n_state) as users take them."""
        whole: Array = columns + self.clock[:, None] * velocities(self._model, y)[..., None, :]
        return whole


def velocities(model: Model, y: Array) -> Array:
    """Velocities (..., n_state) of states, with zeros in the place of displacements."""
    m, s = model.layout.n_coordinate, model.n_own
    rates: Array = np.array(y, dtype=float)
    rates[..., :m] = 0.0
    rates[..., 2 * m : 2 * m + s] = 0.0
    return rates


def in_units_of(other: Model, model: Model, y: Array) -> Array:
    """States (..., n_state) of a gear in the units of another: the same in SI."""
    s, o, speeds = model.scales, other.scales, velocities(model, y)
    length, rate = s.b_c / o.b_c, s.velocity_m_per_s / o.velocity_m_per_s
    whole: Array = length * (np.asarray(y) - speeds) + rate * speeds
    return whole


def _sizes(p: Packed) -> list[object]:
    """What a kernel can't change under way: how much there is of all, and the frequencies."""
    sizes = [np.shape(value) for value in p]
    return [*sizes, p.plain, *p.orders, *p.load_orders, p.control_order]


def stacked(gears: Sequence[Packed]) -> Packed:
    """Packed models of one size with all fields stacked."""
    fields: dict[str, Any] = {
        name: np.array([getattr(p, name) for p in gears]) for name in Packed._fields
    }
    return Packed(**fields | {"classes": gears[0].classes})


def brought_to(model: Model, near: Model) -> Packed:
    """Constants of a gear in the length of another and a time in which both mesh as fast."""
    p = near.packed
    length = near.scales.b_c / model.scales.b_c
    time = model.packed.Omega / p.Omega  # of the other's 1 / omega_n
    lengths = ("e_mean", "e_cos", "e_sin", "d_mean", "d_cos", "d_sin", "window_d", "b")
    pushes = ("load_q", "load_r", "load_cos", "load_sin", "own_hold", "K")
    springs = ("stiffness", "k_cos", "k_sin")
    factors = dict.fromkeys(lengths, length) | dict.fromkeys(pushes, length * time**2)
    factors |= dict.fromkeys(springs, time**2) | {"damping": time}
    law = p.law * np.array([length, 1.0, 1.0, 1.0, length])[:, None]
    seat = p.seat * np.array([1.0 / length, 1.0 / (length * time), length, length])
    changed = {name: getattr(p, name) * factor for name, factor in factors.items()}
    return p._replace(**changed, law=law, seat=seat, Omega=model.packed.Omega)


def lanes_near(
    along: Sequence[Directions],
    work: LaneWork,
    table: Array,
    taken: NDArray[np.int64],
    starts: Array,
) -> lane_columns.Near:
    """Columns of a batch for the lanes, zero at the start.

    Args:
        along: n of them with p parameters each.
        work: scratch of the run.
        table: (2 n p, rows, entries) constants of their neighbours.
        taken: (size,) indices of the states that are integrated, in those of ``starts``.
        starts: (n, n_state) of the run.
    """
    n, p, size = len(along), len(along[0].step), len(taken)
    at_start = [one.asked(y, np.zeros((p, len(y)))) for one, y in zip(along, starts, strict=True)]

    def zeros(*shape: int) -> Array:
        return np.zeros((*shape, LANES))

    return lane_columns.Near(
        table=table.reshape(n, 2 * p, *table.shape[1:]),
        steps=np.array([one.step for one in along])[:, :, None],
        starts=np.array(at_start)[:, :, taken],
        found=np.full((n, p, size), np.nan),
        constants=zeros(2 * p, *table.shape[1:]),
        step=zeros(p, 1),
        excites=np.any([one.excites for one in along], axis=0),
        columns=zeros(p, size),
        more=zeros(p, size),
        moved=zeros(p, work.k.shape[1]),
        pair=zeros(1, size),
        work=work._replace(
            **{name: np.zeros_like(getattr(work, name)) for name in OF_NEIGHBOURS},
            own=work.own._replace(
                **{
                    name: np.zeros_like(value)
                    for name, value in work.own._asdict().items()
                    if name != "turn"
                }
            ),
        ),
    )
