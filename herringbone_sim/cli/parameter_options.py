"""Options ``--parameters``, ``--set`` and ``--effects``: the gear that a verb works on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from herringbone_sim.cli.options import File, flattened
from herringbone_sim.core.mirror import has_equal_halves
from herringbone_sim.core.model import Model
from herringbone_sim.core.parameters import Parameters, meaning
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.written import effects_text, number
from herringbone_sim.errors import ParameterError
from herringbone_sim.recording.parameter_file import gear_parts

UNEQUAL_HALVES = (
    "left and right of this gear are not alike: both are integrated, and there are no exponents "
    "within symmetry and across it"
)
Changes = Annotated[
    tuple[str, ...],
    "NAME=VALUE",
    "change a parameter, once or more; a list has commas: k_amp=0.25,0.1",
]
Effects = Annotated[
    str | None,
    "TEXT",
    "effects of the gear, instead of those in the file, such as "
    "'tooth_crack@sp/all/L:depth=0.3; runout@rp:amplitude=2e-5,member=ring'; '' for none",
]


@flattened
@dataclass(frozen=True, slots=True, kw_only=True)
class GearOptions:
    """Options that define the gear of a verb; ``gear_from`` loads it."""

    parameters: Annotated[
        File | None, "parameter file, such as config/paper.yaml (default: the nominal rig)"
    ] = None
    set: Changes = ()
    effects: Effects = None


def gear_from(gear: GearOptions) -> tuple[Parameters, tuple[Active, ...]]:
    """Load parameters, changed by ``--set``, and effects, of ``--effects`` or else of the file.

    Raises:
        ParameterError: no such file, name or effect, or a value out of range.
    """
    base, actives = gear_parts(gear.parameters, gear.effects)
    return base.changed(settings(gear.set)), actives


def model_from(gear: GearOptions) -> Model:
    """Build the model of the gear that the options define; ParameterError if it can't be built."""
    return build_with(*gear_from(gear))


def print_gear_notes(model: Model) -> None:
    """Print the effects of a gear, and a line if left and right differ, as then there are no
    transverse exponents."""
    if model.effects:
        print(f"with effects: {effects_text(model.effects)}")
    if not has_equal_halves(model):
        print(UNEQUAL_HALVES)


def settings(texts: Sequence[str]) -> dict[str, Any]:
    """Parse texts ``NAME=VALUE`` into values by name; the last text on a name counts.

    Raises:
        ParameterError: a text of another form, or an unknown name.
    """
    return dict(_setting(text) for text in texts)


def unswept(texts: Sequence[str], varied: Sequence[str]) -> dict[str, Any]:
    """``settings`` of ``--set``; ParameterError if they name a parameter that is varied."""
    changes = settings(texts)
    for name in varied:
        if name in changes:
            raise ParameterError(
                f"--set {name}={changes[name]} has no effect, as {name} is varied: leave one out"
            )
    return changes


def _setting(text: str) -> tuple[str, Any]:
    name, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not value:
        raise ParameterError(f"--set takes NAME=VALUE, got {text!r}: write it like delta_T=20")
    meaning(name)
    if isinstance(getattr(Parameters, name), tuple):
        return name, [number(part) for part in value.strip("[]").split(",") if part.strip()]
    return name, number(value)
