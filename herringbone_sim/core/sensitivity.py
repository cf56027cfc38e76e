"""Derivatives of the state with respect to parameters (columns), and their units.

A column is dy/dtheta at the same mesh phase with all other parameters fixed: y in the units of the
gear at theta itself (b_c, and b_c omega_n for velocities), differentiated in SI where theta
changes these units. A column does not contain the change of an initial state with the parameter
(columns start at zero unless they are given), nor the change of the time of a sample with the mesh
frequency. A parameter that changes omega_n, such as k_m_sp, changes the mesh frequency Omega
omega_n with it; set ``omega_n`` to keep it fixed.

The kernel uses the constants at theta + eps and theta - eps, see ``lanes.columns``. They are
converted to the length b_c of the gear at theta and to a unit of time in which the mesh frequency
is the same: phase and time then coincide, and steps have the same length as at theta. The
velocities of a column in that unit of time differ from those above by d ln(mesh frequency)/dtheta
times v.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.lanes.columns import Neighbours
from herringbone_sim.core.lanes.packed import NonlinearWork, Sizes, Work, constants
from herringbone_sim.core.lanes.vector import LANES
from herringbone_sim.core.model import Model
from herringbone_sim.core.packed import Packed
from herringbone_sim.core.reference import tables
from herringbone_sim.errors import ParameterError

# Fields of ``Packed`` that change the series of stiffness, errors or loads.
EXCITATION = (
    *("stiffness", "k_cos", "k_sin", "e_mean", "e_cos", "e_sin"),
    *("events", "event_k", "event_d", "load_q", "load_r", "load_cos", "load_sin"),
    *("K", "control_q", "control_r", "control_phase"),
)


# Fields of ``Work`` that neighbours must not share with the orbit; they share the others.
OF_NEIGHBOURS = (
    *("y", "k", "error", "scale", "load", "q", "v", "x", "f", "force"),
    *("forces", "push", "mix", "mesh_state", "progress", "bump"),
)


@dataclass(frozen=True)
class Direction:
    """A parameter theta to differentiate by, with the gears on both sides of its value.

    Attributes:
        name: name of the parameter, for error messages.
        plus, minus: models at theta + step and theta - step.
        step: half of the difference, in the unit of theta.
    """

    name: str
    plus: Model
    minus: Model
    step: float


def need_series(model: Model, what: str) -> None:
    """Raise ParameterError for a gear not integrated by Taylor series, which ``what`` needs."""
    if model.integrator is not None:
        raise ParameterError(
            f"{what} need effects that fill slots, got a gear by its effects' own laws: give the "
            "effect a fill, see docs/effects.md"
        )
    need_tangents(model, what)


def has_tangents(model: Model) -> bool:
    """False for ``method: rk4``, which steps over the kinks of the force."""
    return model.parameters.method != "rk4" or model.integrator is not None


def need_tangents(model: Model, what: str = "tangents") -> None:
    """Raise ParameterError for a gear without tangents, see ``has_tangents``."""
    if not has_tangents(model):
        raise ParameterError(f"{what} need method: taylor, got rk4: change method")


class Directions:
    """The p parameters of one model to differentiate by, in the form of the kernel.

    Args:
        model: the gear at the present values of the parameters.
        directions: the parameters.

    Raises:
        ParameterError: gears whose arrays differ in size from those of ``model``, ``method: rk4``,
            or effects by their own laws.

    Attributes:
        model: the gear.
        step: (p,) ``Direction.step`` of each.
        log_frequency_slope: (p,) d ln(mesh frequency)/dtheta.
        excites: (p,) whether any of ``EXCITATION`` differs between both sides.
    """

    def __init__(self, model: Model, directions: Sequence[Direction]) -> None:
        need_series(model, "derivatives")
        pairs = [(direction.plus, direction.minus) for direction in directions]
        for direction, pair in zip(directions, pairs, strict=True):
            if any(_sizes(near.packed) != _sizes(model.packed) for near in pair):
                raise ParameterError(
                    f"no derivative by {direction.name}: there the gear gets or loses a harmonic, "
                    "an event, friction, a power, a rounded corner or a coordinate; give it a "
                    "value away from there"
                )
        self.model = model
        self._gears = [brought_to(model, near) for pair in pairs for near in pair]
        self.step = np.array([direction.step for direction in directions])
        self.excites = np.array(
            [
                any(not np.array_equal(getattr(a, n), getattr(b, n)) for n in EXCITATION)
                for a, b in zip(self._gears[::2], self._gears[1::2], strict=True)
            ]
        )
        speeds = [[near.scales.omega_n * near.packed.Omega for near in pair] for pair in pairs]
        self.log_frequency_slope = -np.diff(np.log(speeds), axis=1)[:, 0] / (2.0 * self.step)

    def neighbours(self, work: Work, y: Array, columns: Array) -> Neighbours:
        """Return data for the kernel to integrate columns along an orbit.

        Args:
            work: work arrays of the orbit.
            y: (n_state,) its start state.
            columns: (p, n_state) at y, or none for zeros.
        """
        start = columns if len(columns) else np.zeros((len(self.step), len(y)))
        models, inner = self.models(), self.to_kernel(y, start)
        table = constants(models, 2, Sizes(*work.sizes.tolist()))
        return neighbours_of([self], work, table, inner[None], lanes=())

    def models(self) -> list[Model]:
        """Return the models plus and minus of each parameter in turn.

        Their ``packed`` is in the units of the kernel (``brought_to``); the rest is of the model.
        """
        return [replace(self.model, packed=packed) for packed in self._gears]

    def to_kernel(self, y: Array, columns: Array) -> Array:
        """Derivatives (p, n_state) of a state y (n_state,) as the kernel has them.

        See ``from_kernel``.
        """
        whole: Array = columns - self.log_frequency_slope[:, None] * velocities(self.model, y)
        return whole

    def from_kernel(self, y: Array, columns: Array) -> Array:
        """Derivatives (..., p, n_state) of states (..., n_state) in the model's unit of time.

        In the kernel both neighbours of a parameter have the same mesh frequency, so that their
        units of time differ: d ln(frequency)/d parameter times the rate is added to the rates.
        """
        whole: Array = (
            columns + self.log_frequency_slope[:, None] * velocities(self.model, y)[..., None, :]
        )
        return whole


def velocities(model: Model, y: Array) -> Array:
    """Return a copy of states (..., n_state) with zeros in place of the displacements."""
    m, s = model.layout.n_coordinate, model.n_added_coordinates
    rates: Array = np.array(y, dtype=float)
    rates[..., :m] = 0.0
    rates[..., 2 * m : 2 * m + s] = 0.0
    return rates


def in_units_of(other: Model, model: Model, y: Array) -> Array:
    """Convert states (..., n_state) of ``model`` to the units of ``other``, equal in SI."""
    s, o, speeds = model.scales, other.scales, velocities(model, y)
    length, rate = s.b_c / o.b_c, s.velocity_m_per_s / o.velocity_m_per_s
    whole: Array = length * (np.asarray(y) - speeds) + rate * speeds
    return whole


def _sizes(p: Packed) -> list[object]:
    """List array sizes and frequencies, which must agree between the gears of a derivative."""
    sizes = [np.shape(value) for value in p]
    return [*sizes, p.plain, p.powers, *p.orders, *p.load_orders, p.control_order]


def brought_to(model: Model, near: Model) -> Packed:
    """Return the constants of ``near`` in the b_c of ``model``, with time scaled to its Omega."""
    p = near.packed
    length = near.scales.b_c / model.scales.b_c
    time = model.packed.Omega / p.Omega  # unit of time, in 1 / omega_n of ``near``
    lengths = ("e_mean", "e_cos", "e_sin", "d_mean", "d_cos", "d_sin", "event_d", "b")
    pushes = ("load_q", "load_r", "load_cos", "load_sin", "K")
    springs = ("stiffness", "k_cos", "k_sin")
    factors = dict.fromkeys(lengths, length) | dict.fromkeys(pushes, length * time**2)
    factors |= dict.fromkeys(springs, time**2) | {"damping": time}
    law = p.law * np.array([length, 1.0, 1.0, 1.0, length])[:, None]
    seat = p.seat * np.array([1.0 / length, 1.0 / (length * time), length, length])
    push = p.push.copy()
    push[..., len(p.stiffness) :] *= length * time**2
    changed = {name: getattr(p, name) * factor for name, factor in factors.items()}
    return p._replace(**changed, law=law, seat=seat, push=push, Omega=model.packed.Omega)


def neighbours_of(
    along: Sequence[Directions],
    work: Work,
    table: Array,
    starts: Array,
    lanes: tuple[int, ...] = (LANES,),
) -> Neighbours:
    """Return data for the kernel to integrate the columns of n models.

    Args:
        along: n sets of p parameters each.
        work: work arrays of the orbits.
        table: (2 n p, rows, entries) constants of the gears on both sides.
        starts: (n, p, n_state) columns from ``Directions.to_kernel``; n_state counts the numbers
            of a state that are integrated (one half or both).
        lanes: as for ``lanes.packed.make_work``; for a single orbit the columns are set at once.
    """
    n, p, size = starts.shape
    steps = np.array([directions.step for directions in along])[:, :, None]

    def zeros(*shape: int) -> Array:
        return np.zeros((*shape, *lanes))

    columns, gears = zeros(p, size), zeros(2 * p, *table.shape[1:])
    inner: Work = work._replace(
        **{name: np.zeros_like(getattr(work, name)) for name in OF_NEIGHBOURS},
        nonlinear=NonlinearWork(*(np.zeros_like(value) for value in work.nonlinear)),
    )
    along_columns = work._replace(y=columns)
    neighbours = Neighbours(
        table=table.reshape(n, 2 * p, *table.shape[1:]),
        steps=steps,
        starts=starts,
        ends=np.full((n, p, size), np.nan),
        constants=gears,
        step=zeros(p, 1),
        excites=np.any([directions.excites for directions in along], axis=0),
        columns=columns,
        more=zeros(p, size),
        border_shift=zeros(p, work.k.shape[1]),
        pair=zeros(1, size),
        work=inner,
        works=tables([*(inner._replace(constants=gear) for gear in gears), along_columns]),
    )
    if not lanes:
        neighbours.constants[:], neighbours.step[:], neighbours.columns[:] = (
            neighbours.table[0],
            steps[0],
            starts[0],
        )
    return neighbours
