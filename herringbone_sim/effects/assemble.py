"""A gear with effects, put together: the one place where effects change a model."""

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
    """The effects that act on the machine; those of sensors change no motion."""
    return tuple(one for one in actives if one.effect.level != "sensor")


def in_slots(actives: Sequence[Active]) -> bool:
    """Whether the slots of the gear hold all of these effects."""
    return all(one.effect.fill is not None for one in acting(actives))


def assemble(model: Model, actives: Sequence[Active]) -> Model:
    """The gear of a model, whatever effects it had, with these.

    Where one of them has laws that no slot holds, the gear runs by the laws of all, see
    ``by_laws``; the slots then tell its period, and where it has edges.

    Raises:
        ParameterError: a locus that the gear or the effect doesn't have.
    """
    chosen = acting(actives)
    return _in_slots(model, chosen) if in_slots(chosen) else by_laws(model, chosen)


def by_laws(model: Model, actives: Sequence[Active]) -> Model:
    """The gear of a model with effects, run by their own laws; ParameterError as ``assemble``.

    A batch of such gears goes in lanes where one of the laws is written for them.
    """
    chosen = acting(actives)
    filled = _in_slots(model, [one for one in chosen if one.effect.fill is not None])
    sizes = np.diff(laws(model, chosen).first)[: len(chosen)]
    return replace(
        filled,
        effects=chosen,
        own=tuple(zip(_keys(chosen), map(int, sizes), strict=True)),
        integrator=LaneStepper if any(one.effect.lanes for one in chosen) else LawStepper,
    )


def _in_slots(model: Model, chosen: Sequence[Active]) -> Model:
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
        own=tuple(zip(_keys(chosen), sizes, strict=True)),
        integrator=None,
    )


def _keys(actives: Sequence[Active]) -> list[Hashable]:
    """Effect, place, and how many such ones stand before it: by that a run goes on with it."""
    places = [(one.effect.id, one.locus) for one in actives]
    return [(*place, places[:i].count(place)) for i, place in enumerate(places)]


def build_with(parameters: Parameters, actives: Sequence[Active] = ()) -> Model:
    """The gear of a parameter set with effects.

    Raises:
        ParameterError: as ``core.model.build`` and ``assemble``.
    """
    return assemble(build(parameters), actives)


def changed(model: Model, parameters: Parameters) -> Model:
    """The same effects on a gear of other parameters; ParameterError as ``core.model.build``."""
    return build_with(parameters, model.effects)
