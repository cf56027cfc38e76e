"""What a recording, or a parameter file, tells of the gear: scales, backlash, model exponent."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from herringbone_sim.analysis.pipeline import Gear
from herringbone_sim.analysis.sections import Section
from herringbone_sim.analysis.segments import FREQUENCY
from herringbone_sim.core.integrate import largest_exponent
from herringbone_sim.core.model import Model, build, initial_state, state
from herringbone_sim.core.parameters import Parameters, ParameterWarning, from_mapping, names
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.stepper import stepper
from herringbone_sim.errors import DivergenceError, ParameterError
from herringbone_sim.recording.parameter_file import EFFECTS

LEAST_CYCLES, MOST_CYCLES, ALIGNING_CYCLES = 100, 600, 20
FROM_POINT = ("K", "delta_T", "T_1", "xi", "control_phase")


Sets = Sequence[tuple[Active, ...]]


def gear_of(parameters: Mapping[str, Any], with_model: bool, sets: Sets = ((),)) -> Gear:
    """Gear of a parameter set; an empty set is an unknown gear.

    Args:
        parameters: by name; names that the model does not know are left out.
        with_model: whether to work out the model's own exponent too.
        sets: of effects that the gear had in turn; ``effects`` of a point is the number of one.

    Raises:
        ParameterError: a set that no gear can have.
    """
    known = {name: value for name, value in parameters.items() if name in names()}
    if not known:
        return Gear()
    with warnings.catch_warnings():
        # The run was recorded all the same: whether such a gear can be built is not the question.
        warnings.simplefilter("ignore", ParameterWarning)
        p = from_mapping(known)
        model = build(p)
    return Gear(
        b_c_m=model.scales.b_c,
        omega_n=model.scales.omega_n,
        base={name: float(getattr(p, name)) for name in FROM_POINT}
        | ({EFFECTS: 0.0} if any(sets) else {}),
        half_backlash_m=lambda point: _half_backlash(p, point),
        model_exponent=(lambda point, section: _exponent(p, sets, point, section))
        if with_model
        else None,
    )


def model_at(p: Parameters, point: Mapping[str, float]) -> Model:
    """Model at an operating point of the analysis: its parameters and its mesh frequency."""
    values = {name: point[name] for name in FROM_POINT if np.isfinite(point.get(name, np.nan))}
    model = build(p.changed(values))
    Omega = 2 * np.pi * point[FREQUENCY] / model.scales.omega_n
    return build(model.parameters.changed({"Omega": Omega}))


def _half_backlash(p: Parameters, point: Mapping[str, float]) -> dict[str, float] | None:
    try:
        half = model_at(p, point).half_backlash_m
    except ParameterError:
        return None
    return {"sp": float(half[0]), "rp": float(half[len(half) // 2])}


def _exponent(
    p: Parameters, sets: Sets, point: Mapping[str, float], section: Section
) -> tuple[float, float]:
    """Largest exponent per tau and its error over the recorded stretch; NaN when it fails.

    From the first recorded state, over as many cycles: of several motions at one operating point
    it is then the recorded one, and a chaos that dies out is measured while it lives.
    """
    try:
        model = model_at(p, point)
        y = _recorded_state(model, section)
        cycles = int(np.clip(len(section) - ALIGNING_CYCLES, LEAST_CYCLES, MOST_CYCLES))
        machine = stepper(model, sets[int(point.get(EFFECTS, 0.0))])
        start = machine.start()
        y = np.concatenate([y, start.y[len(y) :]])  # own states of effects begin at rest
        start = replace(start, y=y, cycle=int(section.cycles[0]))
        return largest_exponent(machine.model, cycles, ALIGNING_CYCLES, start)
    except (ParameterError, DivergenceError):
        return float("nan"), float("nan")


def _recorded_state(model: Model, section: Section) -> Any:
    """First section point as a state of the model; its own initial state for other meshes."""
    if section.meshes != model.layout.meshes or section.phase != 0.0:
        return initial_state(model)
    scales = model.scales
    return state(
        model, section.x[0] / scales.b_c, section.v[0] / scales.velocity_m_per_s, section.phase
    )
