"""What a set of channels can't decide, in sentences, whatever was found with it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from herringbone_sim.core.mirror import has_equal_planets
from herringbone_sim.gap.attribution.bodies import balances_known
from herringbone_sim.gap.attribution.hypothesis import Case

FEWEST_WHOLE = 2  # runs with every force and rate that a balance is left out from
FULL, NO_FORCE, FEW, NOTHING = "full", "no_force", "few", "nothing"


def channel_set(cases: Sequence[Case]) -> str:
    """``full``, ``no_force``, ``few`` or ``nothing``: the way the runs can be diagnosed.

    Full: some mesh has displacement, rate and force in every run. No force: every displacement
    and every rate. Few: some motion of both suns, by rotations, accelerations or displacements.
    """
    if cases and all(c.usable.any() for c in cases):
        return FULL
    if cases and all(
        bool(np.isfinite(c.fused.x).all() and np.isfinite(c.fused.v).all()) for c in cases
    ):
        return NO_FORCE
    if cases and all(c.run.shafts_known or motion_channels(c) >= 2 for c in cases):
        return FEW
    return NOTHING


def motion_channels(one: Case) -> int:
    """Displacements and rotations that a run has."""
    return int(one.run.u.there.sum() + one.run.x.there.sum())


def cannot_tell(cases: Sequence[Case]) -> list[str]:
    """What the channels of some runs can't decide; nothing where all are there."""
    kind = channel_set(cases)
    if kind == NOTHING:
        return [
            "no motion of both suns is recorded: nothing can be said of the machine; record "
            "u_s_L, u_s_R and u_c at least"
        ]
    if kind == FULL:
        return _partial(cases)
    no_force = (
        "no force is recorded: errors of force sensors can't be told, and the scale of all "
        "forces only from that of the inertias and the torque"
    )
    forced = any(c.run.F.there.any() or c.run.pin.there.any() for c in cases)
    said = [] if forced else [no_force]
    if kind == NO_FORCE:
        said.append(
            "without forces, eight accelerations answer for twelve meshes: effects on the sun "
            "and the ring mesh of one planet that balance each other, and friction against "
            "other torques on the bodies, are told by their shape over time alone"
        )
        if not all(c.run.u.there.any() for c in cases):
            said.append(
                "no rotation of a body is recorded: errors of the displacement sensors are told "
                "by the rates alone, a constant one not at all"
            )
        return said
    return [*said, *_few(cases)]


def _few(cases: Sequence[Case]) -> list[str]:
    if not all(c.run.shafts_known for c in cases):
        return [
            "neither the force of a mesh beside its displacement nor the motion of both suns and "
            "the carrier is recorded: no law of the gear can be held against these channels; "
            "record u_s_L, u_s_R and u_c at least, with the common rotation alone taken off (raw "
            "angles lack the wind-up under the load)"
        ]
    said = [
        "the motion of the planets is worked out from that of the suns and the carrier over short "
        "windows: a drifting clock can't be told, it comes out as unknown"
    ]
    if planets_alike(cases):
        said.append(
            "the planets mesh in phase and no channel belongs to one of them: what sits at one "
            "planet may sit at any other"
        )
    return said


def planets_alike(cases: Sequence[Case]) -> bool:
    """Whether nothing tells one planet from another: neither the nominal gear nor a channel."""
    layout = cases[0].run.model.layout
    of_planets = [j for j, body in enumerate(layout.bodies) if body.startswith("p")]
    return all(
        has_equal_planets(run.model)
        and not any(m.there.any() for m in (run.x, run.v, run.F, run.pin))
        and not any(m.there[of_planets].any() for m in (run.u, run.a))
        for run in (one.run for one in cases)
    )


def _partial(cases: Sequence[Case]) -> list[str]:
    """Meshes that some run of an otherwise full set has not got."""
    usable = np.logical_and.reduce([c.usable for c in cases])
    if usable.all():
        return []
    names = cases[0].run.model.layout.meshes
    missing = ", ".join(n for n, there in zip(names, usable, strict=True) if not there)
    said = [
        f"{missing}: displacement, rate or force is missing or was left out in some run, so what "
        "sits there alone can't be told"
    ]
    if sum(balances_known((c,)) for c in cases) < FEWEST_WHOLE:
        said.append(
            "friction and torque ripple can't be told: they need all forces and rates in "
            f"{FEWEST_WHOLE} runs or more"
        )
    return said
