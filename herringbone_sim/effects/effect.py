"""Definition of an effect: its parameters, its possible places, and its laws."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.layout import KINDS, SIDES, Layout
from herringbone_sim.core.model import Model
from herringbone_sim.core.timeseries import TimeSeries
from herringbone_sim.effects.law import no_drive, no_excite, no_react
from herringbone_sim.effects.slots import Slots
from herringbone_sim.errors import ParameterError, listed, shown

Options = Mapping[str, Any]
LEVELS = ("mesh", "body", "sensor")


@dataclass(frozen=True)
class Parameter:
    """A numeric parameter of an effect: its size, or a property of its shape.

    Attributes:
        name, unit, text: as in a report; the text is its meaning.
        low, high: bounds.
        start: a moderate value to start a fit from.
        neutral: value at which the effect changes nothing; None for a property of its shape.
        bends: whether it bends the law that it has at its start value. A rig to practise on is not
            drawn with it, and it stays as it was found where rivals are told apart.
    """

    name: str
    unit: str
    text: str
    low: float
    high: float
    start: float
    neutral: float | None = 0.0
    bends: bool = False


@dataclass(frozen=True)
class Option:
    """A discrete choice of an effect: which member, which order, which law.

    Attributes:
        choices: allowed values; empty for any text or list of texts.
        bends: as of a parameter.
    """

    name: str
    text: str
    start: Any
    choices: tuple[Any, ...] = ()
    bends: bool = False


@dataclass(frozen=True)
class Locus:
    """A set of meshes: kind ``sp``, ``rp`` or ``all``; planet ``1`` .. or ``all``; side or
    ``all``.
    """

    mesh: str = "all"
    planet: str = "all"
    side: str = "all"

    def mask(self, layout: Layout) -> Array:
        """(n_mesh,) 1 on the meshes of the locus, else 0; ParameterError if the gear has none."""
        planets = layout.planets if layout.numbered else ("all",)
        for name, value, known in (
            ("mesh", self.mesh, KINDS),
            ("planet", self.planet, planets),
            ("side", self.side, SIDES),
        ):
            if value not in (*known, "all"):
                raise ParameterError(
                    f"{name} of a locus must be one of {', '.join((*known, 'all'))}, got "
                    f"{shown(value)}: name meshes of the gear (model: full tells planets apart)"
                )
        chosen = [
            float(
                self.mesh in ("all", kind)
                and self.planet in ("all", planet)
                and self.side in ("all", side)
            )
            for kind in KINDS
            for side in SIDES
            for planet in planets
        ]
        return np.array(chosen)


ALL = Locus()
Place = Callable[[Model, Array, Options], Array]
Fill = Callable[[Slots, tuple[float, ...], Array, Options], None]
Distort = Callable[[Array, TimeSeries, tuple[str, ...]], TimeSeries]


def plain_place(model: Model, mask: Array, options: Options) -> Array:
    """Rows (1, n_mesh): the mask alone."""
    rows: Array = mask[None, :].copy()
    return rows


@dataclass(frozen=True)
class Effect:
    """An effect of the catalogue.

    Attributes:
        id: name in reports and parameter files.
        text: what it is, in a line.
        level: ``mesh`` acts in the force law, ``body`` in the torque balance, ``sensor`` on the
            recording.
        parameters: in the order of ``theta``.
        loci: patterns (mesh, planet, side) of possible places: each part a name, ``all`` for all
            together, or ``*`` for each single one.
        options: discrete choices.
        fill: (slots, theta, mask (n_mesh,), options) writes the effect into the slots of the gear,
            see ``effects.slots``; None for an effect that no slot represents.
        place: rows ``site`` (rows, n_mesh) from the model, the mask of the locus and the options.
        excite, react, drive: compiled laws, see ``effects.law``.
        states: (model) -> number of states of its own.
        lanes: whether the laws are also written for lanes, see ``effects.law``.
        distort: of a sensor effect: (theta, series, channels) -> series.
        reach: of a sensor effect: (theta) -> time [s] before or after a sample that it depends on.
        needs_recording: of a sensor effect: (its channels) -> whether that time grows without
            bound, so that it acts on whole recordings alone, not on a stream.
    """

    id: str
    text: str
    level: str
    parameters: tuple[Parameter, ...]
    loci: tuple[tuple[str, str, str], ...] = (("all", "all", "all"),)
    options: tuple[Option, ...] = ()
    fill: Fill | None = None
    place: Place = plain_place
    excite: Any = no_excite
    react: Any = no_react
    drive: Any = no_drive
    lanes: bool = False
    states: Callable[[Model], int] = field(default=lambda model: 0)
    distort: Distort | None = None
    reach: Callable[[tuple[float, ...]], float] = field(default=lambda theta: 0.0)
    needs_recording: Callable[[tuple[str, ...]], bool] = field(default=lambda channels: False)

    def __post_init__(self) -> None:
        if self.level not in LEVELS:
            raise ParameterError(f"level of {self.id} must be one of {LEVELS}, got {self.level!r}")
        if (self.level == "sensor") != (self.distort is not None):
            raise ParameterError(f"{self.id}: a sensor effect, and no other, has distort")

    @property
    def neutral(self) -> Array:
        """theta (p,) at which nothing changes; start values for parameters without a neutral
        value.
        """
        values = [p.start if p.neutral is None else p.neutral for p in self.parameters]
        return np.array(values, dtype=float)

    @property
    def start(self) -> Array:
        """theta (p,) to start a fit from."""
        return np.array([p.start for p in self.parameters], dtype=float)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest theta (p,)."""
        low = np.array([p.low for p in self.parameters], dtype=float)
        return low, np.array([p.high for p in self.parameters], dtype=float)

    def candidates(self, layout: Layout) -> tuple[Locus, ...]:
        """Every locus of a gear at which this effect may be."""
        planets = layout.planets if layout.numbered else ("all",)
        known = (KINDS, planets, SIDES)
        found: dict[Locus, None] = {}
        for pattern in self.loci:
            parts = [
                names if part == "*" else (part,)
                for part, names in zip(pattern, known, strict=True)
            ]
            for mesh in parts[0]:
                for planet in parts[1]:
                    found |= {Locus(mesh, planet, side): None for side in parts[2]}
        return tuple(found)


