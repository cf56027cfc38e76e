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
from herringbone_sim.gap.observations.rollout import STATES, Forcing

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WindowChannels:
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


def window_channels(run: PreparedRun) -> WindowChannels:
    """All channels of a run that windows can follow."""
    layout = run.model.layout
    bodies, meshes = np.eye(len(layout.bodies)), np.eye(layout.n_mesh)
    kinds: tuple[tuple[str, tuple[str, ...], Measured, Array], ...] = (
        ("u", layout.bodies, run.u, bodies),
        ("F", layout.meshes, run.F, meshes),
        ("F", pin_names(layout), run.pin, pin_weights(layout)),
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
    return WindowChannels(
        tuple(names),
        np.array(parts["u"]),
        np.array(parts["F"]),
        np.array(parts["a"]),
        np.stack(values, axis=1),
        np.array(sigma),
    )


def pin_names(layout: Layout) -> tuple[str, ...]:
    """Names of the pins' gauges, without their quantity."""
    return tuple(f"pin{planet}" for planet in layout.planets)


def pin_weights(layout: Layout) -> Array:
    """(pins, n_mesh): a pin carries the forces of all meshes of its planet."""
    of = [mesh[2 : mesh.index("_")] for mesh in layout.meshes]
    return np.array([[float(p == str(planet)) for p in of] for planet in layout.planets])


def mesh_forces(
    G: Array, states: Array, forcing: Forcing, at: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Forces (..., n_mesh) at states (..., 18) of half steps (...), and contact stiffness."""
    half = STATES // 2
    x = states[..., :half] @ G.T + forcing.offset[at]
    v = states[..., half:] @ G.T + forcing.rate[at]
    over, under = x - forcing.plus[at], -x - forcing.minus[at]
    f = np.maximum(over, 0.0) - np.maximum(under, 0.0)
    stiff = forcing.k[at] * ((over > 0.0) | (under > 0.0))
    return forcing.k[at] * f + forcing.c[at] * v + forcing.extra_force[at], stiff


def channel_outputs(
    c: WindowChannels, states: Array, forcing: Forcing, at: NDArray[np.int64]
) -> tuple[Array, Array]:
    """What channels show of states (W, m, 18) at half steps (W, m), and its slope.

    Returns:
        (W, m, k) and (W, m, k, 18).
    """
    G = forcing.G
    of_u = np.hstack([c.of_u, np.zeros_like(c.of_u)])
    value = states @ of_u.T
    slope = np.broadcast_to(of_u, (*value.shape, STATES))
    by_force = c.of_F - (c.of_a * forcing.inverse) @ G.T
    if not np.any(by_force):
        return value, slope
    force, stiff = mesh_forces(G, states, forcing, at)
    value = value + force @ by_force.T + forcing.tau[at] @ (c.of_a * forcing.inverse).T
    by_x = (by_force * stiff[..., None, :]) @ G
    by_v = (by_force * forcing.c[at][..., None, :]) @ G
    slope = slope + np.concatenate([by_x, by_v], axis=-1)
    return value, slope
