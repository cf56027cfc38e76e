"""The augmented model: nominal parameters moved inside their tolerance, with effects.

What a diagnosis finds is a gear that the node runs. The file that says so holds nothing but
parameters of the simulation, and a campaign can be measured against it again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model, build, mean_stiffness
from herringbone_sim.core.parameters import Parameters, spread
from herringbone_sim.effects.effect import Active
from herringbone_sim.recording.parameter_file import save_parameters

Array = NDArray[np.float64]

TITLE = """\
The augmented model of {campaign}: what the diagnosis of its gap made of the nominal one.
Against the nominal file: k_m_sp, k_m_rp, c_factor and e_factor as the force law has them, I_s,
I_p, I_c and m_p as the torque balance has them, all inside their tolerance; omega_n stays the
nominal one, that Omega and K refer to; control_on holds K to the nominal torque on the carrier."""


@dataclass(frozen=True)
class Augmented:
    """What a verdict changes.

    Attributes:
        factors: (6,) on k, c and e of the sun and of the ring meshes, see ``recalibrate.NAMES``.
        inverse: (3,) on 1/M_s, 1/M_p, 1/M_c.
        actives: effects with size and place.
        motion: whether there were no forces, so that accelerations alone speak.
    """

    factors: Array
    inverse: Array
    actives: tuple[Active, ...] = ()
    motion: bool = False


def nominal_model() -> Augmented:
    """The nominal gear: nothing is changed."""
    return Augmented(np.ones(6), np.ones(3))


def parameters_of(nominal: Parameters, model: Augmented) -> Parameters:
    """Parameters (full model) of a gear that is changed like this.

    The control is a torque on the carrier, worked out with its nominal inertia: what it does to
    the accelerations goes with the inverse of the own one.

    Raises:
        ParameterError: factors that no gear can have.
    """
    full = nominal.changed({"model": "full"})
    n = full.layout.n_mesh
    s, p, c = (1.0 / one for one in model.inverse)
    moved: dict[str, Any] = {
        "k_m_sp": full.k_m_sp * model.factors[0],
        "k_m_rp": full.k_m_rp * model.factors[1],
        "I_s": full.I_s * s,
        "I_p": full.I_p * p,
        "I_c": full.I_c * c,
        "m_p": full.m_p * c,
        "omega_n": build(full).scales.omega_n,
        "control_on": [share / c for share in full.control_on],
    }
    before, after = build(full), build(full.changed(moved))
    wanted = before.damping_n_s_per_m * np.repeat(model.factors[2:4], n // 2)
    is_now = np.where(after.damping_n_s_per_m > 0.0, after.damping_n_s_per_m, 1.0)
    e = np.array(spread(full.e_factor, n)) * np.repeat(model.factors[4:6], n // 2)
    c_factor = np.array(spread(full.c_factor, n)) * wanted / is_now
    return full.changed({**moved, "c_factor": c_factor.tolist(), "e_factor": e.tolist()})


def from_parameters(
    nominal: Parameters, own: Parameters, actives: Sequence[Active], motion: bool = False
) -> Augmented:
    """What a gear changes against the nominal one: the inverse of ``parameters_of``."""
    one, other = (build(p.changed({"model": "full"})) for p in (nominal, own))
    factors = np.concatenate([_of_kinds(one, other, of) for of in (_k, _c, _e)])
    masses = [
        (m.packed.inv_M_s.mean(), m.packed.inv_M_p.mean(), m.packed.inv_M_c) for m in (one, other)
    ]
    inverse = np.array(masses[1]) / np.array(masses[0])
    return Augmented(factors, inverse, tuple(actives), motion)


def save_augmented(path: Path, nominal: Parameters, model: Augmented, campaign: str) -> None:
    """Write the parameter file of the augmented gear; OSError where that can't be."""
    own = parameters_of(nominal, model)
    save_parameters(path, own, TITLE.format(campaign=campaign), model.actives)


def _k(model: Model) -> Array:
    return mean_stiffness(model.parameters)


def _c(model: Model) -> Array:
    return model.damping_n_s_per_m


def _e(model: Model) -> Array:
    p = model.parameters
    return p.e_m * np.array(spread(p.e_factor, model.layout.n_mesh))


def _of_kinds(one: Model, other: Model, of: Any) -> Array:
    """Ratio (2,) of a quantity of sun and ring meshes; 1 where the nominal one is zero."""
    before, after = of(one).reshape(2, -1).mean(axis=1), of(other).reshape(2, -1).mean(axis=1)
    ratio: Array = np.divide(after, before, out=np.ones(2), where=before != 0.0)
    return ratio
