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
from herringbone_sim.recording.parameter_file import gear_parts

Gear = Parameters | Path | str | None


@contextmanager
def any_gear() -> Iterator[None]:
    """Context that hides the warning on gears that can't be assembled, as that of the paper."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ParameterWarning)
        yield


def model_of(gear: Gear, effects: str | None, changes: dict[str, Any] | None = None) -> Model:
    """Model of a gear with its effects and changed parameters; errors as ``gear_parts``."""
    parameters, actives = gear_parts(gear, effects)
    return build_with(parameters.changed(changes or {}), actives)
