"""Choose the operating point to run next, with the reason as text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.verdict.candidate_points import rounded, value_ranges
from herringbone_sim.gap.verdict.decide import Verdict
from herringbone_sim.gap.verdict.effect_texts import effect_names, in_words
from herringbone_sim.gap.verdict.experiment_design import Design, leading_explanations
from herringbone_sim.gap.verdict.undecidable import LEAST_VALUES

POINT = ("delta_T", "K", "T_1", "Omega")
WORDS = {"delta_T": ("temperature rise", " K"), "T_1": ("load", " N m"), "Omega": ("speed", "")}


@dataclass(frozen=True)
class NextExperiment:
    """Operating point to run next.

    Attributes:
        point: delta_T [K], K, T_1 [N m] and Omega by name.
        why: reason, without a full stop.
    """

    point: Mapping[str, float]
    why: str


def next_experiment(
    campaign: PreparedCampaign, verdict: Verdict, design: Design | None = None
) -> NextExperiment:
    """Choose the operating point to run next.

    The designed point where it separates the leading explanations, else one with values of
    temperature, torque and speed that no fit run has.

    Args:
        campaign: whose fit runs the verdict rests on.
        verdict: of the campaign.
        design: designed point; None where explanations can't be predicted.
    """
    if design is not None and (design.separated_so_far or design.separated_with_point):
        return NextExperiment(design.point, _why_designed(design))
    points = [run.point for run in campaign.of_role("fit")]
    values = {n: sorted({round(float(p[n]), 6) for p in points if n in p}) for n in LEAST_VALUES}
    ranges = value_ranges(points)
    chosen = {n: _new_value(n, values[n], ranges[n]) for n in LEAST_VALUES}
    new = f"no {in_words([text for _, text in chosen.values()], ' or ')} has been run"
    point = {name: 0.0 if name == "K" else chosen[name][0] for name in POINT}
    return NextExperiment(point, f"{_why_not_designed(verdict, design)}: {new}")


def _why_designed(design: Design) -> str:
    """Text on why the designed point is proposed."""
    first, *others = design.names
    if design.separated_so_far:
        text = f"checks that it is {first} and not {in_words(others)}"
    elif len(others) == 1:
        text = f"tells {first} from {others[0]}"
    else:
        text = f"tells {in_words(design.names)} apart"
    text += (
        f": what one leaves of the other is {design.separation_at_point:.2g} times the noise "
        f"floor there, {design.separation_so_far:.2g} times in the runs so far"
    )
    if design.force_ratio > 1.0:
        text += f"; the largest mesh force there is {design.force_ratio:.1f} times theirs"
    return text


def _why_not_designed(verdict: Verdict, design: Design | None) -> str:
    """Text on why no designed point is proposed."""
    if design is not None:
        return (
            f"no operating point in reach tells {in_words(design.names)} apart "
            f"({design.separation_at_point:.2g} times the noise floor at best, "
            f"{design.separation_so_far:.2g} times in the runs so far); this one is where nothing "
            "has been run"
        )
    if verdict.verdict == "none":
        return "nothing was found; this point is where nothing has been run"
    if verdict.unobserved:
        return "these channels allow no diagnosis; this point is where nothing has been run"
    if verdict.verdict == "unknown":
        return (
            "no effect explains the gap, so no point can be worked out; where nothing has been "
            "run, how the gap goes with load, temperature and speed shows"
        )
    names = [effect_names(option.actives) for option in leading_explanations(verdict)]
    if len(names) < 2:
        return "no other effect is left to tell it from; this point is where nothing has been run"
    return (
        f"where {in_words(names)} differ most was not worked out; this point is where nothing has "
        "been run"
    )


def _new_value(name: str, values: list[float], span: tuple[float, float]) -> tuple[float, str]:
    """A new value of a quantity, and text for the range of it that has not been run.

    The middle of the widest gap between the sorted ``values`` of the fit runs, or the upper end of
    ``span`` where there are fewer than two.
    """
    word, unit = WORDS[name]
    if not values:
        return rounded(name, span[1]), f"{word} that the campaign names"
    if len(values) == 1:
        return rounded(name, span[1]), f"{word} but {values[0]:g}{unit}"
    i = int(np.argmax(np.diff(values)))
    low, high = values[i], values[i + 1]
    return (
        rounded(name, 0.5 * (low + high)),
        f"{word} between {low:g} and {high:g}{unit}",
    )
