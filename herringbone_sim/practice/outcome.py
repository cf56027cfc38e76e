"""Compare one report with the label of its campaign."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from herringbone_sim.diagnosis.judge import HALF_90
from herringbone_sim.errors import AnalysisError, shown
from herringbone_sim.practice.record import SAMPLES_PER_CYCLE
from herringbone_sim.practice.rig_model import MESHES

Json = Mapping[str, Any]
OUTSIDE_CATALOGUE = ("none", "unknown")
VERDICTS = (*OUTSIDE_CATALOGUE, "ambiguous")
CONFIDENT = 0.5
RELATIVE_ERROR = "relative error of a size"  # key in case.json: included in report intervals

# Parameters that measure the size of an effect, and their value without the effect.
SIZES: dict[str, tuple[tuple[str, ...], float]] = {
    "mean_stiffness": (("factor",), 1.0),
    "stiffness_harmonic": (("cos", "sin"), 0.0),
    "stagger": (("phase",), 0.0),
    "planet_phase": (("phase",), 0.0),
    "tooth_crack": (("depth",), 0.0),
    "tooth_spall": (("height",), 0.0),
    "runout": (("amplitude",), 0.0),
    "pin_position": (("offset",), 0.0),
    "backlash_offset": (("offset",), 0.0),
    "thermal_backlash": (("rate",), 0.0),
    "thermal_stiffness": (("rate",), 0.0),
    "tooth_friction": (("mu",), 0.0),
    "contact_nonlinearity": (("exponent",), 1.0),
    "damping_law": (("share",), 0.0),
    "profile_error": (("cos", "sin"), 0.0),
    "ring_flexibility": (("stiffness",), 0.0),
    "bearing_clearance": (("clearance",), 0.0),
    "torque_ripple": (("amplitude",), 0.0),
    "sensor_gain": (("gain",), 1.0),
    "sensor_bias": (("bias",), 0.0),
    "sensor_delay": (("delay",), 0.0),
    "clock_drift": (("ppm",), 0.0),
}


@dataclass(frozen=True)
class Outcome:
    """A scored case; most attributes are columns of the CSV table of cases.

    Attributes:
        truth: true effects, one or two; ``kind``: none, single, pair or unknown.
        strata: d, noise, snr, law, channels, samples of a mesh cycle and regime, as text.
        first: effect with the largest probability; ``p_first``: that probability.
        right, in_class, in_three: whether the truth is first; first or in the ambiguous class;
            among the first three. Of a pair either effect counts.
        both: for a pair, whether exactly both were named.
        p_truth: probability of the truth, summed over a pair.
        brier: sum over causes of (p - truth)^2; NaN for a pair.
        p_unknown: probability of ``unknown``.
        named: whether ``none`` is neither the verdict nor in the ambiguous class.
        wrong_name: whether a wrong effect was named with a probability of 0.5 or more.
        locus: whether the locus of a true effect is right; None unless ``right`` for an effect.
        error: relative error of its size; None likewise, or without a size.
        covered: for each 90 % interval of its size, whether it contains the true value.
        closure: on held-out runs, None if the report has none.
        said: effects that the report names; without any, ``first``.
        sure: summed probability of ``said``; ``held``: whether all of ``said`` is true.
        internal: keys of the true causes in ``plan.KINDS``.
        reached: smallest detectability of the causes, infinite without any.
        name: of the campaign.
        failed: why the diagnosis ended without a report; empty if it did not.
    """

    truth: tuple[str, ...]
    kind: str
    strata: Mapping[str, str]
    first: str
    p_first: float
    right: bool
    in_class: bool
    in_three: bool
    both: bool
    p_truth: float
    brier: float
    p_unknown: float
    named: bool
    wrong_name: bool
    locus: bool | None
    error: float | None
    covered: tuple[bool, ...]
    closure: float | None
    said: tuple[str, ...]
    sure: float
    held: bool
    internal: tuple[str, ...]
    reached: float
    name: str = ""
    failed: str = ""


def outcome(label: Json, report: Json, name: str = "") -> Outcome:
    """Score a report against the label of its campaign.

    Raises:
        AnalysisError: probabilities that do not sum to 1, or a report or label that violates the
            schema.
    """
    try:
        return _outcome(label, report, name)
    except AnalysisError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise AnalysisError(
            f"a report and a label must have the entries of the schema, got {shown(error)}: write "
            "them by it"
        ) from None


def _outcome(label: Json, report: Json, name: str) -> Outcome:
    """Score a report that follows the schema."""
    p = probabilities(report)
    truth = tuple(sorted(label["truth"]))
    kind = "pair" if len(truth) > 1 else (truth[0] if truth[0] in OUTSIDE_CATALOGUE else "single")
    order = sorted(p, key=lambda name: -p[name])
    verdict = report["verdict"]
    suspects = {*report.get("ambiguous_with", ()), *report.get("effects", ())}
    ambiguous = suspects if verdict == "ambiguous" else set()
    right = order[0] in truth
    cause = _right_cause(label, report, truth)
    names = verdict not in VERDICTS
    said = tuple(report.get("effects") or ()) or (order[0],)
    return Outcome(
        truth=truth,
        kind=kind,
        strata=strata_of(label, kind),
        first=order[0],
        p_first=p[order[0]],
        right=right,
        in_class=right or bool(ambiguous & set(truth)),
        in_three=bool(set(order[:3]) & set(truth)),
        both=kind == "pair" and set(report.get("effects", ())) == set(truth),
        p_truth=sum(p.get(name, 0.0) for name in truth),
        brier=float("nan") if kind == "pair" else _brier(p, truth[0]),
        p_unknown=p.get("unknown", 0.0),
        named=verdict != "none" and "none" not in ambiguous,
        wrong_name=names and verdict not in truth and p.get(verdict, 0.0) >= CONFIDENT,
        locus=_same_place(*cause) if cause and right else None,
        error=_size_error(*cause) if cause and right else None,
        covered=_covered(*cause) if cause and right else (),
        closure=_closure(report),
        said=said,
        sure=min(sum(p.get(effect, 0.0) for effect in said), 1.0),
        held=set(said) <= set(truth),
        internal=tuple(str(entry.get("internal", entry["effect"])) for entry in label["effects"]),
        reached=min(
            (float(entry.get("d", math.inf)) for entry in label["effects"]), default=math.inf
        ),
        name=name,
        failed=str(report.get("failure", "")),
    )


def probabilities(report: Json) -> dict[str, float]:
    """Return probabilities of effects, summed over loci; AnalysisError if they don't sum to 1."""
    try:
        causes, _ = report["causes"], report["verdict"]
    except KeyError as error:
        raise AnalysisError(
            f"a report must have {error}, got {', '.join(report)}: write it by the schema"
        ) from None
    p: dict[str, float] = {}
    for cause in causes:
        p[cause["effect"]] = p.get(cause["effect"], 0.0) + float(cause["probability"])
    if not math.isclose(sum(p.values()), 1.0, abs_tol=1e-3) or min(p.values()) < 0.0:
        raise AnalysisError(
            f"the probabilities of causes must sum to 1, got {sum(p.values()):.6g}: normalise "
            "them over the catalogue, none and unknown"
        )
    return p


