"""Read the definition of a sweep from its JSON text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

from herringbone_sim.core.parameters import from_mapping
from herringbone_sim.errors import ParameterError, shown
from herringbone_sim.recording.safe_json import parse_json
from herringbone_sim.sweeps.grid import Axis, Observation, Sweep

_Made = TypeVar("_Made", Observation, Sweep)


def sweep_from_json(text: str) -> Sweep:
    """Sweep from the text of ``Sweep.to_json``.

    Raises:
        ParameterError: the text describes no sweep.
    """
    try:
        content = {"effects": ""} | parse_json(text)
        known: dict[str, Any] = {item.name: content[item.name] for item in fields(Sweep)}
        known["base"] = from_mapping(content["base"])
        known["axes"] = tuple(_axis(entry) for entry in content["axes"])
        known["observation"] = _typed(Observation(**content["observation"]))
        return _typed(Sweep(**known))
    except KeyError as error:
        raise ParameterError(f"no description of a sweep: it has no {error}") from None
    except (ValueError, TypeError, AttributeError) as error:
        raise ParameterError(f"no description of a sweep: {error}") from None


def _axis(entry: Mapping[str, Any]) -> Axis:
    """Axis from its JSON entry; TypeError unless it has a name and a list of numbers."""
    name, values = entry["name"], entry["values"]
    if not isinstance(name, str) or not isinstance(values, list):
        raise TypeError(f"an axis must have a name and a list of values, got {shown(entry)}")
    if not all(
        isinstance(value, (int, float)) and not isinstance(value, bool) for value in values
    ):
        raise TypeError(f"the values of {shown(name)} must be numbers, got {shown(values)}")
    return Axis(name, tuple(float(value) for value in values))


def _typed(made: _Made) -> _Made:
    """Return a dataclass after a check that its bool, int and str fields have these types.

    Raises:
        TypeError: a field has another type than its default.
    """
    for item in fields(made):
        kind, value = type(item.default), getattr(made, item.name)
        if kind in (bool, int, str) and type(value) is not kind:
            raise TypeError(f"{item.name} must be {kind.__name__}, got {shown(value)}")
    return made
