"""Plan the sensors of a rig before anything is recorded: which effects a diagnosis would name with
a probability of 90 %, from which size on, with what they are confused below it, which run
is the most informative, and what one further sensor adds. Uses the Fisher information of the
observations that `gap` forms, about the nominal gear at the operating points, and the judge of
`gap`. Writes plan.json and plan.html.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import starmap
from typing import Annotated

from cyclopts import Parameter

from herringbone_sim.cli.gap import POINT
from herringbone_sim.cli.options import (
    Count,
    Cycles,
    File,
    Names,
    Out,
    flattened,
    names_of,
    progress,
)
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.errors import ParameterError, listed
from herringbone_sim.gap.planning.plan import Plan, plan
from herringbone_sim.gap.planning.summary import (
    effect_summaries,
    named_effects,
    place_text,
    plan_to_dict,
    sensors_text,
)
from herringbone_sim.gap.planning.synthetic import SensorNoise, check_sensors
from herringbone_sim.recording.parameter_file import load_parameters
from herringbone_sim.recording.rig import POINTS
from herringbone_sim.sweeps.output import make_folder
from herringbone_sim.views.pages.plan import by_gain, size, write_plan_page

EXAMPLES = """\
python -m herringbone_sim gap plan --nominal config/rig.yaml --sensors u_s_L,u_s_R,u_c \\
    --also a_c --out plan
"""
RUNS = 5  # fit runs of a practice rig, of eight
SAMPLES = 24  # per mesh cycle
STEPS = 3  # progress steps of one plan


@flattened
@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options of a plan: the rig, its sensors and its runs."""

    nominal: Annotated[File, "parameters of the rig"]
    sensors: Annotated[Names, "channels, such as u_s_L,u_s_R,u_c"]
    noise: Annotated[
        str,
        "TEXT",
        "below the RMS of each channel, as 40dB, or by the beginning of a channel's name, as "
        "40dB,u=1e-7,F_pin=30dB (numbers: RMS in SI units)",
    ] = "40dB"
    points: Annotated[
        tuple[str, ...],
        "POINT ...",
        Parameter(consume_multiple=1),
        "operating points of the runs to fit, each as delta_T=75,K=0,T_1=300,Omega=0.95 "
        f"(default: {RUNS} quiet and violent ones)",
    ] = ()
    cycles: Annotated[Cycles, "mesh cycles of a run"] = 120
    samples: Annotated[Count, "samples of a mesh cycle"] = SAMPLES
    also: Annotated[Names, "further channels, each tried by itself"] = ()
    out: Out


def run(*, options: Options) -> int:
    """Plan the sensors, print the tables, write plan.json and plan.html; exit code 0."""
    nominal = load_parameters(options.nominal).changed(
        {"model": "full", "samples_per_cycle": options.samples}
    )
    sensors = tuple(dict.fromkeys(options.sensors))
    also = [name for name in dict.fromkeys(options.also) if name not in sensors]
    check_sensors(nominal.layout, [*sensors, *also])
    points = [point_of(text, nominal) for text in options.points] or default_points()
    noise = noise_of(options.noise)
    named = (*noise.shares, *noise.values)
    if idle := [n for n in named if not any(noise.is_of(n, s) for s in (*sensors, *also))]:
        raise ParameterError(
            f"--noise names {listed(idle)}, with which none of the channels "
            f"{listed([*sensors, *also])} begins: name one of them, or leave it out"
        )
    make_folder(options.out)
    with progress(STEPS * (1 + len(also))) as step:
        base = plan(nominal, points, sensors, noise, options.cycles, step)
        further = {
            name: plan(nominal, points, (*sensors, name), noise, options.cycles, step)
            for name in also
        }
    print(table(base))
    if further:
        print(also_table(base, further))
    content = plan_to_dict(base, points, options.cycles, further)
    file = options.out / "plan.json"
    file.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    page = write_plan_page(options.out, base, points, further, options.noise)
    print(f"written: {file}, {page}")
    return 0


