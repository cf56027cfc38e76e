"""Put effects into a gear: the only place where effects change a model."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.gear import laws
from herringbone_sim.effects.lanes.batch import LaneStepper
from herringbone_sim.effects.law_stepper import LawStepper
from herringbone_sim.effects.slots import Slots


def acting(actives: Sequence[Active]) -> tuple[Active, ...]:
    """Effects on the gear; those of sensors are left out, as they change no motion."""
    return tuple(one for one in actives if one.effect.level != "sensor")


def in_slots(actives: Sequence[Active]) -> bool:
    """Whether the slots of the gear can represent all of these effects."""
    return all(one.effect.fill is not None for one in acting(actives))


def assemble(model: Model, actives: Sequence[Active]) -> Model:
    """Model with the given effects in place of those that it had.

    If an effect has laws that no slot represents, the gear is integrated by the laws of all
    effects, see ``by_laws``; the slots then only give its period and the edges of its events.

    Raises:
        ParameterError: a locus that the gear or the effect doesn't have.
    """
    chosen = acting(actives)
    return _in_slots(model, chosen) if in_slots(chosen) else by_laws(model, chosen)


def by_laws(model: Model, actives: Sequence[Active]) -> Model:
    """Model with effects that is integrated by their own laws; ParameterError as ``assemble``.

    Batches of such gears run in lanes if one of the laws is written for lanes.
    """
    chosen = acting(actives)
    filled = _in_slots(model, [one for one in chosen if one.effect.fill is not None])
    sizes = np.diff(laws(model, chosen).first)[: len(chosen)]
    return replace(
        filled,
        effects=chosen,
        own=tuple(zip(_state_keys(chosen), map(int, sizes), strict=True)),
        integrator=LaneStepper if any(one.effect.lanes for one in chosen) else LawStepper,
    )


def _in_slots(model: Model, chosen: Sequence[Active]) -> Model:
    """Model with the slots that effects fill."""
    slots, sizes = Slots(model), []
    for one in chosen:
        before = slots.n_own
        if one.effect.fill is not None:
            one.effect.fill(slots, one.theta, one.locus.mask(model.layout), one.chosen)
        sizes.append(2 * (slots.n_own - before))
    return replace(
        model,
        packed=slots.packed() if chosen else model.bare,
        effects=tuple(chosen),
        own=tuple(zip(_state_keys(chosen), sizes, strict=True)),
        integrator=None,
    )


def _state_keys(actives: Sequence[Active]) -> list[Hashable]:
    """Key of each effect, by which its states are kept when the effects change during a run.

    Effect id, locus, and number of effects with the same two that precede it.
    """
    places = [(one.effect.id, one.locus) for one in actives]
    return [(*place, places[:i].count(place)) for i, place in enumerate(places)]


def build_with(parameters: Parameters, actives: Sequence[Active] = ()) -> Model:
    """Model of a parameter set with effects.

    Raises:
        ParameterError: as ``core.model.build`` and ``assemble``.
    """
    return assemble(build(parameters), actives)


def changed(model: Model, parameters: Parameters) -> Model:
    """Model of other parameters with the same effects; ParameterError as ``core.model.build``."""
    return build_with(parameters, model.effects)
