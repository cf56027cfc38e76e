"""Effects as they are written down: ``{effect, locus, parameters}`` in a file, JSON in a text."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from herringbone_sim.effects.effect import Active, Locus, active
from herringbone_sim.effects.registry import effect
from herringbone_sim.errors import ParameterError

FORM = (
    "write a list of {effect: ID, locus: {mesh: .., planet: .., side: ..}, parameters: {..}}, "
    "or the same as a JSON text"
)


def read_effects(content: Any) -> tuple[Active, ...]:
    """Active effects of a list of mappings, or of a JSON text of one; nothing is no effect.

    Raises:
        ParameterError: another form, or an effect, a locus or a value that there is not.
    """
    if isinstance(content, str):
        try:
            content = json.loads(content) if content.strip() else []
        except json.JSONDecodeError as error:
            raise ParameterError(
                f"effects must be JSON, got {content!r} ({error}): {FORM}"
            ) from None
    if content is None:
        return ()
    if not isinstance(content, list):
        raise ParameterError(f"effects must be a list, got {content!r}: {FORM}")
    return tuple(_read(entry) for entry in content)


def _read(entry: Any) -> Active:
    if not isinstance(entry, Mapping) or "effect" not in entry:
        raise ParameterError(f"an effect must be a mapping with its id, got {entry!r}: {FORM}")
    strangers = set(entry) - {"effect", "locus", "parameters"}
    if strangers:
        raise ParameterError(f"an effect has no {', '.join(sorted(strangers))}: {FORM}")
    locus, values = entry.get("locus") or {}, entry.get("parameters") or {}
    if not isinstance(locus, Mapping) or not isinstance(values, Mapping):
        raise ParameterError(f"locus and parameters must be mappings, got {entry!r}: {FORM}")
    odd = set(locus) - {"mesh", "planet", "side"}
    if odd:
        raise ParameterError(f"a locus has no {', '.join(sorted(odd))}: {FORM}")
    place = Locus(**{part: str(name) for part, name in locus.items()})
    return active(effect(str(entry["effect"])), place, values)


def write_effects(actives: Sequence[Active]) -> list[dict[str, Any]]:
    """Plain mappings for YAML and JSON: the inverse of ``read_effects``."""
    return [
        {
            "effect": one.effect.id,
            "locus": vars(one.locus).copy(),
            "parameters": parameter_values(one),
        }
        for one in actives
    ]


def parameter_values(one: Active) -> dict[str, Any]:
    """Parameters and options of an effect by name."""
    numbers = {p.name: value for p, value in zip(one.effect.parameters, one.theta, strict=True)}
    options = {k: list(v) if isinstance(v, tuple) else v for k, v in one.chosen.items()}
    return numbers | options


def effects_text(actives: Sequence[Active]) -> str:
    """JSON of active effects in one line: the form that ROS takes as a text."""
    return json.dumps(write_effects(actives)) if actives else ""