def noise_of(text: str) -> SensorNoise:
    """Parse the noise of the sensors from a text such as ``40dB,u=1e-7,F_pin=30dB``.

    A value in dB is below the RMS of a channel, a number is the RMS of the noise in SI units. A
    name is the beginning of channel names; dB without a name hold for all other channels.

    Raises:
        ParameterError: another form, or a value that is not positive.
    """
    share, shares, values = 0.01, {}, {}
    for part in names_of(text):
        name, equals, value = part.rpartition("=")
        is_share = value.endswith("dB")
        try:
            number = float(value.removesuffix("dB"))
        except ValueError:
            number = float("nan")
        if not (number > 0.0 and (is_share or equals)):
            raise ParameterError(
                f"noise is 40dB for all channels, u=1e-7 [SI] or F_pin=30dB, got {part!r}: give a "
                "positive number, with dB where it is below a channel's RMS"
            )
        if not equals:
            share = 10.0 ** (-number / 20.0)
        elif is_share:
            shares[name] = 10.0 ** (-number / 20.0)
        else:
            values[name] = number
    return SensorNoise(share, shares, values)


def point_of(text: str, nominal: Parameters) -> dict[str, float]:
    """Parse an operating point such as ``delta_T=75,K=0``; values not given are the nominal ones.

    Raises:
        ParameterError: another name, or a value that is not a finite number.
    """
    point = {name: float(getattr(nominal, name)) for name in POINT}
    for part in names_of(text):
        name, _, value = part.partition("=")
        try:
            number = float(value) if name in point else float("nan")
        except ValueError:
            number = float("nan")
        if not math.isfinite(number):
            raise ParameterError(
                f"a point is delta_T=75,K=0,T_1=300,Omega=0.95, got {part!r}: give "
                f"{listed(list(POINT))} as numbers"
            )
        point[name] = number
    return point


def default_points() -> list[dict[str, float]]:
    """Operating points of the fit runs of ``rig make``, in the middle of their random ranges."""
    names = ("delta_T", "K", "T_1", "Omega")
    return [
        {n: 0.5 * (low + high) for n, (low, high) in zip(names, ranges, strict=True)}
        for ranges in POINTS[:RUNS]
    ]


def table(plan: Plan) -> str:
    """Text table, a row per effect: sizes from which it is named, and the closest other effect."""
    lines = [
        f"{sensors_text(plan)}: {', '.join(plan.observations)}, {plan.count:.0f} values",
        f"{'effect':22s}{'named from':>14s}{'(best place)':>26s}{'half of them':>14s}  "
        f"{'place':>6s}  followed best by",
    ]
    lines += [
        f"{row.effect:22s}{size(row.best, row.unit):>14s}{place_text(row.best_place):>26s}"
        f"{size(row.median, row.unit):>14s}  {row.placed_share:6.0%}  "
        f"{row.rival} (leaves {row.rival_leaves:.1%})"
        for row in effect_summaries(plan)
    ]
    if plan.not_sought:
        lines.append(f"not sought with these sensors: {', '.join(plan.not_sought)}")
    if plan.not_planned:
        lines.append(f"sought, but not planned: {', '.join(plan.not_planned)}")
    return "\n".join(lines)


def also_table(base: Plan, further: Mapping[str, Plan]) -> str:
    """Text with a line per additional sensor on its benefit, the most useful sensor first."""
    now = f"{named_effects(base)} of {len(base.effects)} effects are named at a moderate size"
    return "\n".join([f"{now}; one further sensor:", *starmap(also_line, by_gain(base, further))])


def also_line(name: str, plan: Plan, factor: float) -> str:
    """Line on one additional sensor: effects named with it, and the factor by which sizes fall."""
    fall = f"sizes fall by a factor of {factor:.2f}" if factor > 0.0 else "no sizes to compare"
    return f"  {name:10s} {named_effects(plan):3d} of {len(plan.effects)} named, {fall}"
