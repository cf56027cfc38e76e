"""Definition of an effect: its parameters, its possible places, and its laws.

Over 300 lines: what a definition may say stands beside the checks of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
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
        name, unit, text: as printed in a report; the text is the meaning.
        low, high: bounds, inclusive.
        start: moderate value to start a fit from.
        neutral: value at which the effect changes nothing, allowed outside the bounds too; None
            for a property of the shape.
        bends: whether it only refines the shape of the law. Practice rigs then have its start
            value, and the comparison of rival explanations does not vary its fitted value.
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
        name, text: as printed in a report; the text is the meaning.
        start: value where none is given.
        choices: allowed values; empty for any text or list of texts.
        bends: as for ``Parameter``.
    """

    name: str
    text: str
    start: Any
    choices: tuple[Any, ...] = ()
    bends: bool = False


@dataclass(frozen=True)
class Locus:
    """Set of meshes at which an effect acts.

    Attributes:
        mesh: kind, ``sp``, ``rp`` or ``all``.
        planet: ``1``, ``2``, ... or ``all``; only ``all`` in the reduced model.
        side: ``L``, ``R`` or ``all``.
    """

    mesh: str = "all"
    planet: str = "all"
    side: str = "all"

    def mask(self, layout: Layout) -> Array:
        """Return an array (n_mesh,): 1 on the meshes of the locus, 0 elsewhere.

        Raises:
            ParameterError: the gear does not have such a mesh kind, planet or side.
        """
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
            self.mesh in ("all", kind)
            and self.side in ("all", side)
            and self.planet in ("all", planet)
            for kind, side, planet in product(KINDS, SIDES, planets)
        ]
        return np.array(chosen, dtype=float)


ALL = Locus()
Place = Callable[[Model, Array, Options], Array]
Fill = Callable[[Slots, tuple[float, ...], Array, Options], None]
Distort = Callable[[Array, TimeSeries, tuple[str, ...]], TimeSeries]


def plain_place(model: Model, mask: Array, options: Options) -> Array:
    """Return ``site`` (1, n_mesh) with the mask as its only row; the default ``Effect.place``."""
    rows: Array = mask[None, :].copy()
    return rows


@dataclass(frozen=True)
class Effect:
    """Definition of an effect: its parameters, possible places and laws.

    Attributes:
        id: name in reports and parameter files.
        text: description in one line.
        level: ``mesh`` acts in the force law, ``body`` in the torque balance, ``sensor`` on the
            recording.
        parameters: numeric parameters, in the order of ``theta``.
        loci: patterns (mesh, planet, side) of possible places, see ``candidates``: each part is a
            name, ``all`` (all of them at once) or ``*`` (each of them singly).
        options: discrete choices.
        fill: (slots, theta, mask (n_mesh,), options) -> None, writes the effect into the slots of
            the gear, see ``effects.slots``; None for an effect that no slot represents.
        place: (model, mask (n_mesh,), options) -> ``site`` (rows, n_mesh), constants for the laws.
        excite, react, drive: compiled laws, see ``effects.law``.
        last: whether ``excite`` acts after that of all other effects, in whatever order they are
            listed, as a loss of the whole stiffness does.
        once: whether a gear can have it at one locus only: laws of two would not act together.
        divisible: whether a part of the places in ``loci`` can be chosen; False if the laws act
            on the gear as a whole.
        lanes: whether the laws use the functions of ``core.lanes.vector``, by which they run in
            lanes too, see docs/effects.md.
        states: (model) -> number of state variables that the effect adds.
        distort: (theta, series of one sample or more, channels) -> changed series; sensor effects
            only.
        reach: (theta) -> time [s] before and after a sample on which its changed value depends.
        needs_recording: (channels) -> whether that time grows along a run without bound, so that
            the effect applies to whole recordings only, not to a stream.

    Raises:
        ParameterError: an unknown level, ``distort`` in other than sensor effects, or single loci
            (``*``) of an effect that is not divisible, ``fill`` without ``excite`` or ``react``.
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
    last: bool = False
    once: bool = False
    divisible: bool = True
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
        if self.fill is not None and self.excite is no_excite and self.react is no_react:
            raise ParameterError(
                f"{self.id} has fill alone: write excite or react too, by which it acts in the "
                "diagnosis and beside effects that no slot represents"
            )
        if not self.divisible and any("*" in pattern for pattern in self.loci):
            raise ParameterError(f"{self.id}: an effect that is not divisible has no loci with *")

    @property
    def neutral(self) -> Array:
        """Parameter values (p,) without influence, maybe infinite; the start of shape values."""
        values = [p.start if p.neutral is None else p.neutral for p in self.parameters]
        return np.array(values, dtype=float)

    @property
    def start(self) -> Array:
        """Parameter values (p,) to start a fit from."""
        return np.array([p.start for p in self.parameters], dtype=float)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest (p,) and highest (p,) parameter values."""
        low = np.array([p.low for p in self.parameters], dtype=float)
        return low, np.array([p.high for p in self.parameters], dtype=float)

    def candidates(self, layout: Layout) -> tuple[Locus, ...]:
        """Return every locus of a gear that fits a pattern of ``loci``, without repetition."""
        planets = layout.planets if layout.numbered else ("all",)
        known = (KINDS, planets, SIDES)
        loci: dict[Locus, None] = {}
        for pattern in self.loci:
            parts = [
                names if part == "*" else (part,)
                for part, names in zip(pattern, known, strict=True)
            ]
            loci |= {Locus(*place): None for place in product(*parts)}
        return tuple(loci)