@dataclass(frozen=True)
class Active:
    """An effect with its size and place, as in a parameter file or a hypothesis.

    Attributes:
        effect: its definition.
        theta: (p,) its parameters.
        locus: its place.
        options: choices by name; missing ones have the effect's start values.
    """

    effect: Effect
    theta: tuple[float, ...]
    locus: Locus = ALL
    options: tuple[tuple[str, Any], ...] = ()

    def with_theta(self, theta: Sequence[float] | Array) -> Active:
        """The same at the same place with other parameters."""
        return replace(self, theta=tuple(float(v) for v in theta))

    @property
    def chosen(self) -> dict[str, Any]:
        """Value of every option by name; its start value where none was given."""
        return {o.name: o.start for o in self.effect.options} | dict(self.options)


def active(
    effect: Effect,
    locus: Locus = ALL,
    values: Mapping[str, Any] | None = None,
) -> Active:
    """An effect at a place with parameters and options by name; missing ones at their start
    values.

    Raises:
        ParameterError: an unknown name, or a value outside its bounds.
    """
    values = dict(values or {})
    theta = tuple(_number(effect, p, values.pop(p.name, p.start)) for p in effect.parameters)
    options = {o.name: _choice(effect, o, values.pop(o.name, o.start)) for o in effect.options}
    if values:
        known = [*(p.name for p in effect.parameters), *(o.name for o in effect.options)]
        raise ParameterError(
            f"{effect.id} has no {listed(sorted(map(str, values)))}; it has {', '.join(known)}"
        )
    return Active(effect, theta, locus, tuple(options.items()))


def _number(effect: Effect, p: Parameter, value: Any) -> float:
    """Value of a parameter as a float; ParameterError unless it is a number within its bounds."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ParameterError(f"{p.name} of {effect.id} must be a number, got {shown(value)}")
    if value != p.neutral and not p.low <= value <= p.high:
        raise ParameterError(
            f"{p.name} [{p.unit}] of {effect.id} must lie in {p.low:g} .. {p.high:g}, "
            f"got {shown(value)}: choose a value inside"
        )
    return float(value)


def _choice(effect: Effect, option: Option, value: Any) -> Any:
    """Value of an option; ParameterError unless it is one of the choices."""
    value = tuple(value) if isinstance(value, list) else value
    if option.choices and value not in option.choices:
        raise ParameterError(
            f"{option.name} of {effect.id} must be one of {option.choices}, got {shown(value)}"
        )
    return value
