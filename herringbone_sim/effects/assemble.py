"""Build models with effects; no other module changes a model by effects."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace

import numpy as np

from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.gear import acting, laws
from herringbone_sim.effects.lanes.batch import LaneStepper
from herringbone_sim.effects.law_stepper import LawStepper
from herringbone_sim.effects.slots import Slots
from herringbone_sim.errors import ParameterError


def assemble(model: Model, actives: Sequence[Active]) -> Model:
    """Return the model with the given effects instead of its present ones.

    Sensor effects are left out. If no slot represents an effect, or two bend the spring force or
    the damping of one mesh, the gear is integrated by the laws of all effects, see ``by_laws``;
    slots then only give its period and the edges of events.

    Raises:
        ParameterError: a locus that the gear lacks, a mesh without the effect's member, or twice
            an effect that a gear takes once.
    """
    chosen = _acting(actives)
    if all(active.effect.fill is not None for active in chosen):
        in_core, bent_twice = _in_slots(model, chosen)
        if not bent_twice:
            return in_core
    return by_laws(model, chosen)


def by_laws(model: Model, actives: Sequence[Active]) -> Model:
    """Return the model with effects, to be integrated by their compiled laws.

    Batches of such gears run in lanes if the laws of at least one effect are written for lanes.
    ParameterError as ``assemble``.
    """
    chosen = _acting(actives)
    filled, _ = _in_slots(model, [active for active in chosen if active.effect.fill is not None])
    sizes = np.diff(laws(model, chosen).kernel.first)[: len(chosen)]
    return replace(
        filled,
        effects=tuple(chosen),
        added_sizes=tuple(zip(_state_keys(chosen), map(int, sizes), strict=True)),
        integrator=LaneStepper if any(active.effect.lanes for active in chosen) else LawStepper,
    )


def _acting(actives: Sequence[Active]) -> list[Active]:
    """Return ``acting``; ParameterError if an effect that a gear takes once is there twice."""
    chosen = acting(actives)
    for active in chosen:
        alike = [other.locus for other in chosen if other.effect.id == active.effect.id]
        places = [f"{locus.mesh}/{locus.planet}/{locus.side}" for locus in alike]
        if active.effect.once and len(places) > 1:
            raise ParameterError(
                f"{active.effect.id} must be at one place, got {' and '.join(places)}: two of "
                "them do not know of each other; choose one place that has all their meshes"
            )
    return chosen


def _in_slots(model: Model, chosen: Sequence[Active]) -> tuple[Model, bool]:
    """Return the model with effects in its slots, for the core, and ``Slots.bent_twice``.

    If that is true, two effects bend the force law of one mesh and slots hold only the last: the
    core must not integrate the model.

    Args:
        model: its present effects are dropped.
        chosen: effects as from ``acting``; each must have a ``fill``, or it is in no slot.
    """
    slots, sizes = Slots(model), []
    for active in chosen:
        before = slots.n_added_coordinates
        if active.effect.fill is not None:
            active.effect.fill(slots, active.theta, active.locus.mask(model.layout), active.chosen)
        sizes.append(2 * (slots.n_added_coordinates - before))
    filled = replace(
        model,
        packed=slots.packed() if chosen else model.bare,
        effects=tuple(chosen),
        added_sizes=tuple(zip(_state_keys(chosen), sizes, strict=True)),
        integrator=None,
    )
    return filled, slots.bent_twice


def _state_keys(actives: Sequence[Active]) -> list[Hashable]:
    """Return keys by which effects keep their states when effects change during a run.

    A key is the id, the locus, and the number of preceding effects with the same id and locus.
    """
    places = [(active.effect.id, active.locus) for active in actives]
    return [(*place, places[:i].count(place)) for i, place in enumerate(places)]


def build_with(parameters: Parameters, actives: Sequence[Active] = ()) -> Model:
    """Build the model of a parameter set with effects.

    Raises:
        ParameterError: as ``core.model.build`` and ``assemble``.
    """
    return assemble(build(parameters), actives)


def changed(model: Model, parameters: Parameters) -> Model:
    """Build a model of other parameters with the effects of ``model``.

    ParameterError as ``build_with``.
    """
    return build_with(parameters, model.effects)
