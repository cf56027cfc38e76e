"""Data of the nominal gear for the analysis of a run: scales, backlash, Lyapunov exponent."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from herringbone_sim.analysis.pipeline import GearData
from herringbone_sim.analysis.sections import Section
from herringbone_sim.analysis.segments import FREQUENCY
from herringbone_sim.core.integrate import largest_exponent
from herringbone_sim.core.model import (
    Model,
    build,
    by_kind,
    initial_state,
    state,
    with_added_states,
)
from herringbone_sim.core.parameters import Parameters, ParameterWarning, from_mapping, names
from herringbone_sim.effects.assemble import assemble
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.stepper import stepper
from herringbone_sim.errors import DivergenceError, ParameterError
from herringbone_sim.recording.parameter_file import EFFECTS
from herringbone_sim.recording.reader import ParameterChange

LEAST_CYCLES, MOST_CYCLES, ALIGNING_CYCLES = 100, 600, 20
FROM_POINT = ("K", "delta_T", "T_1", "xi", "control_phase")


Sets = Sequence[tuple[Active, ...]]


def gear_of(parameters: Mapping[str, Any], with_model: bool, sets: Sets = ((),)) -> GearData:
    """Gear data of a parameter set for the analysis of a run; an empty set gives an unknown gear.

    Args:
        parameters: by name; unknown names are ignored.
        with_model: whether to compute the largest Lyapunov exponent of the model too.
        sets: sets of effects during the run; ``effects`` of an operating point is the index of
            a set.

    Raises:
        ParameterError: no gear can have the parameters.
    """
    known = {name: value for name, value in parameters.items() if name in names()}
    if not known:
        return GearData()
    with warnings.catch_warnings():
        # The gear exists, so warnings that it is implausible do not help.
        warnings.simplefilter("ignore", ParameterWarning)
        p = from_mapping(known)
        model = build(p)
    return GearData(
        b_c_m=model.scales.b_c,
        omega_n=model.scales.omega_n,
        base={name: float(getattr(p, name)) for name in FROM_POINT}
        | ({EFFECTS: 0.0} if any(sets) else {}),
        half_backlash_m=lambda point: _half_backlash(p, sets, point),
        model_exponent=(lambda point, section: _exponent(p, sets, point, section))
        if with_model
        else None,
    )


def effect_texts(parameters: Mapping[str, Any], changes: Sequence[ParameterChange]) -> list[str]:
    """Distinct sets of effects of a run as texts, in the order in which they came into force.

    Args:
        parameters: at the start of the run, by name.
        changes: of parameters during the run.
    """
    later = [c.values[EFFECTS] for c in changes if EFFECTS in c.values]
    return list(dict.fromkeys(str(text or "") for text in (parameters.get(EFFECTS), *later)))


def numbers_of(change: ParameterChange, texts: Sequence[str]) -> Mapping[str, float]:
    """Numeric values of a change by parameter; a set of effects as its index in ``texts``."""
    numbers = {
        name: float(value)
        for name, value in change.values.items()
        if isinstance(value, (int, float)) and not isinstance(value, bool)
    }
    if EFFECTS in change.values:
        numbers[EFFECTS] = float(texts.index(str(change.values[EFFECTS] or "")))
    return numbers


def model_at(p: Parameters, point: Mapping[str, float]) -> Model:
    """Model without effects at an operating point: with its parameters and mesh frequency."""
    values = {name: point[name] for name in FROM_POINT if np.isfinite(point.get(name, np.nan))}
    model = build(p.changed(values))
    Omega = 2 * np.pi * point[FREQUENCY] / model.scales.omega_n
    return build(model.parameters.changed({"Omega": Omega}))


def _half_backlash(
    p: Parameters, sets: Sets, point: Mapping[str, float]
) -> dict[str, float] | None:
    """b' [m] of ``sp`` and ``rp`` meshes, and of each, at a point; None if no gear can have it.

    With the effects in force there; what they displace is not in x, and not in b' either.
    """
    try:
        model = assemble(model_at(p, point), sets[int(point.get(EFFECTS, 0.0))])
    except ParameterError:
        return None
    half = model.packed.b * model.scales.b_c
    return by_kind(half) | dict(zip(model.layout.meshes, half.tolist(), strict=True))


def _exponent(
    p: Parameters, sets: Sets, point: Mapping[str, float], section: Section
) -> tuple[float, float]:
    """Largest exponent per tau of the model with its effects, and its standard error; or NaN.

    The model starts from the first recorded state, so that of several coexisting motions the
    recorded one is measured, or its chaotic transient; from the initial state if a mesh is
    missing. After ``ALIGNING_CYCLES`` the other cycles of the segment count, but at least 100 and
    at most 600.
    """
    try:
        model = model_at(p, point)
        y = _recorded_state(model, section)
        cycles = int(np.clip(len(section) - ALIGNING_CYCLES, LEAST_CYCLES, MOST_CYCLES))
        gear_stepper = stepper(model, sets[int(point.get(EFFECTS, 0.0))])
        start = gear_stepper.start()
        y = with_added_states(gear_stepper.model, y)
        start = replace(start, y=y, cycle=int(section.cycles[0]))
        return largest_exponent(gear_stepper.model, cycles, ALIGNING_CYCLES, start)
    except (ParameterError, DivergenceError):
        return float("nan"), float("nan")


def _recorded_state(model: Model, section: Section) -> Any:
    """First section point as a state of the model.

    The initial state of the model if the recorded meshes are not exactly those of the model.
    """
    if section.meshes != model.layout.meshes:
        return initial_state(model)
    scales = model.scales
    return state(model, section.x[0] / scales.b_c, section.v[0] / scales.velocity_m_per_s, 0.0)
