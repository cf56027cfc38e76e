"""Compare place and size of effects in a report with those in the label of its campaign."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.judge import HALF_90
from herringbone_sim.effects.registry import effects
from herringbone_sim.practice.cause import mesh_mask
from herringbone_sim.practice.rig_model import MESHES

Json = Mapping[str, Any]
OUTSIDE_CATALOGUE = ("none", "unknown")


def right_cause(label: Json, report: Json, truth: tuple[str, ...]) -> tuple[Json, Json] | None:
    """Return label entry and reported cause of the most probable true effect, None without one."""
    for cause in sorted(report["causes"], key=lambda c: -float(c["probability"])):
        if cause["effect"] in truth and cause["effect"] not in OUTSIDE_CATALOGUE:
            entries = [e for e in label["effects"] if e["effect"] == cause["effect"]]
            return entries[0], cause
    return None


def same_place(entry: Json, cause: Json) -> bool:
    """Return whether the channels agree (sensors), or mesh, planet, side and reported member."""
    reported, true = cause.get("locus") or {}, entry["locus"]
    if "channels" in true:
        said = (
            reported.get("channels") or _value(cause, "channels") or _value(cause, "channel") or ()
        )
        named = [said] if isinstance(said, str) else said
        return {name for channel in named for name in _expanded(channel, reported)} == set(
            true["channels"]
        )
    places = ("mesh", "planet", "side")
    same = all(str(reported.get(name, "all")) == str(true.get(name, "all")) for name in places)
    member = _value(entry, "member")
    return same and (member is None or _value(cause, "member") in (member, None))


def _expanded(name: str, place: Json) -> list[str]:
    """Return the channel, or for a quantity (x, v, F) all of its channels at a place."""
    if name not in ("x", "v", "F"):
        return [name]
    return [f"{name}_{m}" for m, inside in zip(MESHES, mesh_mask(place), strict=True) if inside]


def _value(cause: Json, name: str) -> Any:
    """Return the value of a parameter of an effect in a label or a report; None if missing.

    Args:
        cause: its ``parameters`` hold a value, or a mapping with ``value``, by name.
        name: of the parameter.
    """
    entry = (cause.get("parameters") or {}).get(name)
    return entry.get("value") if isinstance(entry, Mapping) else entry


def _interval(cause: Json, name: str) -> Sequence[float]:
    """Return the 90 % interval of a parameter in a report; empty if missing or not finite."""
    interval = ((cause.get("parameters") or {}).get(name) or {}).get("ci90") or ()
    return interval if all(map(is_number, interval)) else ()


def size_parameters(effect: str) -> dict[str, float]:
    """Return the parameters that measure the size of an effect, with their value without it.

    Empty for an effect that is not in the catalogue. A value without the effect that is infinite
    counts as 0: the size is then the parameter itself.
    """
    known = effects().get(effect)
    return {
        p.name: p.neutral if math.isfinite(p.neutral) else 0.0
        for p in (known.parameters if known else ())
        if p.neutral is not None
    }


def size_error(entry: Json, cause: Json) -> float | None:
    """Return the distance of reported from true size of an effect, over its true size.

    The true size is the distance from the values without the effect: for a gain of 1.02, 0.02.

    Args:
        entry: the effect in the label.
        cause: the same effect in the report.

    Returns:
        None if a value is missing or the true size is 0.
    """
    sizes = _sizes(entry, cause)
    if sizes is None:
        return None
    true, reported = sizes
    size = float(np.hypot.reduce(true))
    return float(np.hypot.reduce(reported - true)) / size if size > 0.0 else None


def _sizes(entry: Json, cause: Json) -> tuple[Array, Array] | None:
    """Return true and reported ``size_parameters`` (k,) minus their values without the effect.

    Arguments as in ``size_error``. None if one is missing, or the effect has none.
    """
    neutral = size_parameters(entry["effect"])
    true, reported = ([_value(record, name) for name in neutral] for record in (entry, cause))
    if not neutral or not all(map(is_number, (*true, *reported))):
        return None
    without = list(neutral.values())
    return np.subtract(true, without), np.subtract(reported, without)


def is_number(value: Any) -> bool:
    """Whether a value of a report is a finite number."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def covered(true_effect: Json, cause: Json) -> tuple[bool, ...]:
    """Return for each parameter of the size with an interval whether it holds the true value."""
    held = []
    for name in size_parameters(true_effect["effect"]):
        interval, true = _interval(cause, name), _value(true_effect, name)
        if interval and is_number(true):
            held.append(bool(interval[0] <= true <= interval[1]))
    return tuple(held)


def size_errors(
    label: Json, report: Json, relative_error: float
) -> list[tuple[float, float, float]]:
    """Return the errors of reported sizes of true effects, to fit the model error of intervals.

    Of each true effect the most probable reported cause counts if its locus is right, whether or
    not the verdict names it.

    Args:
        relative_error: model error, relative to the size, that the reported intervals include; it
            is removed from them.

    Returns:
        For each of ``size_parameters`` that has a ``ci90``: estimate minus true value, standard
        deviation from the interval, and true size of the effect: the distance of all of them
        from their values without the effect. All in the unit of the parameter.
    """
    errors = []
    for labelled in label["effects"]:
        same = [c for c in report["causes"] if c["effect"] == labelled["effect"]]
        if not same:
            continue
        cause = max(same, key=lambda c: float(c["probability"]))
        sizes = _sizes(labelled, cause)
        if sizes is None or not same_place(labelled, cause):
            continue
        true, reported = sizes
        size = float(np.hypot.reduce(true))
        included = relative_error * float(np.hypot.reduce(reported))
        names = size_parameters(labelled["effect"])
        for name, value, estimate in zip(names, true, reported, strict=True):
            if interval := _interval(cause, name):
                reported_sd = 0.5 * (interval[1] - interval[0]) / HALF_90
                variance = reported_sd**2 - included**2
                errors.append((float(estimate - value), max(variance, 0.0) ** 0.5, size))
    return errors
