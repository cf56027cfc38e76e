"""Parts that move by themselves, driven by the meshes: a ring on its spring, a loose pin.

Their displacement follows from the recorded motion by their own equation, see ``seat_motion``; its
parameters are coefficients like any other, about those of the best point of a grid.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model
from herringbone_sim.diagnosis.search import Hypothesis
from herringbone_sim.effects.effect import Locus
from herringbone_sim.gap.observations import balance
from herringbone_sim.gap.observations.basis import Function
from herringbone_sim.gap.observations.coefficients import CoefficientBuilder, Weights
from herringbone_sim.gap.observations.gear import Gear
from herringbone_sim.gap.observations.law import (
    Displacements,
    Law,
    LawChange,
    MeshMotion,
    law,
    select_meshes,
)
from herringbone_sim.gap.observations.seat_motion import MeshLoads, SeatSpring, motion

Array = NDArray[np.float64]

MAX_LOG_OFFSET = np.log(30.0)  # a parameter is sought within one and a half decades of the grid
PRIOR_LOG_SD = 1.0  # prior of the logarithm of a parameter about that of the grid
PRESENCE_SD = 1e-9  # prior of the amplitude of what is there or not: no data outweigh it
DIFFERENCE_STEP = 1e-3  # of a parameter, for derivatives
SEAT_PARAMETERS: Mapping[str, tuple[str, ...]] = {
    "ring_flexibility": ("stiffness", "damping", "growth", "drag"),
    "bearing_clearance": ("clearance", "stiffness", "damping", "softness", "growth"),
}


@dataclass(frozen=True)
class Seat:
    """A part that moves by itself.

    Attributes:
        effect, locus: as in the catalogue.
        theta: parameters as in ``PARAMETERS``: stiffness [N/m], damping ratio, clearance [m],
            growth of the stiffness at the deflection by the load, drag at its rate, softness over
            the clearance.
        load: largest force on it as if it were rigid [N].
        removes: squares that it removes.
        known_mean: values of all coefficients known before it, at which it removes them.
    """

    effect: str
    locus: Locus
    theta: tuple[float, ...]
    load: float = 1e5
    measured_gain: float = 0.0
    base_mean: tuple[float, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Of its parameters."""
        return SEAT_PARAMETERS[self.effect]

    def at(self, offsets: Array) -> Seat:
        """The same with parameters times e^offset, as far as they reach."""
        factors = np.exp(
            np.clip(offsets, -MAX_LOG_OFFSET - DIFFERENCE_STEP, MAX_LOG_OFFSET + DIFFERENCE_STEP)
        )
        return replace(self, theta=tuple((np.array(self.theta) * factors).tolist()))

    def functions(self, gear: Gear, label: str) -> tuple[Function, ...]:
        """What it does to its meshes, per unit of its amplitude and of each parameter."""
        at = tuple(np.flatnonzero(self.locus.mask(gear.model.layout)).tolist())
        names = (label, *(f"{label} {name}" for name in self.names))
        found = [replace(_displacement(name), meshes=at) for name in names]
        if self.effect == "bearing_clearance":
            found.append(_on_carrier(gear.model, self, label))
        return tuple(found)

    def hypothesis(self, builder: CoefficientBuilder, label: str) -> Hypothesis:
        """With its coefficients."""
        model = builder.gear.model
        mask = self.locus.mask(model.layout)
        weights: Weights = {label: mask}
        if self.effect == "bearing_clearance":
            push = np.zeros(len(model.layout.bodies))
            push[2] = 1.0
            weights[balance.NAME, f"{label} carrier"] = balance.accelerations(model) @ push
            weights.update(
                dict.fromkeys([(o, f"{label} carrier") for o in builder.window_observation], 1.0)
            )
        every = [builder.coefficient("present", weights, PRESENCE_SD, center=1.0)]
        every += [
            builder.coefficient(n, {f"{label} {n}": mask}, PRIOR_LOG_SD, MAX_LOG_OFFSET)
            for n in self.names
        ]
        every = [replace(c, scales_with_effect=False) for c in every]
        options = tuple(zip(self.names, self.theta, strict=True))
        return Hypothesis(
            self.effect,
            options,
            self.locus,
            tuple(every),
            len(every),
            self,
            self.measured_gain,
            self.base_mean,
        )

    def displacements(
        self,
        model: Model,
        m: MeshMotion,
        change: LawChange,
        label: str,
        offsets: Array,
        slopes: bool,
    ) -> Displacements:
        """What each of its functions stands for, by name; see ``changes.Part``."""
        drive = PartDrive(model, self.locus, self.effect, m, change)
        now = drive.motion(self.at(offsets))
        found = {label: now}
        for i, name in enumerate(self.names if slopes else ()):
            more = offsets + DIFFERENCE_STEP * (np.arange(len(offsets)) == i)
            found[f"{label} {name}"] = (drive.motion(self.at(more)) - now) / DIFFERENCE_STEP
        reach = -model.scales.cos_beta * drive.share
        return {name: (q[:, :, 0] @ reach, q[:, :, 1] @ reach) for name, q in found.items()}


