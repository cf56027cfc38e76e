"""Moving parts as hypotheses: a ring on a spring, a loose pin in its bore.

The displacement of such a part follows from the recorded motion by the equation of motion in
``moving_part_motion``. Coefficients are the logarithms of its parameters, relative to a point of a
grid.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.effects.effect import Locus
from herringbone_sim.gap.data.kinematics import forces_to_coordinates
from herringbone_sim.gap.observations import torque_balance
from herringbone_sim.gap.observations.basis import Function
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.hypotheses.coefficients import CoefficientBuilder, Weights
from herringbone_sim.gap.observations.hypotheses.moving_part_motion import (
    MeshLoads,
    SeatSpring,
    motion_with_slopes,
    motions,
)
from herringbone_sim.gap.residuals.mesh_law import (
    Displacements,
    Law,
    LawChange,
    MeshMotion,
    law,
    select_meshes,
)
from herringbone_sim.gap.residuals.torque_balance import control_wave

# Range of a parameter's logarithm about its value in the grid, 1.5 decades; chosen.
MAX_LOG_OFFSET = np.log(30.0)
PRIOR_LOG_SD = 1.0  # prior standard deviation of that logarithm; chosen
PRESENCE_SD = 1e-9  # prior standard deviation of the amplitude about 1: practically fixed
DIFFERENCE_STEP = 1e-3  # of a logarithm, for difference quotients of the properties of a seat
SEAT_PARAMETERS: Mapping[str, tuple[str, ...]] = {
    "ring_flexibility": ("stiffness", "damping", "growth", "drag"),
    "bearing_clearance": ("clearance", "stiffness", "damping", "softness", "growth", "film"),
}


@dataclass(frozen=True)
class MovingPart:
    """A moving part: a ring on springs, or a planet pin in a bore with clearance.

    Attributes:
        effect, locus: as in the catalogue.
        theta: values of ``names``: stiffness [N/m], damping ratio, clearance [m]; softness, the
            rounding of the ends of the clearance over the clearance; growth, the relative increase
            of the stiffness at the deflection ``load`` / stiffness; drag, that of the damping at
            omega_n times this deflection; film, the damping inside the clearance over that at its
            ends.
        load: largest force on the part if it were rigid [N]; a guess before evaluation.
        measured_gain: chi2 that the part removes; 0 before evaluation.
        base_mean: values of all other coefficients at ``measured_gain``.
    """

    effect: str
    locus: Locus
    theta: tuple[float, ...]
    load: float = 1e5
    measured_gain: float = 0.0
    base_mean: tuple[float, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of ``theta``."""
        return SEAT_PARAMETERS[self.effect]

    def with_log_offsets(self, offsets: Array) -> MovingPart:
        """Copy with parameters times exp(offsets) (p,), offsets clipped to ``MAX_LOG_OFFSET``."""
        factors = np.exp(np.clip(offsets, -MAX_LOG_OFFSET, MAX_LOG_OFFSET))
        return replace(self, theta=tuple((np.array(self.theta) * factors).tolist()))

    def functions(self, gear: GearObservations, label: str) -> tuple[Function, ...]:
        """Basis functions of the part, named by a label.

        ``LABEL``: displacement of its meshes; ``LABEL PARAMETER``: derivative by the logarithm of
        a parameter; for a pin ``LABEL carrier``: inertia force on the carrier.
        """
        at = tuple(np.flatnonzero(self.locus.mask(gear.model.layout)).tolist())
        names = (label, *(f"{label} {name}" for name in self.names))
        functions = [replace(_displacement(name), meshes=at) for name in names]
        if self.effect == "bearing_clearance":
            functions.append(_on_carrier(gear.model, self, label))
        return tuple(functions)

    def hypothesis(self, builder: CoefficientBuilder, label: str) -> Hypothesis:
        """Hypothesis of this part: amplitude fixed at 1, and logarithms of its parameters."""
        model = builder.gear.model
        mask = self.locus.mask(model.layout)
        weights: Weights = {label: mask}
        if self.effect == "bearing_clearance":
            push = np.zeros(len(model.layout.bodies))
            push[2] = 1.0
            weights[torque_balance.NAME, f"{label} carrier"] = forces_to_coordinates(model) @ push
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
        """Return the displacements of the meshes by the part, by function name.

        Args:
            m: motion at equal, fine steps.
            change: change of the law by all else: functions, and parts integrated before.
            label: prefix of the names of its functions.
            offsets: (p,) offsets of the logarithms of its parameters.
            slopes: whether to compute derivatives by the parameters.

        Returns:
            The displacements under ``label``; with ``slopes``, their derivatives by the logarithm
            of each parameter under ``LABEL NAME``.
        """
        drive = PartDrive(model, self.locus, self.effect, m, change)
        names, now = [label], self.with_log_offsets(offsets)
        if slopes:
            names += [f"{label} {name}" for name in self.names]
            moved = drive.motion_with_slopes(now)
        else:
            moved = drive.motions([now])
        reach = -model.scales.cos_beta * drive.meshes_mask
        return {
            name: (q[:, :, 0] @ reach, q[:, :, 1] @ reach)
            for name, q in zip(names, moved, strict=True)
        }


