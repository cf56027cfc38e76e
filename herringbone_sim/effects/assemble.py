"""A gear with effects, put together: the one place where effects change a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.slots import Slots
from herringbone_sim.errors import ParameterError


def acting(actives: Sequence[Active]) -> tuple[Active, ...]:
    """The effects that act on the machine; those of sensors change no motion."""
    return tuple(one for one in actives if one.effect.level != "sensor")


def in_slots(actives: Sequence[Active]) -> bool:
    """Whether the slots of the gear hold all of these effects."""
    return all(one.effect.fill is not None for one in acting(actives))


def assemble(model: Model, actives: Sequence[Active]) -> Model:
    """The gear of a model, whatever effects it had, with these.

    Raises:
        ParameterError: a locus that the gear or the effect doesn't have, or an effect with laws
            of its own, which no slot holds.
    """
    chosen = acting(actives)
    if not chosen:
        return replace(model, packed=model.bare, effects=())
    slots = Slots(model)
    for one in chosen:
        if one.effect.fill is None:
            raise ParameterError(
                f"{one.effect.id} has laws of its own, without tangents and lanes: leave it out, "
                "or take run, sweep or map, which do it"
            )
        one.effect.fill(slots, one.theta, one.locus.mask(model.layout), one.chosen)
    return replace(model, packed=slots.packed(), effects=chosen)


def build_with(parameters: Parameters, actives: Sequence[Active] = ()) -> Model:
    """The gear of a parameter set with effects.

    Raises:
        ParameterError: as ``core.model.build`` and ``assemble``.
    """
    return assemble(build(parameters), actives)


def own_coordinates(model: Model) -> list[int]:
    """How many coordinates each effect of a gear adds, in their order."""
    counts, before = [], 0
    for i in range(len(model.effects)):
        own = assemble(model, model.effects[: i + 1]).n_own
        counts.append(own - before)
        before = own
    return counts


def changed(model: Model, parameters: Parameters) -> Model:
    """The same effects on a gear of other parameters; ParameterError as ``core.model.build``."""
    return build_with(parameters, model.effects)