def _displacement(name: str) -> Function:
    return Function(
        name,
        "d",
        lambda _, law: law.displacements[name][0],
        lambda _, law: law.displacements[name][1],
    )


def _on_carrier(model: Model, seat: Seat, label: str) -> Function:
    """-m w'' on the carrier [N]."""
    at, mass = pin_meshes(model, seat.locus)

    def values(m: MeshMotion, law: Law) -> Array:
        rate = law.displacements[label][1][:, at[0]] / -model.scales.cos_beta
        return np.asarray(-mass * np.gradient(rate, m.times))

    return Function(f"{label} carrier", "body", values)


def pin_meshes(model: Model, locus: Locus) -> tuple[list[int], float]:
    """Meshes of a pin, and its mass [kg]; half of it where one side is free alone."""
    at = np.flatnonzero(locus.mask(model.layout)).tolist()
    return at, model.parameters.m_p * len(at) / 4.0


class PartDrive:
    """What drives a part on one run.

    Attributes:
        share: (k, n_mesh) meshes of each of its k coordinates: sides of a ring, or one pin.
        load: largest force on it as if it were rigid [N].
    """

    def __init__(
        self, model: Model, locus: Locus, effect: str, m: MeshMotion, change: LawChange
    ) -> None:
        self._model = model
        s, n = model.scales, model.layout.n_mesh
        mask = locus.mask(model.layout) > 0.0
        force = law(m, change).force
        rest = np.zeros(len(m.times))
        if effect == "ring_flexibility":
            side = np.arange(n) % (n // 2) // (n // 4)
            every = [mask & (np.arange(n) >= n // 2) & (side == one) for one in range(2)]
            self.share = np.array([one for one in every if one.any()], dtype=float)
            self._mass, self._under = s.M_r, np.inf
        else:
            self.share = mask[None].astype(float)
            _, self._mass = pin_meshes(model, locus)
            self._under = s.M_c - self._mass
            control = m.point["K"] * s.b_c * s.omega_n**2 * np.cos(m.phase) / s.cos_beta
            rest = s.cos_beta * force[:, ~mask].sum(axis=1) + s.M_c * control
            rest -= 2.0 * m.point["T_1"] / s.r_bs
        self.load = float(s.cos_beta * np.max(np.abs(force) @ self.share.T))
        self._meshes = [_mesh_loads(m, change, np.flatnonzero(one), rest) for one in self.share]

    def motion(self, seat: Seat) -> Array:
        """(n, k, 2) displacement [m] and rate [m/s] of its coordinates."""
        theta = dict(zip(seat.names, seat.theta, strict=True))
        stiffness, clearance = theta["stiffness"], theta.get("clearance", 0.0)
        s = self._model.scales
        deflection = seat.load / stiffness
        spring = SeatSpring(
            self._mass,
            self._under,
            stiffness,
            2.0 * theta["damping"] * np.sqrt(stiffness * self._mass),
            clearance,
            theta.get("softness", 0.0) * clearance,
            theta["growth"] / deflection**2,
            theta.get("drag", 0.0) / (deflection * s.omega_n),
            deflection,
            2.0 * deflection * s.omega_n,
        )
        return np.stack([motion(one, spring, s.cos_beta) for one in self._meshes], axis=1)


def _mesh_loads(m: MeshMotion, change: LawChange, at: NDArray[np.int64], rest: Array) -> MeshLoads:
    """Some meshes with all that changes them."""
    own, ch = select_meshes(m, change, at)

    def wide(value: Array | float) -> Array:
        return np.broadcast_to(value, own.x.shape)

    return MeshLoads(
        x=own.x + ch.d,
        v=own.v + ch.d_rate,
        k=own.k * (1.0 + wide(ch.kappa)) + own.k_m * wide(ch.mean_kappa),
        c=own.c * (1.0 + wide(ch.gamma)),
        plus=np.maximum(wide(own.b + ch.b_plus), 0.0),
        minus=np.maximum(wide(own.b + ch.b_minus), 0.0),
        extra_force=wide(ch.extra_force),
        noise=np.maximum(np.nan_to_num(own.sigma_x), 1e-15),
        rest=rest,
        step=float(m.times[1] - m.times[0]),
    )
