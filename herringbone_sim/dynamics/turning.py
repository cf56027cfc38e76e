"""Turning points of the mesh displacements of an orbit, and its crossings of the backlash edges.

An orbit grazes where a displacement turns back exactly on an edge x = +-b': a contact appears or
is lost there. Between two turning points a displacement is monotonic, so it crosses an edge if and
only if successive turning points lie on opposite sides of it.
"""

from __future__ import annotations

import numpy as np

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.core.integrate import State, stepper
from herringbone_sim.core.model import Model, relative
from herringbone_sim.core.packed import TWO_PI
from herringbone_sim.dynamics.flow import Flow, GearFlow
from herringbone_sim.dynamics.orbits import is_symmetric
from herringbone_sim.effects.assemble import changed
from herringbone_sim.errors import AnalysisError

Passes = dict[str, int]

SAMPLES = 128  # per mesh cycle: turning points are then found to 1e-8


def border_passes(flow: Flow, points: Array, mirror: Indices | None = None) -> Passes:
    """Count the crossings of each backlash edge by each mesh over an orbit of a gear.

    Args:
        points: (period, n) states of the orbit.
        mirror: indices that swap left and right. If the halves of the orbit are equal, a mesh and
            its mirror image are counted once, under a name like ``sp_L = sp_R``.

    Returns:
        Crossings by edge, such as ``sp_L drive`` for x = +b' and ``sp_L back`` for x = -b'.

    Raises:
        AnalysisError: the flow is not that of a gear.
    """
    gear = _gear(flow)
    x, v = _trajectory(gear, points)
    layout, b, h = gear.model.layout, gear.model.packed.b, gear.period / gear.cycles / SAMPLES
    symmetric = mirror is not None and is_symmetric(points, mirror)
    passes = {}
    for m, mesh in enumerate(layout.meshes):
        if symmetric and mesh.endswith("_R"):
            continue
        name = f"{mesh} = {layout.meshes[m + layout.n_classes]}" if symmetric else mesh
        heights = turning_points(x[:, m], v[:, m], h)
        passes[f"{name} drive"] = _passes(heights, b[m])
        passes[f"{name} back"] = _passes(heights, -b[m])
    return passes


def section(flow: Flow, points: Array) -> tuple[Array, Array]:
    """Relative displacements and velocities of the meshes at the states (period, n) of an orbit.

    As the channels x_ and v_: without displacements that effects add, which ``border_passes``
    includes.

    Returns:
        Two arrays (period, n_mesh), in units of b_c and b_c omega_n.

    Raises:
        AnalysisError: the flow is not that of a gear.
    """
    model = _gear(flow).model
    both = np.array([relative(model, y, 0.0) for y in points[:, : model.layout.n_state]])
    return both[:, 0], both[:, 1]


def _gear(flow: Flow) -> GearFlow:
    if not isinstance(flow, GearFlow):
        raise AnalysisError(f"meshes need a GearFlow, got {type(flow).__name__}")
    return flow


def turning_points(x: Array, v: Array, h: float) -> Array:
    """Displacements where the velocity of a closed orbit changes its sign, by cubic interpolation.

    Args:
        x, v: (n,) displacements and velocities over one period; sample n would be sample 0 again.
        h: time between samples.
    """
    x1, v1 = np.roll(x, -1), np.roll(v, -1)
    at = np.flatnonzero((v > 0) != (v1 > 0))
    x0, v0, x1, v1 = x[at], v[at] * h, x1[at], v1[at] * h
    a, c = 2 * (x0 - x1) + v0 + v1, 3 * (x1 - x0) - 2 * v0 - v1
    # The root of 3 a s^2 + 2 c s + v0 in 0 .. 1, in the form that is stable for a = 0.
    root = np.sqrt(np.maximum(c * c - 3 * a * v0, 0.0))
    s = -v0 / (c + np.where(v0 < 0, root, -root))
    heights: Array = x0 + s * (v0 + s * (c + s * a))
    return heights


def _passes(heights: Array, level: float) -> int:
    """Number of crossings of a level over a closed orbit, from all its turning points (m,)."""
    beyond = heights > level
    return int((beyond != np.roll(beyond, 1)).sum())


def _trajectory(flow: GearFlow, points: Array) -> tuple[Array, Array]:
    """Mesh deflections and velocities (samples, n_mesh) over an orbit, in b_c and b_c omega_n.

    For a gear by the laws of its effects without the displacements by states that these add.
    """
    p = flow.model.parameters.changed({"samples_per_cycle": SAMPLES})
    model = changed(flow.model, p)
    gear_stepper, n, s = stepper(model), model.layout.n_mesh, model.scales
    count = SAMPLES * flow.cycles
    added, rate = displacement(model, np.arange(count) / SAMPLES)
    x, v = np.empty((2, len(points), count, n))
    for i, y in enumerate(points):
        state = State(y, 0, 0, 0.0, np.zeros((0, len(y))), np.zeros(0))
        moved = np.zeros((2, count, n))
        if model.n_added_coordinates and model.integrator is None:
            states, _, _, grid_points = gear_stepper.trace(state, count)
            rows = gear_stepper.read(states, grid_points)
            added_states = states[:, model.layout.n_state :].reshape(count, 2, -1)
            moved = added_states.swapaxes(0, 1) @ model.packed.added_shift
        else:
            rows = gear_stepper.advance(state, count).rows
        x[i] = rows[:, 5 : 5 + n] / s.b_c + added + moved[0]
        v[i] = rows[:, 5 + n : 5 + 2 * n] / s.velocity_m_per_s + rate + moved[1]
    return x.reshape(-1, n), v.reshape(-1, n)


def displacement(model: Model, cycles: Array) -> tuple[Array, Array]:
    """Displacement d and velocity dd/dtau (k, n_mesh) that effects add to the mesh deflections.

    Sampled rows do not contain them. In units of b_c and b_c omega_n, without displacements by
    states that effects add.

    Args:
        cycles: (k,) times in mesh cycles since phase 0.
    """
    p = model.packed
    d = np.tile(p.d_mean, (len(cycles), 1))
    rate = np.zeros_like(d)
    for order, cos, sin in zip(p.orders, p.d_cos, p.d_sin, strict=False):
        angle = TWO_PI * np.mod(order * cycles, 1.0)[:, None]
        d += cos * np.cos(angle) + sin * np.sin(angle)
        rate += order * p.Omega * (sin * np.cos(angle) - cos * np.sin(angle))
    for (period, middle, width), height in zip(p.events, p.event_d, strict=True):
        s = (np.mod(cycles - middle + 0.5 * period, period) - 0.5 * period)[:, None]
        inside = np.abs(s) < 0.5 * width
        angle = TWO_PI * s / width
        d += height * inside * (0.5 + 0.5 * np.cos(angle))
        rate -= height * inside * 0.5 * p.Omega / width * np.sin(angle)
    return d, rate