def strata_of(label: Json, kind: str) -> dict[str, str]:
    """Return the strata of a case by name; d is the requested one, or ``below`` it if capped."""
    capped = any(effect.get("capped") for effect in label.get("effects", ()))
    d = "none" if kind == "none" else f"{float(label.get('d_requested', 0.0)):g}"
    return {
        "d": f"below {d}" if capped else d,
        "noise": str((label.get("noise") or {}).get("kind", "white")),
        "snr": f"{float(label['snr_dB']):g} dB",
        "law": str(label.get("law", "none" if kind == "none" else "not said")),
        "channels": str(label["channels"]),
        "samples": str(label.get("samples_per_cycle", SAMPLES_PER_CYCLE)),
        "regime": str(label.get("regime", "not said")),
        "truth": kind,
    }


def _brier(p: Mapping[str, float], truth: str) -> float:
    """Return the Brier score of probabilities when one effect is true."""
    others = sum(value**2 for name, value in p.items() if name != truth)
    return others + (1.0 - p.get(truth, 0.0)) ** 2


def _right_cause(label: Json, report: Json, truth: tuple[str, ...]) -> tuple[Json, Json] | None:
    """Return label entry and reported cause of the most probable true effect, None without one."""
    for cause in sorted(report["causes"], key=lambda c: -float(c["probability"])):
        if cause["effect"] in truth and cause["effect"] not in OUTSIDE_CATALOGUE:
            entries = [e for e in label["effects"] if e["effect"] == cause["effect"]]
            return entries[0], cause
    return None


