"""Classify recorded channels; sentences on what they can't decide, whatever the verdict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from herringbone_sim.core.mirror import has_equal_planets
from herringbone_sim.gap.attribution.effect_forces import FusedRun

FULL, NO_FORCE, FEW, NOTHING = "full", "no_force", "few", "nothing"
FEW_NEED_THREE_PLANETS = (
    "few sensors are diagnosed by windows of the motion, which are made for three planets: of a "
    "gear with another number record x, v and F of a mesh, or the rates of all meshes"
)


def channel_set(cases: Sequence[FusedRun]) -> str:
    """Class of the channels that all runs have: ``full``, ``no_force``, ``few`` or ``nothing``.

    Full: displacement, rate and force of at least one mesh. No force: every displacement and every
    rate, not from rotations alone. Neither if rotations lack their mean. Few: rotations or
    accelerations of both suns and the carrier, or any two of the displacements and rotations.
    """
    means = all(c.run.means_known for c in cases)
    if cases and means and all(c.usable.any() for c in cases):
        return FULL
    rotations = not means or all(c.run.rotations_alone for c in cases)
    if cases and not rotations and all(c.fused.known_meshes.all() for c in cases):
        return NO_FORCE
    if cases and all(c.run.shafts_known or motion_channels(c) >= 2 for c in cases):
        return FEW
    return NOTHING


def motion_channels(case: FusedRun) -> int:
    """Number of recorded displacements and rotations."""
    return int(case.run.u.recorded.sum() + case.run.x.recorded.sum())


def undecidable_by_channels(cases: Sequence[FusedRun]) -> list[str]:
    """Sentences on what the channels of the runs can't decide; empty if all can be used."""
    kind = channel_set(cases)
    if kind == NOTHING:
        return [
            "no motion of both suns is recorded: nothing can be said of the machine; record "
            "u_s_L, u_s_R and u_c at least"
        ]
    if kind == FULL:
        return _limits_of_partial(cases)
    no_force = (
        "no force is recorded: errors of force sensors can't be told, and the scale of all "
        "forces only from that of the inertias and the torque"
    )
    forced = any(c.run.F.recorded.any() or c.run.pin.recorded.any() for c in cases)
    limits = [] if forced else [no_force]
    if kind == NO_FORCE:
        limits.append(
            "without forces, eight accelerations answer for twelve meshes: effects on the sun "
            "and the ring mesh of one planet that balance each other, and friction against "
            "other torques on the bodies, are told by their shape over time alone"
        )
        if not all(c.run.u.recorded.any() for c in cases):
            limits.append(
                "no rotation of a body is recorded: errors of the displacement sensors are told "
                "by the rates alone, a constant one not at all"
            )
        return limits
    return [*limits, *_limits_of_few(cases)]


def _limits_of_few(cases: Sequence[FusedRun]) -> list[str]:
    """Sentences on the limits of runs with the class ``few`` of channels."""
    if cases[0].run.model.parameters.n_planets != 3:
        return [FEW_NEED_THREE_PLANETS]
    if not all(c.run.shafts_known for c in cases):
        return [
            "neither the force of a mesh beside its displacement nor the motion of both suns and "
            "the carrier is recorded: no law of the gear can be held against these channels; "
            "record u_s_L, u_s_R and u_c, or their angles, at least"
        ]
    worked_out = (
        "the rates of the bodies are worked out from their rotations"
        if all(c.run.rotations_alone for c in cases)
        else "the motion of the planets is worked out from that of the suns and the carrier"
    )
    limits = [f"{worked_out} over short windows: a clock that all channels share can't be told"]
    if planets_indistinguishable(cases):
        limits.append(
            "the planets mesh in phase and no channel belongs to one of them: what sits at one "
            "planet may sit at any other"
        )
    return limits


def planets_indistinguishable(cases: Sequence[FusedRun]) -> bool:
    """Whether neither the nominal gear nor a channel distinguishes one planet from another."""
    layout = cases[0].run.model.layout
    of_planets = [j for j, body in enumerate(layout.bodies) if body.startswith("p")]
    return all(
        has_equal_planets(run.model)
        and not any(m.recorded.any() for m in (run.x, run.v, run.F, run.pin))
        and not any(m.recorded[of_planets].any() for m in (run.u, run.a))
        for run in (case.run for case in cases)
    )


def _limits_of_partial(cases: Sequence[FusedRun]) -> list[str]:
    """A sentence on the meshes that lack displacement, rate or force in some run, if any."""
    usable = np.logical_and.reduce([c.usable for c in cases])
    if usable.all():
        return []
    names = cases[0].run.model.layout.meshes
    missing = ", ".join(n for n, there in zip(names, usable, strict=True) if not there)
    return [
        f"{missing}: displacement, rate or force is missing or was left out in some run, so what "
        "sits there alone can't be told"
    ]