@dataclass(frozen=True)
class Active:
    """An effect with parameter values, a place and options, as in a parameter file.

    Attributes:
        effect: definition.
        theta: (p,) parameter values.
        locus: place.
        options: pairs of name and value; missing options have their start values.
    """

    effect: Effect
    theta: tuple[float, ...]
    locus: Locus = ALL
    options: tuple[tuple[str, Any], ...] = ()

    def with_theta(self, theta: Sequence[float] | Array) -> Active:
        """Return the effect with other parameter values (p,), same place and options."""
        return replace(self, theta=tuple(float(v) for v in theta))

    @property
    def chosen(self) -> dict[str, Any]:
        """Value of every option by name, the start value where none was given."""
        return {o.name: o.start for o in self.effect.options} | dict(self.options)


def active(effect: Effect, locus: Locus = ALL, values: Mapping[str, Any] | None = None) -> Active:
    """Return an effect at a place with ``values`` of parameters and options by name.

    Missing ones have their start values. The locus may be wider or narrower than ``effect.loci``.

    Raises:
        ParameterError: an unknown name, a value that is out of bounds or no choice, or a locus
            where the effect can't act.
    """
    _check_locus(effect, locus)
    values = dict(values or {})
    theta = tuple(_number(effect, p, values.pop(p.name, p.start)) for p in effect.parameters)
    options = {o.name: _choice(effect, o, values.pop(o.name, o.start)) for o in effect.options}
    if values:
        known = [*(p.name for p in effect.parameters), *(o.name for o in effect.options)]
        raise ParameterError(
            f"{effect.id} has no {listed(sorted(map(str, values)))}; it has {', '.join(known)}"
        )
    return Active(effect, theta, locus, tuple(options.items()))


def _check_locus(effect: Effect, locus: Locus) -> None:
    """Raise ParameterError for a locus without the meshes of an effect, or one too narrow for it.

    A name in a pattern of ``loci``, such as ``rp``, excludes other names. An effect that is not
    ``divisible`` takes its loci alone.
    """
    parts = (str(locus.mesh), str(locus.planet), str(locus.side))
    fits = [
        all(
            allowed in ("all", "*", part) or part == "all"
            for allowed, part in zip(pattern, parts, strict=True)
        )
        for pattern in effect.loci
    ]
    if not any(fits) or not (effect.divisible or parts in effect.loci):
        raise ParameterError(
            f"{effect.id} acts at {' or '.join('/'.join(pattern) for pattern in effect.loci)}"
            f", got {shown('/'.join(parts))}: choose such a place (*: any name), or leave it out"
        )


def _number(effect: Effect, p: Parameter, value: Any) -> float:
    """Return a value as a float; ParameterError unless it is neutral or within the bounds."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise ParameterError(f"{p.name} of {effect.id} must be a number, got {shown(value)}")
    if value != p.neutral and not p.low <= value <= p.high:
        raise ParameterError(
            f"{p.name} [{p.unit}] of {effect.id} must lie in {p.low:g} .. {p.high:g}, "
            f"got {shown(value)}: choose a value inside"
        )
    return float(value)


def _choice(effect: Effect, option: Option, value: Any) -> Any:
    """Return an option's value, lists as tuples; ParameterError if it is not among the choices."""
    value = tuple(value) if isinstance(value, list) else value
    if option.choices and value not in option.choices:
        raise ParameterError(
            f"{option.name} of {effect.id} must be one of {option.choices}, got {shown(value)}"
        )
    return value