def _same_place(entry: Json, cause: Json) -> bool:
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
    mesh, planet, side = (str(place.get(part, "all")) for part in ("mesh", "planet", "side"))
    return [
        f"{name}_{m}"
        for m in MESHES
        if mesh in ("all", m[:2]) and planet in ("all", m[2]) and side in ("all", m[4])
    ]


def _value(cause: Json, name: str) -> Any:
    """Return the value of a parameter, None if it is missing."""
    entry = (cause.get("parameters") or {}).get(name)
    return entry.get("value") if isinstance(entry, Mapping) else entry


def _size_error(entry: Json, cause: Json) -> float | None:
    """Return the distance of reported from true ``SIZES`` of an effect, over its true size.

    The true size is the distance from the values without the effect: for a gain of 1.02, 0.02.

    Args:
        entry: the effect in the label.
        cause: the same effect in the report.

    Returns:
        None if a value is missing or the true size is 0.
    """
    names, neutral = SIZES.get(entry["effect"], ((), 0.0))
    true, reported = ([_value(record, name) for name in names] for record in (entry, cause))
    if not names or any(not _number(value) for value in (*true, *reported)):
        return None
    distance = float(np.hypot.reduce(np.subtract(reported, true)))
    size = float(np.hypot.reduce(np.subtract(true, neutral)))
    return distance / size if size > 0.0 else None


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _covered(true_effect: Json, cause: Json) -> tuple[bool, ...]:
    """Return for each ``SIZES`` parameter with an interval whether it contains the true value."""
    held = []
    for name in SIZES.get(true_effect["effect"], ((), 0.0))[0]:
        entry = (cause.get("parameters") or {}).get(name) or {}
        interval, true = entry.get("ci90"), _value(true_effect, name)
        if interval is not None and _number(true):
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
        For each parameter in ``SIZES`` that has a ``ci90``: estimate minus true value, standard
        deviation from the interval, and true size of the effect: the distance of all of its
        ``SIZES`` from their values without the effect. All in the unit of the parameter.
    """
    errors = []
    for labelled in label["effects"]:
        same = [c for c in report["causes"] if c["effect"] == labelled["effect"]]
        if not same or labelled["effect"] not in SIZES:
            continue
        cause = max(same, key=lambda c: float(c["probability"]))
        names, neutral = SIZES[labelled["effect"]]
        true = [_value(labelled, name) for name in names]
        if not _same_place(labelled, cause) or not all(_number(v) for v in true):
            continue
        size = float(np.hypot.reduce(np.subtract(true, neutral)))
        reported = [_value(cause, name) for name in names]
        if not all(map(_number, reported)):
            continue
        included = relative_error * float(np.hypot.reduce(np.subtract(reported, neutral)))
        for name, value, estimate in zip(names, true, reported, strict=True):
            entry = (cause.get("parameters") or {}).get(name) or {}
            interval = entry.get("ci90")
            if interval is not None and all(map(_number, interval)):
                reported_sd = 0.5 * (interval[1] - interval[0]) / HALF_90
                variance = reported_sd**2 - included**2
                errors.append((float(estimate - value), max(variance, 0.0) ** 0.5, size))
    return errors


def _closure(report: Json) -> float | None:
    value: Any = (report.get("gap") or {}).get("closure")
    return float(value) if _number(value) else None
