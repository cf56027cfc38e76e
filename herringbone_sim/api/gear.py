"""Conversion of the ``gear`` argument of the public functions to parameters and a model."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from herringbone_sim.core.model import Model
from herringbone_sim.core.parameters import Parameters, ParameterWarning
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.written import read_effects
from herringbone_sim.recording.parameter_file import load_gear

Gear = Parameters | Path | str | None


@contextmanager
def any_gear() -> Iterator[None]:
    """Context that hides the warning on gears that can't be assembled, as that of the paper."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ParameterWarning)
        yield


def parts_of(gear: Gear, effects: str | None) -> tuple[Parameters, tuple[Active, ...]]:
    """Parameters and effects of a gear.

    Args:
        gear: parameters, a parameter file, or None for Tables 1 and 2 of the paper.
        effects: text such as ``runout@rp:amplitude=2e-5,member=ring`` that replaces the effects
            of the file; None for those of the file.

    Raises:
        ParameterError: no such file, a value out of range, or no such effect.
    """
    parameters, of_file = (Parameters(), ()) if gear is None else _given(gear)
    return parameters, of_file if effects is None else read_effects(effects)


def _given(gear: Parameters | Path | str) -> tuple[Parameters, tuple[Active, ...]]:
    return (gear, ()) if isinstance(gear, Parameters) else load_gear(gear)


def model_of(gear: Gear, effects: str | None, changes: dict[str, Any] | None = None) -> Model:
    """Model of a gear with its effects and changed parameters; errors as ``parts_of``."""
    parameters, actives = parts_of(gear, effects)
    return build_with(parameters.changed(changes or {}), actives)
