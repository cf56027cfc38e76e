"""Hypotheses of sensor errors: forces, motion, and channels to which windows are fitted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, product

import numpy as np

from herringbone_sim.core.layout import KINDS, SIDES
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.effects.effect import Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.gap.observations import consistency, torque_balance
from herringbone_sim.gap.observations.hypotheses.coefficients import CoefficientBuilder, Weights
from herringbone_sim.gap.observations.windows import trajectory
from herringbone_sim.gap.observations.windows.sensor_errors import SWAP_PREFIX
from herringbone_sim.gap.residuals.torque_balance import inertia_parts
from herringbone_sim.gap.sensors.groups import groups_of

GAIN = 0.05  # moderate error of a gain, and moderate bias over the RMS; chosen
LARGEST_GAIN = 0.95  # a gain keeps its sign
# Largest departure of the amplitude of a swap from 1. A swap is present or absent: a fractional
# amplitude would average the noise of two channels that move alike.
EXCHANGE_TOLERANCE = 1e-3


def force_sensor_errors(builder: CoefficientBuilder) -> Iterator[Hypothesis]:
    """Yield hypotheses of gain, bias, delay, clock and swap of force channels.

    Errors have opposite signs in force law and balance, and do not act in the balance on meshes
    whose force comes from the law. None are yielded with windows, see ``window_sensor_errors``.
    """
    gear = builder.gear
    if gear.uses_windows:
        return
    layout, reach = gear.model.layout, inertia_parts(gear.model).sum(0)
    measured = np.flatnonzero(~gear.modelled)
    for effect, function, signal, sign, unit in (
        ("sensor_gain", "F gain", "F", -1.0, GAIN),
        ("sensor_bias", "F bias", "constant", -1.0, GAIN * gear.rms_by_quantity.get("F", 0.0)),
        ("sensor_delay", "F delay", "slope", 1.0, 2e-6),
        ("clock_drift", "F clock", "clock", 1.0, 1e-3),
    ):
        for locus in known_effects()["sensor_gain"].candidates(layout):
            mask = locus.mask(layout) * gear.force_known
            if not mask.any():
                continue
            weights: Weights = {function: mask}
            for j in np.flatnonzero(mask * ~gear.modelled):
                name = signal if signal == "constant" else f"{signal} of {j}"
                key = (torque_balance.NAME, name)
                weights[key] = np.asarray(weights.get(key, 0.0)) + sign * reach[:, j]
            coefficient = builder.coefficient(PARAMETER_NAMES[effect], weights, unit)
            yield Hypothesis(effect, (("channels", ("F",)),), locus, (coefficient,), 1)
    for i, j in combinations(measured, 2):
        weights = {}
        on_i, on_j = np.zeros(layout.n_mesh), np.zeros(layout.n_mesh)
        on_i[i], on_j[j] = 1.0, 1.0
        weights[f"F of {j}"] = on_i - on_j
        weights[f"F of {i}"] = on_j - on_i
        apart = -(reach[:, i] - reach[:, j])
        weights[torque_balance.NAME, f"F of {i}"] = apart
        weights[torque_balance.NAME, f"F of {j}"] = -apart
        names = (f"F_{layout.meshes[i]}", f"F_{layout.meshes[j]}")
        yield _swap(builder, weights, names)


def motion_sensor_errors(builder: CoefficientBuilder) -> Iterator[Hypothesis]:
    """Yield hypotheses of gain, bias, delay and clock of groups of x, v and u, and of a swap.

    Columns are in the consistency observation alone; none are yielded where it has no rows.
    """
    gear = builder.gear
    if not gear.n_relations:
        return
    groups = groups_of(gear.model.layout, gear.recorded_motion)
    for kind, effect in zip(consistency.ERROR_KINDS, PARAMETER_NAMES, strict=True):
        for group in groups:
            if group.quantity not in gear.rms_by_quantity:
                continue
            scale = {
                "gain": GAIN,
                "bias": GAIN * gear.rms_by_quantity[group.quantity],
                "delay": 2e-6,
                "clock": 1e-3,
            }[kind]
            weights: Weights = {(consistency.NAME, f"{kind} of {n}"): 1.0 for n in group.names}
            coefficient = builder.coefficient(PARAMETER_NAMES[effect], weights, scale)
            locus = Locus(
                group.kind if group.kind in ("sp", "rp") else "all", group.planet, group.side
            )
            yield Hypothesis(
                effect,
                (("channels", group.names),),
                locus,
                (coefficient,),
                1,
                partly_screened=True,
            )
    if gear.swap is not None:
        yield _swap(builder, {(consistency.NAME, "swap"): 1.0}, gear.swap, partly_screened=True)


def window_sensor_errors(builder: CoefficientBuilder) -> Iterator[Hypothesis]:
    """Yield hypotheses of errors of the channels to which windows are fitted.

    None without windows. Gain and delay of each channel; bias of those whose mean is recorded (not
    of accelerometers); clock of channels that may share a recorder; swap of each pair of one kind.
    """
    gear = builder.gear
    if not gear.uses_windows:
        return
    followed = gear.followed_channels
    for name in followed:
        quantity = name.partition("_")[0]
        locus = _locus_of(name)
        units = {"gain": GAIN, "delay": 2e-6}
        if quantity == "F" or (quantity == "u" and name not in gear.runs[0].run.detrended):
            alike = "pin" if name.startswith("F_pin") else quantity
            units["bias"] = GAIN * gear.rms_by_quantity[alike]
        for error, unit in units.items():
            weights: Weights = {(trajectory.NAME, f"{error} of {name}"): 1.0}
            effect = f"sensor_{error}"
            bound = LARGEST_GAIN if error == "gain" else np.inf
            coefficient = builder.coefficient(PARAMETER_NAMES[effect], weights, unit, bound)
            yield Hypothesis(effect, (("channels", (name,)),), locus, (coefficient,), 1)
    for locus, names in _recorders(followed):
        coefficient = builder.coefficient(
            "ppm", {(trajectory.NAME, f"clock of {name}"): 1.0 for name in names}, 1e-3
        )
        yield Hypothesis("clock_drift", (("channels", names),), locus, (coefficient,), 1)
    for f in gear.functions[trajectory.NAME]:
        if f.startswith(SWAP_PREFIX):
            pair = tuple(f.removeprefix(SWAP_PREFIX).split(" and "))
            yield _swap(builder, {(trajectory.NAME, f): 1.0}, pair)


def _swap(
    builder: CoefficientBuilder,
    weights: Weights,
    names: tuple[str, ...],
    partly_screened: bool = False,
) -> Hypothesis:
    """Hypothesis that channels ``names`` are swapped, which acts by ``weights``."""
    coefficient = builder.coefficient("swap", weights, EXCHANGE_TOLERANCE, EXCHANGE_TOLERANCE, 1.0)
    return Hypothesis(
        "channel_swap",
        (("channels", names),),
        Locus(),
        (coefficient,),
        1,
        partly_screened=partly_screened,
    )


def _recorders(names: Sequence[str]) -> Iterator[tuple[Locus, tuple[str, ...]]]:
    """Locus and names of channels of one quantity that may have a common clock, but not of all."""
    loci: dict[tuple[str, ...], Locus] = {}
    quantities = dict.fromkeys(name[0] for name in names)
    for quantity, mesh, side in product(quantities, ("all", *KINDS), ("all", *SIDES)):
        inside = tuple(
            name
            for name in names
            if name[0] == quantity
            and mesh in ("all", _locus_of(name).mesh)
            and side in ("all", _locus_of(name).side)
        )
        if inside and len(inside) < len(names):
            loci.setdefault(inside, Locus(mesh, "all", side))
    return ((locus, inside) for inside, locus in loci.items())


def _locus_of(channel: str) -> Locus:
    """Kind of mesh, planet and side that a channel belongs to, ``all`` for none."""
    kind = next((kind for kind in KINDS if channel[2:4] == kind), "all")
    planet = "".join(filter(str.isdigit, channel)) or "all"
    side = next((side for side in SIDES if channel.endswith(f"_{side}")), "all")
    return Locus(kind, planet, side)


# Name of the parameter of each effect, as in the catalogue.
PARAMETER_NAMES = {
    "sensor_gain": "gain",
    "sensor_bias": "bias",
    "sensor_delay": "delay",
    "clock_drift": "ppm",
}
