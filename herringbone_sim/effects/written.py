"""Read and write effects: a list of mappings {effect, locus, parameters}, or a line of text.

The line is ``ID@MESH/PLANET/SIDE:NAME=VALUE,...``, several joined by ``;``. Omitted parts of the
place mean all, omitted values have their start value; several channels of a sensor are written
``channels=F_sp1_L+F_sp2_L``, none of them ``channels=``. Command line, parameter files, the node
and recordings all use it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from herringbone_sim.effects.effect import Active, Locus, active
from herringbone_sim.effects.registry import effect
from herringbone_sim.errors import ParameterError, listed, shown

FORM = (
    "write it like 'tooth_crack@sp/1/L:depth=0.3,member=sun; runout@rp:amplitude=2e-5', or as a "
    "list of {effect: ID, locus: {mesh: .., planet: .., side: ..}, parameters: {..}}"
)


def read_effects(content: Any) -> tuple[Active, ...]:
    """Return the effects of a text or a list of mappings, see above; none for None or no text.

    Raises:
        ParameterError: as ``parse_effect``.
    """
    if content is None:
        return ()
    if isinstance(content, str):
        return tuple(parse_effect(part) for part in content.split(";") if part.strip())
    if not isinstance(content, list):
        raise ParameterError(f"effects must be a text or a list, got {shown(content)}: {FORM}")
    return tuple(_read(entry) for entry in content)


def parse_effect(text: str) -> Active:
    """Return the effect of a text ``ID@MESH/PLANET/SIDE:NAME=VALUE,...``.

    Whether the gear has the place is not checked, see ``Locus.mask``.

    Raises:
        ParameterError: another form, an unknown effect, name or value, or a place where the effect
            can't act.
    """
    head, _, tail = text.partition(":")
    name, _, place = head.partition("@")
    parts = [part.strip() for part in place.split("/")] if place else []
    pairs = [part.partition("=") for part in tail.split(",") if part.strip()]
    if len(parts) > 3 or not all(parts) or not all(equals for _, equals, _ in pairs):
        raise ParameterError(
            f"an effect is ID@MESH/PLANET/SIDE:NAME=VALUE,..., got {shown(text.strip())}: {FORM}"
        )
    named_effect = effect(name.strip())
    lists = {o.name for o in named_effect.options if isinstance(o.start, tuple)}
    texts = {o.name for o in named_effect.options if isinstance(o.start, str)}
    choices = {o.name: {str(c): c for c in o.choices} for o in named_effect.options}
    values: dict[str, Any] = {}
    for key, _, value in ((k.strip(), e, v.strip()) for k, e, v in pairs):
        if key in values:
            raise ParameterError(f"{shown(key)} of {named_effect.id} stands twice: leave one out")
        plain = value if key in texts else number(value)
        single = choices.get(key, {}).get(value, plain)
        names = tuple(part.strip() for part in value.split("+")) if value else ()
        values[key] = names if key in lists else single
    return active(named_effect, Locus(*parts), values)


def number(text: str) -> float | int | str:
    """Return a text as an integer, else a float, else the text without spaces at its ends."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text.strip()


def _read(entry: Any) -> Active:
    """Return the effect of a mapping {effect, locus, parameters}; ParameterError for others."""
    if not isinstance(entry, Mapping) or "effect" not in entry:
        raise ParameterError(
            f"an effect must be a mapping with its id, got {shown(entry)}: {FORM}"
        )
    strangers = set(entry) - {"effect", "locus", "parameters"}
    if strangers:
        raise ParameterError(f"an effect has no {listed(sorted(map(str, strangers)))}: {FORM}")
    locus, values = entry.get("locus") or {}, entry.get("parameters") or {}
    if not isinstance(locus, Mapping) or not isinstance(values, Mapping):
        raise ParameterError(f"locus and parameters must be mappings, got {shown(entry)}: {FORM}")
    odd = set(locus) - {"mesh", "planet", "side"}
    if odd:
        raise ParameterError(f"a locus has no {listed(sorted(map(str, odd)))}: {FORM}")
    place = Locus(**{part: str(name) for part, name in locus.items()})
    return active(effect(str(entry["effect"])), place, values)


def parameter_values(active_effect: Active) -> dict[str, Any]:
    """Return values of all parameters and options of an effect by name, tuples as lists."""
    numbers = {
        p.name: value
        for p, value in zip(active_effect.effect.parameters, active_effect.theta, strict=True)
    }
    options = {k: list(v) if isinstance(v, tuple) else v for k, v in active_effect.chosen.items()}
    return numbers | options


def effects_text(actives: Sequence[Active]) -> str:
    """Return effects as one line of text; the inverse of ``read_effects``."""
    return "; ".join(_text(active_effect) for active_effect in actives)


def _text(active_effect: Active) -> str:
    """Return one effect as text, all its parameters and options included."""
    place = "/".join(
        (active_effect.locus.mesh, active_effect.locus.planet, active_effect.locus.side)
    )
    every = parameter_values(active_effect).items()
    # An option whose start value is an empty list is omitted if it has that value.
    empty = [o.name for o in active_effect.effect.options if o.start == ()]
    pairs = [f"{name}={_plain(v)}" for name, v in every if v != [] or name not in empty]
    return f"{active_effect.effect.id}@{place}" + (f":{','.join(pairs)}" if pairs else "")


def _plain(value: Any) -> str:
    if isinstance(value, list):
        return "+".join(map(str, value))
    return repr(float(value)) if isinstance(value, float) else str(value)
