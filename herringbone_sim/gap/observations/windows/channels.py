"""Channels to which windows are fitted, as functions of the state.

Each channel is a weighted sum of rotations u, mesh forces F and accelerations
d2u/dt2 = M^-1 (tau - G' F).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import compress

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from herringbone_sim.arrays import Array
from herringbone_sim.core.layout import Layout
from herringbone_sim.gap.data.prepared import PreparedRun
from herringbone_sim.gap.observations.windows.integrator import STATES, Forcing


@dataclass(frozen=True)
class WindowChannels:
    """k recorded channels as weighted sums of rotations, mesh forces and accelerations.

    Attributes:
        names: (k,) channel names.
        of_u, of_F, of_a: weights of u (k, 9), mesh forces (k, n_mesh), accelerations (k, 9).
        values: (n, k) recorded values, NaN where there is no reading.
        sigma: (k,) standard deviation of the noise.
    """

    names: tuple[str, ...]
    of_u: Array
    of_F: Array
    of_a: Array
    values: Array
    sigma: Array

    def only(self, i: int) -> WindowChannels:
        """Copy with channel i alone."""
        channel = slice(i, i + 1)
        return WindowChannels(
            self.names[channel],
            self.of_u[channel],
            self.of_F[channel],
            self.of_a[channel],
            self.values[:, channel],
            self.sigma[channel],
        )


def window_channels(run: PreparedRun) -> WindowChannels:
    """All recorded rotations, mesh forces, pin forces and accelerations of a run."""
    layout = run.model.layout
    each, n = np.eye(len(layout.bodies)), layout.n_mesh
    forces = np.vstack([np.eye(n)[run.F.recorded], pin_weights(layout)[run.pin.recorded]])
    whole = block_diag(each[run.u.recorded], forces, each[run.a.recorded])
    of_u, of_F, of_a = np.split(whole, [len(each), len(each) + n], axis=1)
    kinds = {"u": run.u, "F": run.F, "pin": run.pin, "a": run.a}
    return WindowChannels(
        tuple(c for q, m in kinds.items() for c in compress(layout.channels_of(q), m.recorded)),
        of_u,
        of_F,
        of_a,
        np.hstack([m.values[:, m.recorded] for m in kinds.values()]),
        np.concatenate([m.sigma[m.recorded] for m in kinds.values()]),
    )


def pin_weights(layout: Layout) -> Array:
    """(pins, n_mesh) weights: the force on a pin is the sum over all meshes of its planet."""
    of = [mesh[2 : mesh.index("_")] for mesh in layout.meshes]
    return np.array([[float(p == str(planet)) for p in of] for planet in layout.planets])


def mesh_forces(
    G: Array, states: Array, forcing: Forcing, at: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Mesh forces (..., n_mesh) [N] and stiffness in contact, else 0 [N/m], at states (..., 18).

    Args:
        G: (n_mesh, 9) displacements of the meshes by rotations of the bodies.
        at: (...) indices of the half steps of ``forcing`` at which the states are.
    """
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
    """Values (W, m, k) of k channels, and their derivatives by the state (W, m, k, 18).

    Args:
        c: the channels.
        states: (W, m, 18) of m samples in W windows [m], [m/s].
        forcing: of the windows.
        at: (W, m) indices of the half steps at which the samples lie.
    """
    G = forcing.G
    of_u = np.hstack([c.of_u, np.zeros_like(c.of_u)])
    value = states @ of_u.T
    slope = np.broadcast_to(of_u, (*value.shape, STATES))
    by_force = c.of_F - (c.of_a * forcing.inverse_masses) @ G.T
    if not np.any(by_force):
        return value, slope
    force, stiff = mesh_forces(G, states, forcing, at)
    value = value + force @ by_force.T + forcing.tau[at] @ (c.of_a * forcing.inverse_masses).T
    by_x = (by_force * stiff[..., None, :]) @ G
    by_v = (by_force * forcing.c[at][..., None, :]) @ G
    slope = slope + np.concatenate([by_x, by_v], axis=-1)
    return value, slope
