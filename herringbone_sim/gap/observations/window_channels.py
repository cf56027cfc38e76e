"""What sensors show of a motion: rotations, accelerations, forces of meshes and of pins.

Each channel is a sum of rotations u, mesh forces F and accelerations d2u/dt2 = inv (tau - G' F) of
the bodies, so its slope by the state follows from that of the force law.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.layout import Layout
from herringbone_sim.gap.data.prepared import Measured, PreparedRun
from herringbone_sim.gap.observations.rollout import STATES, Drive

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Channels:
    """Channels as sums of what a motion is.

    Attributes:
        names: (k,).
        of_u, of_F, of_a: (k, 9), (k, n_mesh), (k, 9).
        values: (n, k) as recorded, NaN where there is no reading.
        sigma: (k,) noise.
    """

    names: tuple[str, ...]
    of_u: Array
    of_F: Array
    of_a: Array
    values: Array
    sigma: Array

    @property
    def gauges(self) -> tuple[str, ...]:
        """Names of those that show forces."""
        return tuple(n for n, of in zip(self.names, self.of_F, strict=True) if np.any(of))


def channels(run: PreparedRun) -> Channels:
    """All channels of a run that windows can follow."""
    layout = run.model.layout
    bodies, meshes = np.eye(len(layout.bodies)), np.eye(layout.n_mesh)
    kinds: tuple[tuple[str, tuple[str, ...], Measured, Array], ...] = (
        ("u", layout.bodies, run.u, bodies),
        ("F", layout.meshes, run.F, meshes),
        ("F", pins(layout), run.pin, on_pins(layout)),
        ("a", layout.bodies, run.a, bodies),
    )
    names: list[str] = []
    parts: dict[str, list[Array]] = {"u": [], "F": [], "a": []}
    values, sigma = [], []
    for kind, places, m, weights in kinds:
        for i in np.flatnonzero(m.there):
            names.append(f"{kind}_{places[i]}")
            for q, of in parts.items():
                of.append(
                    weights[i] if q == kind else np.zeros(len(meshes if q == "F" else bodies))
                )
            values.append(m.values[:, i])
            sigma.append(m.sigma[i])
    return Channels(
        tuple(names),
        np.array(parts["u"]),
        np.array(parts["F"]),
        np.array(parts["a"]),
        np.stack(values, axis=1),
        np.array(sigma),
    )


def pins(layout: Layout) -> tuple[str, ...]:
    """Names of the pins' gauges, without their quantity."""
    return tuple(f"pin{planet}" for planet in layout.planets)


def on_pins(layout: Layout) -> Array:
    """(pins, n_mesh): a pin carries the forces of all meshes of its planet."""
    of = [mesh[2 : mesh.index("_")] for mesh in layout.meshes]
    return np.array([[float(p == str(planet)) for p in of] for planet in layout.planets])


def mesh_forces(
    G: Array, states: Array, drive: Drive, at: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Forces (..., n_mesh) at states (..., 18) of half steps (...), and contact stiffness."""
    half = STATES // 2
    x = states[..., :half] @ G.T + drive.offset[at]
    v = states[..., half:] @ G.T + drive.rate[at]
    over, under = x - drive.plus[at], -x - drive.minus[at]
    f = np.maximum(over, 0.0) - np.maximum(under, 0.0)
    stiff = drive.k[at] * ((over > 0.0) | (under > 0.0))
    return drive.k[at] * f + drive.c[at] * v + drive.more[at], stiff


def shown(c: Channels, states: Array, drive: Drive, at: NDArray[np.int64]) -> tuple[Array, Array]:
    """What channels show of states (W, m, 18) at half steps (W, m), and its slope.

    Returns:
        (W, m, k) and (W, m, k, 18).
    """
    G = drive.G
    of_u = np.hstack([c.of_u, np.zeros_like(c.of_u)])
    value = states @ of_u.T
    slope = np.broadcast_to(of_u, (*value.shape, STATES))
    by_force = c.of_F - (c.of_a * drive.inverse) @ G.T
    if not np.any(by_force):
        return value, slope
    force, stiff = mesh_forces(G, states, drive, at)
    value = value + force @ by_force.T + drive.tau[at] @ (c.of_a * drive.inverse).T
    by_x = (by_force * stiff[..., None, :]) @ G
    by_v = (by_force * drive.c[at][..., None, :]) @ G
    slope = slope + np.concatenate([by_x, by_v], axis=-1)
    return value, slope
