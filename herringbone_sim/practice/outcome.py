"""Compare one report with the label of its campaign."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from herringbone_sim.errors import AnalysisError, shown
from herringbone_sim.practice.record import SAMPLES_PER_CYCLE
from herringbone_sim.practice.true_effects import (
    OUTSIDE_CATALOGUE,
    Json,
    covered,
    is_number,
    right_cause,
    same_place,
    size_error,
)

VERDICTS = (*OUTSIDE_CATALOGUE, "ambiguous")
CONFIDENT = 0.5
RELATIVE_ERROR = "relative error of a size"  # key in case.json: included in report intervals


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
    cause = right_cause(label, report, truth)
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
        locus=same_place(*cause) if cause and right else None,
        error=size_error(*cause) if cause and right else None,
        covered=covered(*cause) if cause and right else (),
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


def _closure(report: Json) -> float | None:
    value: Any = (report.get("gap") or {}).get("closure")
    return float(value) if is_number(value) else None
