"""The augmented model: the nominal gear, recalibrated, with the effects of a verdict.

It is written as a parameter file of the simulation, so that the node runs it and further campaigns
can be measured against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model, build, mean_stiffness
from herringbone_sim.core.parameters import Parameters, spread
from herringbone_sim.effects.effect import Active
from herringbone_sim.recording.parameter_file import save_parameters

TITLE = """\
The augmented model of {campaign}: the nominal gear, recalibrated, with the effects of the verdict.
Changed inside tolerances: k_m_sp, k_m_rp, c_factor and e_factor by the force law, I_s, I_p, I_c
and m_p by the torque balance. omega_n stays nominal, as Omega and K refer to it; control_on keeps
the control torque on the carrier nominal."""


@dataclass(frozen=True)
class Augmented:
    """The augmented model as changes of the nominal gear.

    Attributes:
        factors: (6,) on k, c and e of the sun and of the ring meshes, see ``recalibrate.NAMES``.
        inverse: (3,) factors on 1/M_s, 1/M_p, 1/M_c.
        actives: effects with parameters and locus.
        motion: whether no forces are measured, so that its residuals are accelerations.
    """

    factors: Array
    inverse: Array
    actives: tuple[Active, ...] = ()
    motion: bool = False


def nominal_model() -> Augmented:
    """The nominal gear without changes."""
    return Augmented(np.ones(6), np.ones(3))


def parameters_of(nominal: Parameters, model: Augmented) -> Parameters:
    """Parameters (full model) of the augmented gear, without its effects.

    The control torque stays that for the nominal inertia of the carrier, so that the acceleration
    that it causes is scaled by ``inverse`` of the carrier. The mass of the planets, a part of that
    inertia, is scaled with the carrier, not with the planets. omega_n stays nominal.

    Raises:
        ParameterError: a changed parameter is out of its range.
    """
    full = nominal.changed({"model": "full"})
    n = full.layout.n_mesh
    s, p, c = (1.0 / inverse for inverse in model.inverse)
    changes: dict[str, Any] = {
        "k_m_sp": full.k_m_sp * model.factors[0],
        "k_m_rp": full.k_m_rp * model.factors[1],
        "I_s": full.I_s * s,
        "I_p": full.I_p * p,
        "I_c": full.I_c * c,
        "m_p": full.m_p * c,
        "omega_n": build(full).scales.omega_n,
        "control_on": [share / c for share in full.control_on],
    }
    before, after = build(full), build(full.changed(changes))
    target = before.damping_n_s_per_m * np.repeat(model.factors[2:4], n // 2)
    damping = np.where(after.damping_n_s_per_m > 0.0, after.damping_n_s_per_m, 1.0)
    factor = np.repeat(model.factors[4:6], n // 2)
    mean = full.e_mean * before.scales.b_c  # the same for all meshes: its change is an offset
    by_mesh = {
        "c_factor": np.array(spread(full.c_factor, n)) * target / damping,
        "e_factor": np.array(spread(full.e_factor, n)) * factor,
        "e_offset": np.array(spread(full.e_offset, n)) * factor + mean * (factor - 1.0),
    }
    return full.changed({**changes, **{name: values.tolist() for name, values in by_mesh.items()}})


def from_parameters(
    nominal: Parameters, own: Parameters, actives: Sequence[Active], motion: bool = False
) -> Augmented:
    """Augmented model from its parameters ``own`` and effects; inverts ``parameters_of``."""
    before, after = (build(p.changed({"model": "full"})) for p in (nominal, own))
    old, new = (_means(model) for model in (before, after))
    factors = np.divide(new, old, out=np.ones(6), where=old != 0.0)
    masses = [
        (m.packed.inv_M_s.mean(), m.packed.inv_M_p.mean(), m.packed.inv_M_c)
        for m in (before, after)
    ]
    inverse = np.array(masses[1]) / np.array(masses[0])
    return Augmented(factors, inverse, tuple(actives), motion)


def save_augmented(path: Path, nominal: Parameters, model: Augmented, campaign: str) -> None:
    """Write the parameter file of the augmented model; ParameterError or OSError if impossible."""
    own = parameters_of(nominal, model)
    save_parameters(path, own, TITLE.format(campaign=campaign), model.actives)


def _means(model: Model) -> Array:
    """Means (6,) of k [N/m], c [N s/m] and the amplitude of e [b_c] on sun and ring meshes."""
    p = model.parameters
    e = p.e_m * np.array(spread(p.e_factor, model.layout.n_mesh))
    by_mesh = np.stack([mean_stiffness(p), model.damping_n_s_per_m, e])
    return np.asarray(by_mesh.reshape(6, -1).mean(axis=1))
