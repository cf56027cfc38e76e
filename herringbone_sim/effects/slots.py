"""Slots: the quantities of a gear that an effect may change without an additional force law.

Effects in slots are integrated by the Taylor kernel of the core, nearly as fast as a gear without
effects and by every method. Other effects need compiled laws, see ``effects.law``.

Over 300 lines: every slot stands beside its translation for the kernel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model, mean_stiffness
from herringbone_sim.core.packed import Packed


class Slots:
    """Mesh law and torques of a gear, to be changed by effects; SI units, n = n_mesh.

    The force of a mesh is k f(x + d) + c (v + d'), with f the backlash function of half-width b.
    ``packed`` converts the result for the kernel.

    Attributes:
        model: the gear; effects that it already has are ignored.
        stiffness: (n,) mean of k [N/m].
        damping: (n,) c [N s/m].
        half_backlash: (n,) b [m].
        displacement: (n,) mean of d [m].
        bent_twice: whether a second effect bends the spring force or the damping of a mesh; slots
            hold the last.
    """

    def __init__(self, model: Model) -> None:
        p, s, n = model.bare, model.scales, model.layout.n_mesh
        self.model = model
        self.stiffness = mean_stiffness(model.parameters)
        self.damping = model.damping_n_s_per_m.copy()
        self.half_backlash = model.half_backlash_m.copy()
        self.displacement = np.zeros(n)
        self._unit_k = s.projection / s.omega_n**2
        self._k = {
            float(order): np.stack(pair) / self._unit_k
            for order, *pair in zip(p.orders, p.k_cos, p.k_sin, strict=True)
        }
        self._d: dict[float, Array] = {}
        self._torques: dict[float, Array] = {}
        self._added_loads: dict[float, Array] = {}
        self._law = p.law.copy()
        self.bent_twice = False
        self._slide = np.zeros((2, n, len(model.layout.bodies)))
        self._added: list[Coordinates] = []
        self._events: list[tuple[tuple[float, float, float], Array, Array]] = []

    @property
    def n_added_coordinates(self) -> int:
        """Number of coordinates added by ``add_coordinates`` so far."""
        return sum(len(added.seat) for added in self._added)

    def scale_stiffness(self, factor: Array) -> None:
        """Multiply k, its present harmonics included, by factors (n,)."""
        self.stiffness = self.stiffness * factor
        self._k = {order: rows * factor for order, rows in self._k.items()}

    def add_stiffness(self, order: float, cos: Array, sin: Array) -> None:
        """Add cos cos(order phase) + sin sin(order phase) to k, amplitudes (n,) [N/m]."""
        _add(self._k, order, cos, sin)

    def add_displacement(self, order: float, cos: Array, sin: Array) -> None:
        """Add a harmonic to d, amplitudes (n,) [m]; the order need not be an integer."""
        _add(self._d, order, cos, sin)

    def add_torque(self, order: float, cos: Array, sin: Array) -> None:
        """Add a harmonic to the torques over base radius (n_bodies,) [N], positive along u."""
        _add(self._torques, order, cos, sin)

    def add_event(
        self,
        period: Array,
        position: Array,
        width: float,
        stiffness: Array,
        displacement: Array,
    ) -> None:
        """Add an event that recurs on some meshes: a raised cosine over mesh cycles in k and d.

        Args:
            period: (n,) mesh cycles between events.
            position: (n,) mesh cycle of the middle of the first event.
            width: mesh cycles from onset to end.
            stiffness: (n,) loss of k at the middle as a share of k with all effects, 0 for none.
            displacement: (n,) d at the middle [m].
        """
        acts = (stiffness != 0.0) | (displacement != 0.0)
        when = np.stack([period, position], axis=1)
        for timing in np.unique(when[acts], axis=0):
            here = acts & (when == timing).all(axis=1)
            event = (float(timing[0]), float(timing[1]), width)
            self._events.append((event, stiffness * here, displacement * here))

    def bend_spring(self, mask: Array, exponent: float, reference: float) -> None:
        """Set the spring force of masked meshes to k f (|f| / reference)^(exponent - 1).

        The reference is in m. Slots hold one such law a mesh, see ``bent_twice``.
        """
        here = (mask > 0.0) & (exponent != 1.0)
        self.bent_twice |= bool((here & (self._law[1] != 1.0)).any())
        self._law[0, here], self._law[1, here] = reference / self.model.scales.b_c, exponent

    def bend_damping(self, mask: Array, share: float, power: float, depth: float) -> None:
        """Set the damping of masked meshes to c v [1 - share + share (|f| / depth)^power].

        The depth is in m. Slots hold one such law a mesh, see ``bent_twice``.
        """
        here = (mask > 0.0) & (share != 0.0)
        self.bent_twice |= bool((here & (self._law[2] != 0.0)).any())
        self._law[2, here], self._law[3, here] = share, power
        self._law[4, here] = depth / self.model.scales.b_c

    def add_friction(self, constant: Array, lever: Array) -> None:
        """Add the torques of friction on the flanks.

        A mesh force F adds |F| (sign(s) constant + |s| lever) to the torques over base radius [N],
        with s the mesh cycles from the pitch point, negative before it.

        Args:
            constant: (n, n_bodies) [-].
            lever: (n, n_bodies) per mesh cycle.
        """
        self._slide += np.stack([constant, lever])

    def add_coordinates(self, added: Coordinates) -> None:
        """Add coordinates on springs; their loads become torques of orders 0 and control_order."""
        self._added.append(added)
        p = self.model.parameters
        order, phase = p.control_order, p.control_phase
        for at, angle, body, load in (
            (0.0, 0.0, added.body_load, added.load),
            (order, phase, p.K * added.body_control, p.K * added.control),
        ):
            if np.any(body) or np.any(load):
                self.add_torque(at, body * np.cos(angle), -body * np.sin(angle))
                first = self.n_added_coordinates - len(load)
                row = np.zeros((2, first + len(load)))
                row[:, first:] = load * np.cos(angle), -load * np.sin(angle)
                before = self._added_loads.get(at, np.zeros((2, 0)))
                row[:, : before.shape[1]] += before
                self._added_loads[at] = row

    def shift_phase(self, mask: Array, angle: float) -> None:
        """Advance k and e of the gear without effects by an angle [rad] on masked meshes.

        Harmonic j shifts by j times the angle.
        """
        p, s = self.model.bare, self.model.scales
        for j, order in enumerate(p.orders):
            cos, sin = np.cos(order * angle) - 1.0, np.sin(order * angle)
            for cosine, sine, unit, add in (
                (p.k_cos[j], p.k_sin[j], 1.0 / self._unit_k, self.add_stiffness),
                (p.e_cos[j], p.e_sin[j], -s.b_c, self.add_displacement),
            ):
                more = cos * cosine + sin * sine, cos * sine - sin * cosine
                add(float(order), unit * mask * more[0], unit * mask * more[1])

    def packed(self) -> Packed:
        """Return the gear with these slots in the dimensionless form of the kernel."""
        model, p = self.model, self.model.bare
        s, layout = model.scales, model.layout
        extra = sorted({*self._k, *self._d} - set(p.orders.tolist()))
        orders = np.array([*p.orders, *extra])
        k_cos, k_sin = self._unit_k * _rows(self._k, orders, layout.n_mesh)
        d_cos, d_sin = _rows(self._d, orders, layout.n_mesh) / s.b_c
        e_cos, e_sin = np.zeros_like(d_cos), np.zeros_like(d_sin)
        e_cos[: len(p.orders)], e_sin[: len(p.orders)] = p.e_cos, p.e_sin
        loads = np.array(sorted(self._torques))
        pushes = self._accelerations(_rows(self._torques, loads, len(layout.bodies)))
        of_added = np.zeros((2, len(loads), self.n_added_coordinates))
        for j, order in enumerate(loads):
            row = self._added_loads.get(float(order), np.zeros((2, 0)))
            of_added[:, j, : row.shape[1]] = row / (s.b_c * s.omega_n**2)
        load_cos, load_sin = np.concatenate([pushes, of_added], axis=-1)
        events = self._events
        none = np.zeros((0, layout.n_mesh))
        mean = self.displacement / s.b_c
        return p._replace(
            stiffness=self.stiffness * self._unit_k,
            damping=self.damping * s.projection / s.omega_n,
            b=self.half_backlash / s.b_c,
            orders=orders,
            k_cos=k_cos,
            k_sin=k_sin,
            e_mean=p.e_mean - mean,
            e_cos=e_cos - d_cos,
            e_sin=e_sin - d_sin,
            d_mean=mean,
            d_cos=d_cos if self._d else none,
            d_sin=d_sin if self._d else none,
            events=np.array([event for event, _, _ in events]).reshape(-1, 3),
            event_k=np.array([k for _, k, _ in events]).reshape(-1, layout.n_mesh),
            event_d=np.array([d for _, _, d in events]).reshape(-1, layout.n_mesh) / s.b_c,
            load_orders=loads,
            load_cos=load_cos,
            load_sin=load_sin,
            **self._forces(),
        )

    def _forces(self) -> dict[str, Any]:
        """Return the fields of ``Packed`` for power laws, friction and added coordinates."""
        model, s, n = self.model, self.model.scales, self.model.layout.n_mesh
        newton = s.b_c * s.omega_n**2 / s.projection  # unit of mesh forces in the kernel
        m, bodies = model.layout.n_coordinate, len(model.layout.bodies)
        joined = _joined(self._added, n, bodies)
        push = np.zeros((3, m + len(joined.seat) + 1, n + len(joined.seat)))
        base, added, seats = np.append(np.arange(m), -1), slice(m, -1), slice(n, None)
        push[0, base, :n] = self._of_bodies(joined.body_force).T * newton
        push[0, base, seats] = self._of_bodies(joined.body_hold).T
        push[0, added, :n] = joined.force / s.projection
        push[0, added, seats] = joined.hold / (s.b_c * s.omega_n**2)
        push[1:, base, :n] = np.swapaxes(self._of_bodies(self._slide) * newton, 1, 2)
        seat = joined.seat * np.array([s.b_c, s.velocity_m_per_s, 1.0 / s.b_c, 1.0 / s.b_c])
        bends, damps = self._law[1] != 1.0, self._law[2] != 0.0
        plain = not (push.any() or bends.any() or damps.any())
        bends |= damps & (self._law[3] != 0.0)
        return {
            "plain": plain,
            "extended": () if plain else (0,),
            "powers": bool(bends.any() or seat[:, 3].any()),
            "law": self._law,
            "added_shift": joined.shift,
            "seat": seat,
            "push": push,
            "pairs": np.ascontiguousarray(np.argwhere(push.any(axis=0))),
            "rubs": np.flatnonzero(self._slide.any(axis=(0, 2))),
        }

    def _of_bodies(self, torque: Array) -> Array:
        """Return accelerations (..., m + 1) over b_c omega_n^2 by torques (..., n_bodies) [N].

        Torques are over base radius. Entries are the suns and planets without the contribution of
        the carrier's acceleration, then the carrier; m = n_coordinate.
        """
        p, s = self.model.bare, self.model.scales
        inverse = np.concatenate([p.inv_M_s, [p.inv_M_c], p.inv_M_p.ravel()])
        whole = torque * inverse * s.cos_beta / (s.b_c * s.omega_n**2)
        return np.concatenate([whole[..., :2], whole[..., 3:], whole[..., 2:3]], axis=-1)

    def _accelerations(self, torque: Array) -> Array:
        """Return accelerations (..., n_coordinate) of the coordinates (q, r) over b_c omega_n^2.

        Args:
            torque: (..., n_bodies) torque over base radius [N], bodies in the order of
                ``layout.bodies``.
        """
        p, s = self.model.bare, self.model.scales
        carrier = torque[..., 2:3] * p.inv_M_c
        suns = torque[..., :2] * p.inv_M_s - 2.0 * carrier
        planets = torque[..., 3:] * p.inv_M_p.ravel() - carrier
        whole: Array = np.concatenate([suns, planets], axis=-1)
        return whole * s.cos_beta / (s.b_c * s.omega_n**2)


@dataclass(frozen=True)
class Coordinates:
    """Coordinates u_j that effects add to a gear, s of them, SI units; b = n_bodies, n = n_mesh.

    With F (n,) the mesh forces, H_j = k g(u_j) + c u_j' the forces of the springs, g the backlash
    function (corners sharp or rounded; the identity without clearance) and C = K cos(order phase +
    control_phase), Eq. (20),

        u'' = force @ F + hold @ H + load + C control,
        torques over base radius = F @ body_force + H @ body_hold + body_load + C body_control.

    Attributes:
        shift: (s, n) displacement d of each mesh for u_j = 1.
        seat: (s, 4) k [N/m], c [N s/m], half of the clearance [m], rounding of its corners [m].
        force: (s, n) [1/kg]. hold: (s, s) [1/kg]. load, control: (s,) [m/s^2].
        body_force: (n, b) [-]. body_hold: (s, b) [-]. body_load, body_control: (b,) [N].
    """

    shift: Array
    seat: Array
    force: Array
    hold: Array
    load: Array
    control: Array
    body_force: Array
    body_hold: Array
    body_load: Array
    body_control: Array


def _joined(parts: Sequence[Coordinates], n: int, bodies: int) -> Coordinates:
    """Join the added coordinates of a gear with n meshes into one; ``hold`` is block diagonal."""
    size = sum(len(part.seat) for part in parts)
    hold, first = np.zeros((size, size)), 0
    for part in parts:
        here = slice(first, first + len(part.seat))
        hold[here, here], first = part.hold, here.stop
    return Coordinates(
        shift=np.concatenate([np.zeros((0, n)), *(part.shift for part in parts)]),
        seat=np.concatenate([np.zeros((0, 4)), *(part.seat for part in parts)]),
        force=np.concatenate([np.zeros((0, n)), *(part.force for part in parts)]),
        hold=hold,
        load=np.concatenate([np.zeros(0), *(part.load for part in parts)]),
        control=np.concatenate([np.zeros(0), *(part.control for part in parts)]),
        body_force=sum((part.body_force for part in parts), np.zeros((n, bodies))),
        body_hold=np.concatenate([np.zeros((0, bodies)), *(part.body_hold for part in parts)]),
        body_load=sum((part.body_load for part in parts), np.zeros(bodies)),
        body_control=sum((part.body_control for part in parts), np.zeros(bodies)),
    )


def _add(rows: dict[float, Array], order: float, cos: Array, sin: Array) -> None:
    """Add cosine and sine amplitudes to the harmonic of an order in ``rows``, in place."""
    here = np.stack([cos, sin])
    rows[order] = rows[order] + here if order in rows else here


def _rows(rows: dict[float, Array], orders: Sequence[float] | Array, n: int) -> Array:
    """Return cosine and sine amplitudes (2, orders, n), zero for orders missing in ``rows``.

    Args:
        rows: cosine and sine amplitudes (2, n) of each order.
        orders: of the result, in its sequence; others in ``rows`` are left out.
        n: number of meshes, or of bodies.
    """
    table = np.zeros((2, len(orders), n))
    for j, order in enumerate(orders):
        if float(order) in rows:
            table[:, j] = rows[float(order)]
    return table
