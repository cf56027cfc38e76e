"""What a diagnosis leaves open, where the residual lies, and what to measure next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from herringbone_sim.gap.attribution.channel_sets import undecidable_by_channels
from herringbone_sim.gap.calibrated import Calibrated
from herringbone_sim.gap.data.prepared import PreparedCampaign
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.verdict.decide import Verdict
from herringbone_sim.gap.verdict.design import Design, leading
from herringbone_sim.gap.verdict.rivals import named
from herringbone_sim.gap.verdict.trial import DIGITS, reach

POSSIBLE = 0.1  # a probability from which a rival is named
OTHER = {
    "none": "that there is no gap beyond tolerance and noise",
    "unknown": "a cause outside the catalogue",
}
WORDS = {"delta_T": ("temperature rise", " K"), "T_1": ("load", " N m"), "Omega": ("speed", "")}
LEAST = {"delta_T": 3, "T_1": 3, "Omega": 2}


def mismatched(findings: Sequence[Finding]) -> bool:
    """Whether the nominal file is that of another rig."""
    return any(finding.what == "nominal" for finding in findings)


def undecidable(
    campaign: PreparedCampaign,
    found: Calibrated,
    verdict: Verdict,
    findings: Sequence[Finding] = (),
) -> list[str]:
    """What these data can't tell, in sentences."""
    if mismatched(findings):
        return []
    said = undecidable_by_channels(found.cases)
    points = [run.point for run in campaign.of_role("fit")]
    for name, least in LEAST.items():
        different = len({round(float(p[name]), 6) for p in points if name in p})
        if different < least:
            values = "value" if different == 1 else "values"
            said.append(
                f"{different} {values} of {name} in the fit runs, {least} or more are asked"
            )
    return [*said, *_rivals(verdict)]


def _rivals(verdict: Verdict) -> list[str]:
    """Effects that these data leave possible beside the verdict."""
    alike, chances = verdict.ambiguous_with, verdict.probabilities
    said = []
    if alike:
        odds = [f"{name} ({chances[name]:.0%})" for name in alike]
        said.append(
            f"{_listed(odds)} change the forces alike at these operating points: any of them may "
            "be the cause"
        )
    if verdict.verdict == "unknown":
        said.append("no effect of the catalogue explains the gap: what it comes from is open")
        if verdict.chosen is not None:
            said.append(f"nearest comes {named(verdict.chosen.actives)}, but it leaves too much")
    told = {*alike, *verdict.effects, verdict.verdict}
    rest = [name for name in chances if chances[name] > POSSIBLE and name not in told]
    for name in sorted(rest, key=lambda one: -chances[one]):
        said.append(f"{OTHER.get(name, name)} is not excluded: probability {chances[name]:.0%}")
    return said


def next_experiment(
    campaign: PreparedCampaign, verdict: Verdict, found: Design | None = None
) -> dict[str, Any]:
    """Operating point delta_T [K], K, T_1 [N m], Omega to run next, and why.

    Args:
        campaign: its fit runs are what is known.
        verdict: of them.
        found: point that tells the leading rivals apart; None where that can't be predicted.
    """
    if found is not None and (found.known or found.enough):
        return {**found.point, "why": _apart(found)}
    points = [run.point for run in campaign.of_role("fit")]
    values = {n: sorted({round(float(p[n]), 6) for p in points if n in p}) for n in LEAST}
    ranges = reach(points)
    chosen = {n: _lacking(n, values[n], ranges[n]) for n in LEAST}
    told = f"no {_listed([text for _, text in chosen.values()], ' or ')} has been run"
    return {
        "delta_T": chosen["delta_T"][0],
        "K": 0.0,
        "T_1": chosen["T_1"][0],
        "Omega": chosen["Omega"][0],
        "why": f"{_no_design(verdict, found)}: {told}",
    }


def _apart(found: Design) -> str:
    first, *others = found.names
    if found.known:
        text = f"checks that it is {first} and not {_listed(others)}"
    elif len(others) == 1:
        text = f"tells {first} from {others[0]}"
    else:
        text = f"tells {_listed(found.names)} apart"
    text += (
        f": what one leaves of the other is {found.there:.2g} times the noise floor there, "
        f"{found.so_far:.2g} times in the runs so far"
    )
    if found.harder > 1.0:
        text += f"; the largest mesh force there is {found.harder:.1f} times theirs"
    return text


def _no_design(verdict: Verdict, found: Design | None) -> str:
    """Why a point was not designed."""
    if found is not None:
        return (
            f"no operating point in reach tells {_listed(found.names)} apart ({found.there:.2g} "
            f"times the noise floor at best, {found.so_far:.2g} times in the runs so far); this "
            "one is where nothing has been run"
        )
    if verdict.verdict == "none":
        return "nothing was found; this point is where nothing has been run"
    if verdict.verdict == "unknown":
        return (
            "no effect explains the gap, so no point can be worked out; where nothing has been "
            "run, how the gap goes with load, temperature and speed shows"
        )
    names = [named(option.actives) for option in leading(verdict)]
    if len(names) < 2:
        return "no other effect is left to tell it from; this point is where nothing has been run"
    return (
        f"where {_listed(names)} differ most was not worked out; this point is where nothing has "
        "been run"
    )


def _lacking(name: str, values: list[float], span: tuple[float, float]) -> tuple[float, str]:
    """Middle of the widest gap between sorted values, or beyond a single one; and what is not."""
    digits, (word, unit) = DIGITS[name], WORDS[name]
    if not values:
        return round(span[1], digits), f"{word} that the campaign names"
    if len(values) == 1:
        return round(span[1], digits), f"{word} but {values[0]:g}{unit}"
    i = int(np.argmax(np.diff(values)))
    low, high = values[i], values[i + 1]
    return (
        round(0.5 * (low + high), digits),
        f"{word} between {low:g} and {high:g}{unit}",
    )


def _listed(names: Sequence[str], last: str = " and ") -> str:
    """``a, b and c``."""
    return last.join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
