"""Gears on both sides of a named parameter, for derivatives by it (columns).

A name is that of a parameter of ``core.parameters``, with an index if it is a list (``delta_T``,
``k_factor[2]``), or that of a parameter of an effect, ``ID@MESH/PLANET/SIDE:NAME``
(``mean_stiffness@sp:factor``). An effect that the gear lacks may be named too: it is added at a
billionth of its size (a law with a power of the deflection at a thousandth), so that the column is
its influence. Other values of the effect are written before the name,
``profile_error@sp:order=3,cos``; among effects of the gear they select the one with these values.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from herringbone_sim.core.model import Model
from herringbone_sim.core.parameters import Parameters, lengths, meaning, names
from herringbone_sim.core.sensitivity import Direction
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import Active, Parameter
from herringbone_sim.effects.written import parameter_values, parse_effect
from herringbone_sim.errors import ParameterError, shown

# About the cube root of the rounding error, where truncation and rounding of a difference balance.
STEP = 1e-5  # relative to the size of a parameter
SMALL = 1e-9  # relative size at which an effect that the gear lacks is added
# The same for a law with a power of the deflection: if smaller, the step length no longer
# reflects that its series converge over a shorter time than those of the linear law.
SMALL_POWER = 1e-3
NOT_SMOOTH = ("initial_x", "initial_v", "initial_noise", "control_order")
BALANCES = ("T_2", "omega_n")


@dataclass(frozen=True)
class _Named:
    """A named parameter, of the gear or of an effect.

    Attributes:
        name: as written.
        value: present value.
        size: scale of the value, to which the difference is relative.
        field: name in ``Parameters``; empty for a parameter of an effect.
        effect: index of the effect in the list of active effects; -1 for one of the gear.
        entry: index in ``values``, or in theta of the effect.
        values: all entries of a list parameter; empty for a single value.
    """

    name: str
    value: float
    size: float
    field: str = ""
    effect: int = -1
    entry: int = 0
    values: tuple[float, ...] = ()


def directions(model: Model, parameter_names: Sequence[str]) -> tuple[Model, list[Direction]]:
    """Return the gear with all named effects, and a direction for each name (see above).

    The gear is ``model`` itself unless an effect had to be added or moved off its neutral value.

    Raises:
        ParameterError: an unknown name, or a parameter without a derivative (a choice, an integer,
            a start value, a sensor).
    """
    parameters = model.parameters
    actives = list(model.effects)
    named = [_find(model, actives, name) for name in parameter_names]
    base = model if actives == list(model.effects) else build_with(parameters, actives)
    if base.n_added_coordinates != model.n_added_coordinates or not all(
        np.isfinite(parameter.value) for parameter in named
    ):
        raise ParameterError(
            "an effect with coordinates of its own has no derivative at size zero: give the gear "
            "ring_flexibility or bearing_clearance with a size first"
        )
    along = []
    for parameter in named:
        step = STEP * parameter.size
        pair = [
            _changed(parameters, actives, parameter, parameter.value + s * step)
            for s in (1.0, -1.0)
        ]
        along.append(Direction(parameter.name, pair[0], pair[1], step))
    return base, along


def _changed(
    parameters: Parameters, actives: Sequence[Active], named: _Named, value: float
) -> Model:
    """Build the model with another value of a parameter, which may exceed the bounds a little."""
    if named.effect >= 0:
        others = list(actives)
        theta = list(others[named.effect].theta)
        theta[named.entry] = value
        others[named.effect] = others[named.effect].with_theta(theta)
        return build_with(parameters, others)
    values = list(named.values)
    if values:
        values[named.entry] = value
    moved = copy(parameters)
    vars(moved)[named.field] = tuple(values) if values else value
    return build_with(moved, actives)


def _find(model: Model, actives: list[Active], name: str) -> _Named:
    """Find a parameter by its name; an effect that the gear lacks is appended to ``actives``."""
    if ":" in name:
        return _find_in_effect(model, actives, name)
    parts = re.fullmatch(r"\s*(\w+)(?:\[(\d+)\])?\s*", name)
    if parts is None or parts[1] not in names():
        raise ParameterError(
            f"no parameter {shown(name)} to differentiate by: write a parameter of the gear "
            "(delta_T, k_factor[2]) or of an effect (mean_stiffness@sp:factor)"
        )
    p, field = model.parameters, parts[1]
    value = getattr(p, field)
    if field in NOT_SMOOTH or isinstance(value, (str, int)):
        raise ParameterError(
            f"no derivative by {field}: it is a choice, a whole number, a frequency or a start "
            "value (the start has the tangent vectors)"
        )
    if field in BALANCES and value == 0.0:
        raise ParameterError(f"no derivative by {field}: 0 stands for its rule; give it a value")
    unit = model.scales.b_c if meaning(field).unit == "m" else 1.0
    if not isinstance(value, tuple):
        if parts[2]:
            raise ParameterError(f"{field} is one number: leave out [{parts[2]}]")
        return _Named(name, value, abs(value) or unit, field)
    most = lengths(p).get(field, (0, 0))[1]
    values = value * most if len(value) == 1 and parts[2] and most else value
    entry = int(parts[2] or 0)
    if entry >= len(values) or (not parts[2] and len(values) != 1):
        raise ParameterError(
            f"{field} has {len(values)} entries, counted from 0, got {shown(name)}: name one"
        )
    size = abs(values[entry]) or unit
    return _Named(name, values[entry], size, field, entry=entry, values=values)


def _find_in_effect(model: Model, actives: list[Active], name: str) -> _Named:
    """Find a parameter of an effect by a name such as ``profile_error@sp:order=3,cos``.

    ``actives`` is edited in place: an effect that the gear lacks is appended, and parameters of
    the effect that are neutral are moved off their neutral value by a little.

    Args:
        model: the gear.
        actives: effects to differentiate by, those of the gear first.
        name: see the head of this module.

    Raises:
        ParameterError: an effect in another form or unknown, no such numeric parameter, an effect
            of sensors, or a name that fits more than one effect of the gear.
    """
    head, _, tail = name.partition(":")
    *given, parameter_name = (part.strip() for part in tail.split(","))
    meant = parse_effect(f"{head}:{','.join(given)}")
    effect, given_names = meant.effect, [pair.partition("=")[0].strip() for pair in given]
    known = [p.name for p in effect.parameters]
    if effect.level == "sensor" or parameter_name not in known:
        raise ParameterError(
            f"no derivative by {shown(name)}: {effect.id} has {', '.join(known)}"
            + (", and changes no motion" if effect.level == "sensor" else "")
        )
    values = parameter_values(meant)
    here = [
        i
        for i, active in enumerate(actives)
        if (active.effect, active.locus) == (effect, meant.locus)
        and all(parameter_values(active)[key] == values[key] for key in given_names)
    ]
    if len(here) > 1:
        raise ParameterError(
            f"{shown(name)} names {len(here)} effects of the gear: write values that tell them "
            f"apart before {parameter_name}"
        )
    if not here:
        here = [len(actives)]
        neutral = [
            value if p.name in given_names else zero
            for p, value, zero in zip(effect.parameters, meant.theta, effect.neutral, strict=True)
        ]
        actives.append(meant.with_theta(neutral))
    number, entry = here[0], known.index(parameter_name)
    actives[number] = _off_neutral(model, actives[number])
    value, p = actives[number].theta[entry], effect.parameters[entry]
    return _Named(name, value, _size(p, value), effect=number, entry=entry)


def _off_neutral(model: Model, active_effect: Active) -> Active:
    """Return an effect with parameters at their neutral value moved off it by a small step.

    At the neutral value the gear would get no events, powers or friction from the effect.
    """
    parameters = active_effect.effect.parameters
    if all(v != p.neutral for p, v in zip(parameters, active_effect.theta, strict=True)):
        return active_effect
    sized = [
        p.start if v == p.neutral else v
        for p, v in zip(parameters, active_effect.theta, strict=True)
    ]
    law = build_with(model.parameters, [active_effect.with_theta(sized)]).packed.law
    bends = np.any((law[1] != 1.0) | ((law[2] != 0.0) & (law[3] != 0.0)))
    small = SMALL_POWER if bends else SMALL
    pairs = zip(parameters, active_effect.theta, strict=True)
    return active_effect.with_theta(
        [v + small * _size(p, v) if v == p.neutral else v for p, v in pairs]
    )


def _size(p: Parameter, value: float) -> float:
    """Return the larger distance of start value and ``value`` from neutral, or 1 if both are 0."""
    neutral = 0.0 if p.neutral is None or not np.isfinite(p.neutral) else p.neutral
    return max(abs(p.start - neutral), abs(value - neutral)) or 1.0
