"""Build the dimensionless model of a parameter set; convert between states and displacements.

The equations of motion, (12)-(16) of the bodies and (18)-(22) of the reduced system, are in
``right_hand_side``. Over 300 lines: the numbers of the gear and the geometry of its state.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core import mesh
from herringbone_sim.core.layout import Layout
from herringbone_sim.core.packed import Packed
from herringbone_sim.core.parameters import Parameters, spread
from herringbone_sim.core.right_hand_side import accelerate
from herringbone_sim.core.scaling import Scales, scales
from herringbone_sim.errors import ParameterError


@dataclass(frozen=True)
class Model:
    """A gear ready to be integrated.

    Attributes:
        parameters: parameter set that the model was built from.
        layout: names and sizes.
        scales: radii, masses, scales (SI).
        half_backlash_m: (n_mesh,) b' [m], Eq. (3), without effects.
        damping_n_s_per_m: (n_mesh,) c [N s/m], Eq. (11), without effects.
        bare: dimensionless data for the kernel, without effects.
        packed: data that the kernel uses: ``bare`` with the changes by effects.
        effects: active effects, as given to ``effects.assemble``; empty without any.
        added_sizes: key of each effect that adds states, and their number, in the order of the
            state.
        integrator: None, or a function of the model that returns its stepper, for a gear that
            ``packed`` can't fully represent. Its ``run_batch``, if any, integrates batches.
    """

    parameters: Parameters
    layout: Layout
    scales: Scales
    half_backlash_m: Array
    damping_n_s_per_m: Array
    bare: Packed
    packed: Packed
    effects: tuple[Any, ...] = ()
    added_sizes: tuple[tuple[Hashable, int], ...] = ()
    integrator: Any = None

    @property
    def n_added_coordinates(self) -> int:
        """Number of coordinates in ``packed`` that effects add to those of the layout."""
        return len(self.packed.seat)

    @property
    def n_state(self) -> int:
        """Length of a state: that of ``Layout.state_names``, and the states that effects add.

        Those of ``packed`` are displacements of all added coordinates, then their rates.
        """
        added = 2 * self.n_added_coordinates
        if self.integrator:
            added = sum(size for _, size in self.added_sizes)
        return self.layout.n_state + added


def build(p: Parameters) -> Model:
    """Return the model of a parameter set, without effects.

    Raises:
        ParameterError: the temperature rise takes more backlash than there is (b' < 0).
    """
    s = scales(p)
    half = half_backlashes(p, s)
    damping = mesh_damping(p, s)
    packed = _pack(p, s, half, damping)
    return Model(p, p.layout, s, half, damping, packed, packed)


def mean_sun_force(model: Model) -> float:
    """Return the mean normal force of a sun mesh [N] that balances the input torque T_1."""
    p, s = model.parameters, model.scales
    return p.T_1 * s.cos_beta / (2.0 * s.r_bs * s.projection * p.n_planets)


def half_backlashes(p: Parameters, s: Scales) -> Array:
    """Return b' [m] of each mesh (n_mesh,), Eqs. (2), (3); ParameterError if one is negative."""
    alpha_w = float(np.radians(p.alpha_w))
    losses = [
        mesh.thermal_backlash_loss(p.delta_T, p.gamma, s.m_t, z + p.z_p, alpha_w)
        for z in (p.z_s, p.z_r if p.thermal_rp == "own" else p.z_s)
    ]
    n = p.layout.n_mesh
    cold = np.repeat([mesh.half_backlash(p.b, p.b_c, loss) for loss in losses], n // 2)
    half: Array = cold + np.array(spread(p.b_offset, n))
    if half.min() < 0.0:
        worst = int(np.argmin(half))
        raise ParameterError(
            f"delta_T = {p.delta_T:g} K leaves mesh {p.layout.meshes[worst]} a half-backlash "
            f"b' of {half[worst]:.3e} m by Eq. (3); it can't be negative: lower delta_T or "
            f"raise b ({p.b:g} b_c) or b_offset"
        )
    return half


def by_kind(values: Array) -> dict[str, float]:
    """Value of the first mesh of each kind, ``sp`` and ``rp``, of values (n_mesh,)."""
    return {"sp": float(values[0]), "rp": float(values[len(values) // 2])}


def mesh_damping(p: Parameters, s: Scales) -> Array:
    """Return the damping c [N s/m] of each mesh (n_mesh,), Eq. (11)."""
    n = p.layout.n_mesh
    c_sp = mesh.damping(p.xi, p.k_m_sp, s.M_s, s.M_p)
    c_rp = mesh.damping(p.xi, p.k_m_rp, s.M_r, s.M_p)
    c: Array = np.repeat([c_sp, c_rp], n // 2) * np.array(spread(p.c_factor, n))
    return c


def mesh_phases(p: Parameters) -> Array:
    """Return the phase shifts [rad] (n_mesh,) of k and e: ``mesh_phase`` and those of planets.

    Under geometric ``phasing``, with planets at angles psi, the sun meshes also shift by z_s psi
    and the ring meshes by -z_r psi.
    """
    n = p.layout.n_mesh
    shift = np.array(spread(p.mesh_phase, n))
    if p.phasing == "in_phase" or p.model == "reduced":
        return shift
    equal = 360.0 * np.arange(p.n_planets) / p.n_planets
    psi = np.radians(np.array(p.planet_angle) if p.planet_angle else equal)
    phases: Array = shift + np.concatenate([np.tile(p.z_s * psi, 2), np.tile(-p.z_r * psi, 2)])
    return phases


def mean_stiffness(p: Parameters) -> Array:
    """Return the mean stiffness k_m [N/m] of each mesh (n_mesh,)."""
    n = p.layout.n_mesh
    k_m: Array = np.repeat([p.k_m_sp, p.k_m_rp], n // 2) * np.array(spread(p.k_factor, n))
    return k_m


def _pack(p: Parameters, s: Scales, half: Array, damping: Array) -> Packed:
    """Return the dimensionless data of a gear without effects for the kernel."""
    layout = p.layout
    n = layout.n_mesh
    shift = mesh_phases(p)
    h = max(len(p.k_amp), len(p.e_amp))
    stiffness = mean_stiffness(p) * s.projection / s.omega_n**2
    k_angle = [(j + 1) * shift + np.array(spread(p.phi_a, n)) for j in range(len(p.k_amp))]
    e_angle = [(j + 1) * shift + np.array(spread(p.phi_b, n)) for j in range(len(p.e_amp))]
    e_factor = np.array(spread(p.e_factor, n))
    e = [p.e_m * share * e_factor for share in p.e_amp]
    k = [share * stiffness for share in p.k_amp]
    on_sp, on_rp = np.array(spread(p.control_on, 4)).reshape(2, 2)
    unit = s.omega_n**2 * s.b_c
    of_output = s.T_2 * s.cos_beta / (s.r_bc * s.M_c * unit)
    M_s = s.M_s * np.array(spread(p.I_s_factor, 2))
    M_p = s.M_p * np.array(spread(p.I_p_factor, n // 2)).reshape(2, -1)
    return Packed(
        classes=(0,) * layout.n_classes,
        multiplicity=p.n_planets / layout.n_classes,
        stiffness=stiffness,
        damping=damping * s.projection / s.omega_n,
        orders=np.arange(1.0, h + 1.0),
        k_cos=_rows([a * np.cos(t) for a, t in zip(k, k_angle, strict=True)], h, n),
        k_sin=_rows([-a * np.sin(t) for a, t in zip(k, k_angle, strict=True)], h, n),
        e_mean=p.e_mean + np.array(spread(p.e_offset, n)) / s.b_c,
        e_cos=_rows([a * np.sin(t) for a, t in zip(e, e_angle, strict=True)], h, n),
        e_sin=_rows([a * np.cos(t) for a, t in zip(e, e_angle, strict=True)], h, n),
        d_mean=np.zeros(n),
        d_cos=np.zeros((0, n)),
        d_sin=np.zeros((0, n)),
        events=np.zeros((0, 3)),
        event_k=np.zeros((0, n)),
        event_d=np.zeros((0, n)),
        b=half / s.b_c,
        inv_M_s=1.0 / M_s,
        inv_M_p=1.0 / M_p,
        inv_M_c=1.0 / s.M_c,
        load_q=p.T_1 * s.cos_beta / (2.0 * s.r_bs * M_s * unit) + 2.0 * of_output,
        load_r=of_output,
        control_q=on_sp + on_rp,
        control_r=on_rp.copy(),
        control_order=float(p.control_order),
        control_phase=float(p.control_phase),
        load_orders=np.zeros(0),
        load_cos=np.zeros((0, layout.n_coordinate)),
        load_sin=np.zeros((0, layout.n_coordinate)),
        plain=True,
        extended=(),
        powers=False,
        law=np.array([1.0, 1.0, 0.0, 0.0, 1.0])[:, None] * np.ones(n),
        added_shift=np.zeros((0, n)),
        seat=np.zeros((0, 4)),
        push=np.zeros((3, layout.n_coordinate + 1, n)),
        pairs=np.zeros((0, 2), dtype=np.int64),
        rubs=np.zeros(0, dtype=np.int64),
        K=float(p.K),
        Omega=float(p.Omega),
    )


def _rows(amplitudes: list[Array], h: int, n: int) -> Array:
    """Return amplitudes of harmonics as an array (h, n), with zeros where the list is shorter."""
    rows = np.zeros((h, n))
    rows[: len(amplitudes)] = np.array(amplitudes).reshape(-1, n)
    return rows


def errors_at(model: Model, phase: float) -> tuple[Array, Array]:
    """Return e and de/dtau (n_mesh,) of all meshes at a phase [rad], in b_c, Eqs. (9), (10).

    These are the errors without effects, as x and v do not contain displacements by effects.
    """
    p = model.bare
    orders = p.orders[:, None]
    cos, sin = np.cos(orders * phase), np.sin(orders * phase)
    e = p.e_mean + np.sum(p.e_cos * cos + p.e_sin * sin, axis=0)
    rate = p.Omega * np.sum(orders * (p.e_sin * cos - p.e_cos * sin), axis=0)
    return e, rate


def relative(model: Model, y: Array, phase: float) -> tuple[Array, Array]:
    """Return the dimensionless x and v (n_mesh,) of a state, Eqs. (15), (16).

    Args:
        y: (n_state,) as ``Layout.state_names``, without states that effects add.
        phase: mesh phase [rad].
    """
    e, rate = errors_at(model, phase)
    displacement, velocity = np.split(np.asarray(y), 2)
    return _deflect(displacement) - e, _deflect(velocity) - rate


def _deflect(coordinates: Array) -> Array:
    """Return the deflections (n_mesh,) without errors from coordinates (n_coordinate,)."""
    sides = np.repeat(coordinates[:2], (len(coordinates) - 2) // 2)
    return np.concatenate([sides - coordinates[2:], coordinates[2:]])


def state(model: Model, x: Array, v: Array, phase: float) -> Array:
    """Return the state y from dimensionless x and v (n_mesh,) at a mesh phase [rad].

    Inverse of ``relative``, without states that effects add. Sun meshes of planets 2.. follow from
    geometry; their entries in x and v are not read.
    """
    e, rate = errors_at(model, phase)
    return np.concatenate([_coordinates(x + e), _coordinates(v + rate)])


def _coordinates(deflection: Array) -> Array:
    """Return the coordinates (n_coordinate,) from deflections (n_mesh,) without errors."""
    sun, ring = np.split(deflection, 2)
    c = len(ring) // 2
    return np.concatenate([[sun[0] + ring[0], sun[c] + ring[c]], ring])


def initial_state(model: Model) -> Array:
    """Return y at phase 0 from initial_x, initial_v, initial_noise, without states of effects."""
    p = model.parameters
    c = model.layout.n_classes
    x = np.repeat(spread(p.initial_x, 4), c)
    v = np.repeat(spread(p.initial_v, 4), c)
    y = state(model, x, v, 0.0)
    noise = np.random.default_rng(p.seed).normal(size=model.layout.n_coordinate)
    y[: model.layout.n_coordinate] += p.initial_noise * noise
    return y


def with_added_states(model: Model, y: Array) -> Array:
    """Return states y (..., <= n_state) with the states that effects add, at rest if left out.

    Zeros are appended up to ``Model.n_state``; ValueError if y is longer.
    """
    rest = np.zeros((*y.shape[:-1], model.n_state - y.shape[-1]))
    return np.concatenate([y, rest], axis=-1)


def carry_over(old: Model, new: Model, y: Array, phase: float) -> Array:
    """Return the state of a changed gear with the same relative displacements and velocities.

    A change of the error or of Omega changes e and de/dtau, one of b_c or omega_n the units of y,
    and the coordinates accordingly. With errors that differ between planets, x and v can be kept
    only at ring meshes and planet 1.
    """
    before, after = old.scales, new.scales
    to_x, to_v = before.b_c / after.b_c, before.velocity_m_per_s / after.velocity_m_per_s
    same = to_x == to_v == 1.0 and all(
        np.array_equal(getattr(old.bare, name), getattr(new.bare, name))
        for name in ("e_mean", "e_cos", "e_sin", "Omega")
    )
    if same:
        return y
    x, v = relative(old, y, phase)
    return state(new, to_x * x, to_v * v, phase)


def body_displacements(model: Model, y: Array) -> Array:
    """Return u = r_b theta of all bodies (n_bodies,) in units of b_c, rigid rotation removed.

    The rigid rotation (2 on the suns, 1 elsewhere) is chosen such that the momentum sum 2 M_s u_s
    + M_p u_p + M_c u_c is zero.
    """
    s = model.scales
    multiplicity = model.packed.multiplicity
    q = y[:2] / s.cos_beta
    r = y[2 : model.layout.n_coordinate] / s.cos_beta
    M_s, M_p = 1.0 / model.packed.inv_M_s, 1.0 / model.packed.inv_M_p.ravel()
    whole = s.M_c + 4.0 * M_s.sum() + multiplicity * M_p.sum()
    u_c = -(2.0 * (M_s @ q) + multiplicity * (M_p @ r)) / whole
    return np.concatenate([q + 2.0 * u_c, [u_c], r + u_c])


def divergence(model: Model) -> float:
    """Return the trace of the derivative of dy/dtau with respect to y, effects included.

    NaN with friction, damping by contact, and laws of effects, where it depends on the state.
    """
    p, m, n = model.packed, model.layout.n_coordinate, model.layout.n_mesh
    if model.integrator is not None or p.law[2].any() or p.rubs.size:
        return float("nan")
    forces = np.eye(
        n + model.n_added_coordinates
    )  # of meshes, then of the seats of added coordinates
    out = p.push[0, :-1].copy()
    out[:2] -= 2.0 * p.push[0, -1]
    out[2:m] -= p.push[0, -1]
    for j in range(n):
        accelerate(p, forces[j], out[:m, j])
    into = np.eye(n + model.n_added_coordinates, m + model.n_added_coordinates, m - n)
    into[:n, :m] = np.array([_deflect(row) for row in np.eye(m)]).T
    into[:n, m:] = p.added_shift.T
    damping = np.concatenate([p.damping, p.seat[:, 1]])
    return float(np.trace(out @ np.diag(damping) @ into))


def jacobian(model: Model, y: Array, phase: float) -> Array:
    """Return the derivative (n_state, n_state) of dy/dtau with respect to y, away from kinks.

    Only effects on stiffness (not by events), damping and half-backlash are contained, and y must
    not have states of effects.
    """
    packed = model.packed
    m = model.layout.n_coordinate
    n = model.layout.n_mesh
    x, _ = relative(model, y, phase)
    orders = packed.orders[:, None]
    k = packed.stiffness + np.sum(
        packed.k_cos * np.cos(orders * phase) + packed.k_sin * np.sin(orders * phase), axis=0
    )
    into = np.array([_deflect(row) for row in np.eye(m)]).T
    out = np.zeros((m, n))
    for j in range(n):
        accelerate(packed, np.eye(n)[j], out[:, j])
    top = np.hstack([np.zeros((m, m)), np.eye(m)])
    springs = out @ np.diag(k * (np.abs(x) > packed.b)) @ into
    return np.vstack([top, np.hstack([springs, out @ np.diag(packed.damping) @ into])])