def _displacement(name: str) -> Function:
    """Basis function that looks up its displacement and rate in ``Law.displacements``."""
    return Function(
        name,
        "d",
        lambda _, law: law.displacements[name][0],
        lambda _, law: law.displacements[name][1],
        by_law=True,
    )


def _on_carrier(model: Model, part: MovingPart, label: str) -> Function:
    """Basis function of a pin: force -m q'' [N] on the carrier, q its motion in the bore."""
    at, mass = pin_meshes(model, part.locus)

    def values(m: MeshMotion, law: Law) -> Array:
        rate = law.displacements[label][1][:, at[0]] / -model.scales.cos_beta
        return np.asarray(-mass * np.gradient(rate, m.times))

    return Function(f"{label} carrier", "body", values, by_law=True)


def pin_meshes(model: Model, locus: Locus) -> tuple[list[int], float]:
    """Numbers of a pin's meshes, and moving mass [kg]: half the pin if only one side is loose."""
    at = np.flatnonzero(locus.mask(model.layout)).tolist()
    return at, model.parameters.m_p * len(at) / 4.0


class PartDrive:
    """Meshes and forces that drive a part in one run.

    Args:
        m: motion at equal, fine steps.
        change: change of the law by everything but the part.

    Attributes:
        meshes_mask: (k, n_mesh) 1 for the meshes of each of k coordinates (ring halves, or one
            pin).
        load: largest force on the part if it were rigid [N].
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
            sides = [mask & (np.arange(n) >= n // 2) & (side == number) for number in range(2)]
            self.meshes_mask = np.array([meshes for meshes in sides if meshes.any()], dtype=float)
            self._mass, self._under = s.M_r, np.inf
        else:
            self.meshes_mask = mask[None].astype(float)
            _, self._mass = pin_meshes(model, locus)
            self._under = s.M_c - self._mass
            control = m.point["K"] * s.b_c * s.omega_n**2 / s.cos_beta * s.M_c
            rest = s.cos_beta * force[:, ~mask].sum(axis=1)
            rest += control * control_wave(model, m.phase)
            rest -= 2.0 * m.point["T_1"] / s.r_bs
        self.load = float(s.cos_beta * np.max(np.abs(force) @ self.meshes_mask.T))
        self._meshes = [
            _mesh_loads(m, change, np.flatnonzero(meshes), rest) for meshes in self.meshes_mask
        ]

    def motions(self, parts: Sequence[MovingPart]) -> Array:
        """Displacement [m] and rate [m/s] (L, n, k, 2) with each of L sets of parameters.

        Args:
            parts: of these only ``theta`` and ``load`` are used; place and effect are those of
                the constructor.

        Returns:
            At n samples, of k coordinates: the two halves of a ring, or one pin.
        """
        springs, cos_beta = [self._spring(part) for part in parts], self._model.scales.cos_beta
        return np.stack([motions(loads, springs, cos_beta) for loads in self._meshes], axis=2)

    def motion_with_slopes(self, part: MovingPart) -> Array:
        """Motion as of ``motions``, and its derivatives (1 + p, n, k, 2) by p logarithms."""
        spring, cos_beta = self._spring(part), self._model.scales.cos_beta
        moved = [
            self._spring(part.with_log_offsets(offsets))
            for offsets in DIFFERENCE_STEP * np.eye(len(part.names))
        ]
        changes = [
            SeatSpring(0.0, 0.0, *(np.array(other[2:]) - spring[2:]) / DIFFERENCE_STEP)
            for other in moved
        ]
        return np.stack(
            [motion_with_slopes(loads, spring, changes, cos_beta) for loads in self._meshes],
            axis=2,
        )

    def _spring(self, part: MovingPart) -> SeatSpring:
        """Convert a part to SI units; add the masses of the part and of the body that carries it.

        Growth and drag are relative to ``part.load`` / stiffness, see ``MovingPart``.
        """
        theta = dict(zip(part.names, part.theta, strict=True))
        stiffness, clearance = theta["stiffness"], theta.get("clearance", 0.0)
        s = self._model.scales
        deflection = part.load / stiffness
        return SeatSpring(
            self._mass,
            self._under,
            stiffness,
            2.0 * theta["damping"] * np.sqrt(stiffness * self._mass),
            clearance,
            theta.get("softness", 0.0) * clearance,
            theta["growth"] / deflection**2,
            theta.get("drag", 0.0) / (deflection * s.omega_n),
            theta.get("film", 1.0),
        )


def _mesh_loads(m: MeshMotion, change: LawChange, at: NDArray[np.int64], rest: Array) -> MeshLoads:
    """Return motion and changed law of meshes with indices ``at``; ``rest``: see ``MeshLoads``."""
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
