"""Parameter files in the format of ROS 2: ``NODE: {ros__parameters: {NAME: VALUE}}``.

Numbers are read as ROS reads them (``1e-4`` is a number); an integer is accepted for a double. A
file may also contain ``effects``: as a string, as ROS requires, or as a list.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from herringbone_sim.core.parameters import (
    Parameters,
    from_mapping,
    meaning,
    names,
    to_mapping,
)
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.written import effects_text, read_effects
from herringbone_sim.errors import ParameterError, shown
from herringbone_sim.recording.safe_yaml import YamlError, read_yaml

EFFECTS = "effects"
NODE = "herringbone_sim"
_FORM = f"write '/**:' or '{NODE}:', under it 'ros__parameters:', under it 'name: value'"
_OFTEN = 1e-3, 1e6  # magnitudes that are written without an exponent


class _Quoting(yaml.SafeDumper):
    """YAML dumper that quotes every string: parsers differ on whether 1e5 or on is a string."""


_Quoting.add_representer(
    str, lambda dumper, text: dumper.represent_scalar("tag:yaml.org,2002:str", text, style='"')
)


def load_parameters(path: Path | str) -> Parameters:
    """Read the parameters of a nominal gear; parameters that the file omits have their defaults.

    Raises:
        ParameterError: no such file, an invalid format, an unknown name, values that no gear can
            have, or effects in the file; the message begins with the file.
    """
    parameters, actives = load_gear(path)
    if actives:
        raise ParameterError(
            f"{path}: the gear has effects ({', '.join(active.effect.id for active in actives)}), "
            "and a nominal gear is meant, which has none: leave them out of the file"
        )
    return parameters


def load_gear(path: Path | str) -> tuple[Parameters, tuple[Active, ...]]:
    """Read the parameters and the active effects of a gear from a file.

    Parameters that the file omits have their defaults; without ``effects`` there are none.

    Raises:
        ParameterError: no such file, an invalid format, an unknown name, values that no gear can
            have, or an invalid effect; the message begins with the file.
    """
    values = read_values(Path(path))
    try:
        return gear_of_values(values)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None


def gear_parts(
    gear: Parameters | Path | str | None, effects: str | None = None
) -> tuple[Parameters, tuple[Active, ...]]:
    """Return the parameters and the active effects of a gear.

    Args:
        gear: parameters, a parameter file, or None for Tables 1 and 2 of the paper.
        effects: text such as ``runout@rp:amplitude=2e-5,member=ring`` that replaces the effects
            of the file; None for those of the file.

    Raises:
        ParameterError: no such file, a value out of range, or no such effect.
    """
    gear = Parameters() if gear is None else gear
    parameters, of_file = (gear, ()) if isinstance(gear, Parameters) else load_gear(gear)
    return parameters, of_file if effects is None else read_effects(effects)


def gear_of_values(values: Mapping[str, Any]) -> tuple[Parameters, tuple[Active, ...]]:
    """Make parameters and active effects from values by name, as in files and recordings.

    Raises:
        ParameterError: an unknown name, values that no gear can have, or an invalid effect.
    """
    of_model = {name: value for name, value in values.items() if name != EFFECTS}
    return from_mapping(of_model), read_effects(values.get(EFFECTS))


def values_of_gear(parameters: Parameters, actives: Sequence[Active] = ()) -> dict[str, Any]:
    """Return parameters and effects as values by name for JSON, inverse to ``gear_of_values``.

    There is no ``effects`` key if ``actives`` is empty.
    """
    effects = {EFFECTS: effects_text(actives)} if actives else {}
    return to_mapping(parameters) | effects


def ros_text(path: Path | str) -> str:
    """Return a parameter file as YAML that ROS accepts: effects as a string, no empty lists.

    Raises:
        ParameterError: no such file, an invalid format, or an invalid effect.
    """
    values = read_values(Path(path))
    try:
        if EFFECTS in values:
            values[EFFECTS] = effects_text(read_effects(values[EFFECTS]))
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None
    parameters = {n: value for n, value in values.items() if value is not None and value != []}
    document = {"/**": {"ros__parameters": parameters}}
    return str(yaml.dump(document, Dumper=_Quoting, sort_keys=False, width=math.inf))


def save_parameters(
    path: Path | str, parameters: Parameters, title: str = "", actives: Sequence[Active] = ()
) -> None:
    """Write a file with every parameter, its unit and its meaning; raises OSError.

    Args:
        title: text for comment lines at the head of the file.
        actives: effects of the gear.
    """
    Path(path).write_text(parameter_text(parameters, title, actives), encoding="utf-8")


def parameter_text(parameters: Parameters, title: str = "", actives: Sequence[Active] = ()) -> str:
    """Return the text of a file with every parameter, its unit and its meaning.

    ROS can't type an empty list: an empty ``planet_angle`` is omitted, and an empty series of
    harmonics is written as one of amplitude zero.
    """
    head = [f"# {line}".rstrip() for line in title.splitlines()]
    body = [_line(name, getattr(parameters, name)) for name in names()]
    if actives:
        body.append(f"    {EFFECTS}: '{effects_text(actives)}'")
    return "\n".join([*head, "/**:", "  ros__parameters:", *body]) + "\n"


def _line(name: str, value: Any) -> str:
    """Return the line of one parameter, with unit and meaning as a comment."""
    about = meaning(name)
    comment = f"# [{about.unit}] {about.text}{'; live' if about.live else ''}"
    if value == () and getattr(Parameters, name) == ():
        return f"    # {name}: left out {comment}"
    return f"    {name}: {_text((0.0,) if value == () else value)}  {comment}"


def _text(value: Any) -> str:
    """Return the YAML text of a value; a float is read back as the same float."""
    if isinstance(value, tuple):
        return f"[{', '.join(_text(entry) for entry in value)}]"
    if not isinstance(value, float):
        return str(value)
    if value == 0.0 or _OFTEN[0] <= abs(value) < _OFTEN[1]:
        return repr(float(value))
    return next(text for n in range(1, 18) if float(text := f"{value:.{n}e}") == value)


def read_values(path: Path) -> dict[str, Any]:
    """Read names and values of a file; ParameterError with a message that begins with the file."""
    try:
        return _values(read_yaml(path))
    except OSError as error:
        raise ParameterError(f"{path}: {error.strerror}: give a parameter file") from None
    except YamlError as error:
        raise ParameterError(f"{path}: {error}: {_FORM}") from None
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None


def _values(document: Mapping[Any, Any]) -> dict[str, Any]:
    """Return names and values of a parsed parameter file, all its sections merged.

    A section is named after the node or by a wildcard (``*``, ``**``), in any namespace. Where a
    name recurs, the last section counts. Names and values themselves are not checked.

    Raises:
        ParameterError: a section of another node, or one that does not hold ``ros__parameters``
            alone with names and values.
    """
    values: dict[str, Any] = {}
    for node, content in document.items():
        if str(node).rsplit("/", 1)[-1] not in (NODE, "*", "**"):
            raise ParameterError(f"{shown(node)} is not this node: {_FORM}")
        if not isinstance(content, dict) or list(content) != ["ros__parameters"]:
            raise ParameterError(f"{shown(node)} must hold ros__parameters alone: {_FORM}")
        inner = content["ros__parameters"]
        if not isinstance(inner, dict) or not all(isinstance(key, str) for key in inner):
            raise ParameterError(f"ros__parameters must hold names and values: {_FORM}")
        values |= inner
    return values
