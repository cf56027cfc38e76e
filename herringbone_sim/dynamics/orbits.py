"""Periodic orbits of a flow, stable or not, by multiple shooting; their Floquet multipliers.

An orbit of period n is n states with P(y_i) = y_(i+1) and P(y_(n-1)) = y_0, P being the map over
one forcing period. All n states are unknowns at once, so that an orbit that repels by a factor of
a thousand is no harder than one that attracts. Its Floquet multipliers are the eigenvalues of the
product of the n Jacobians (Parker and Chua, Practical Numerical Algorithms for Chaotic Systems,
1989, ch. 5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.dynamics.flow import Flow, iterate
from herringbone_sim.dynamics.newton import newton
from herringbone_sim.errors import AnalysisError, DivergenceError

Complex = NDArray[np.complex128]

SYMMETRIC = 1e-9
EQUAL = 1e-6  # largest distance of states that count as one


@dataclass(frozen=True)
class Orbit:
    """A periodic orbit, or the last iterate of a failed search.

    Attributes:
        points: (period, n) states at phase 0, one per forcing period.
        jacobians: (period, n, n) of the map at each state.
        reason: why the search failed; empty if it converged.
    """

    points: Array
    jacobians: Array
    reason: str = ""

    @property
    def period(self) -> int:
        return len(self.points)

    @property
    def converged(self) -> bool:
        return not self.reason


@dataclass(frozen=True)
class Multipliers:
    """Floquet multipliers over the whole period, in descending order of modulus.

    Attributes:
        within: (k,) complex, of left-right symmetric perturbations; of all perturbations for an
            orbit without that symmetry.
        transverse: (n - k,) complex, of left-right antisymmetric perturbations.
    """

    within: Complex
    transverse: Complex

    @property
    def all(self) -> Complex:
        """(n,) all multipliers, in descending order of modulus."""
        both = np.concatenate([self.within, self.transverse])
        return both[np.argsort(-np.abs(both), kind="stable")]

    @property
    def unstable(self) -> tuple[int, int]:
        """Number of multipliers outside the unit circle: (within, transverse)."""
        return int((np.abs(self.within) > 1).sum()), int((np.abs(self.transverse) > 1).sum())


def find_orbit(flow: Flow, start: Array, period: int = 1, mirror: Indices | None = None) -> Orbit:
    """Find a periodic orbit near a first guess by Newton's method.

    Args:
        start: (n,) a state, or (period, n) successive states.
        period: in forcing periods; not used if ``start`` has successive states.
        mirror: (n,) indices that swap left and right. From a start with equal halves only
            symmetric states are searched, where a transverse multiplier of 1 does not make the
            Jacobian singular.

    Returns:
        The orbit; its ``reason`` tells whether the search failed.
    """
    points = np.array(start, dtype=float)
    try:
        points = points if points.ndim == 2 else iterate(flow, points, period)
    except DivergenceError as error:
        nothing = np.full((period, flow.n, flow.n), np.nan)
        return Orbit(np.tile(points, (period, 1)), nothing, str(error))
    basis, period = basis_of(points, mirror), len(points)

    def equations(z: Array) -> tuple[Array, Array]:
        return shoot(flow, z, basis)

    solution = newton(equations, (points @ basis).ravel())
    points = solution.z.reshape(period, -1) @ basis.T
    try:
        jacobians = np.array([flow.advance(y, np.eye(flow.n))[1].T for y in points])
    except DivergenceError:
        jacobians = np.full((period, flow.n, flow.n), np.nan)
    return Orbit(points, jacobians, solution.reason)


def shoot(flow: Flow, z: Array, basis: Array) -> tuple[Array, Array]:
    """Residual (period k,) and Jacobian (period k, period k) of the equations that close an orbit.

    Args:
        z: (period k,) coordinates of the states in the basis.
        basis: (n, k) orthonormal columns; the flow must map their span into itself.
    """
    k = basis.shape[1]
    points = z.reshape(-1, k) @ basis.T
    period = len(points)
    residual, jacobian = np.empty((period, k)), np.zeros((period, k, period, k))
    for i, y in enumerate(points):
        following = (i + 1) % period
        image, tangents = flow.advance(y, basis.T)
        residual[i] = basis.T @ (image - points[following])
        jacobian[i, :, i] += basis.T @ tangents.T
        jacobian[i, :, following] -= np.eye(k)
    return residual.ravel(), jacobian.reshape(period * k, period * k)


def multipliers(orbit: Orbit, mirror: Indices | None = None) -> Multipliers:
    """Floquet multipliers of an orbit, split by left-right symmetry where the orbit has it.

    Raises:
        AnalysisError: the search for the orbit did not converge.
    """
    if not orbit.converged:
        raise AnalysisError(f"multipliers need a periodic orbit: {orbit.reason}")
    even = basis_of(orbit.points, mirror)
    odd = (
        symmetry_bases(mirror)[1]
        if even.shape[1] < len(even) and mirror is not None
        else even[:, :0]
    )
    return Multipliers(_eigenvalues(orbit, even), _eigenvalues(orbit, odd))


def _eigenvalues(orbit: Orbit, basis: Array) -> Complex:
    """Eigenvalues (k,) of the monodromy matrix on the span of a basis (n, k), largest first."""
    product = np.eye(basis.shape[1])
    for jacobian in orbit.jacobians:
        product = basis.T @ jacobian @ basis @ product
    values = np.linalg.eigvals(product).astype(complex)
    return values[np.argsort(-np.abs(values), kind="stable")]


def is_symmetric(points: Array, mirror: Indices) -> bool:
    """Tell whether left and right of all states (..., n) are equal to 1e-9."""
    return bool(np.abs(points - points[..., mirror]).max() <= SYMMETRIC)


def basis_of(points: Array, mirror: Indices | None) -> Array:
    """Orthonormal basis (n, k) of the symmetric states for a symmetric orbit, else of all."""
    n = points.shape[-1]
    return (
        np.eye(n)
        if mirror is None or not is_symmetric(points, mirror)
        else symmetry_bases(mirror)[0]
    )


def symmetry_bases(mirror: Indices) -> tuple[Array, Array]:
    """Orthonormal bases (n, k) of the symmetric and (n, n - k) of the antisymmetric states."""
    unit = np.eye(len(mirror))
    first = [i for i, other in enumerate(mirror) if i < other]
    own = [i for i, other in enumerate(mirror) if i == other]
    even = [(unit[i] + unit[mirror[i]]) / np.sqrt(2.0) for i in first] + [unit[i] for i in own]
    odd = [(unit[i] - unit[mirror[i]]) / np.sqrt(2.0) for i in first]
    return np.array(even).T, np.array(odd).reshape(-1, len(mirror)).T


def closest_return(flow: Flow, y: Array, period: int, cycles: int) -> Array:
    """Part (period, n) of a trajectory whose end comes closest to its beginning.

    It is a first guess of a periodic orbit for Newton's method.

    Args:
        y: (n,) first state of the trajectory.
        period: length of the part [forcing periods].
        cycles: number of beginnings that are compared [forcing periods].

    Raises:
        DivergenceError: the trajectory left the range of any physical motion.
    """
    states = iterate(flow, y, cycles + period)
    gaps = np.linalg.norm(states[period:] - states[:-period], axis=1)
    first = int(np.argmin(gaps))
    return states[first : first + period]


def least_period(points: Array) -> int:
    """Least period of the states (period, n) of an orbit: 1 where all are equal to 1e-6."""
    n = len(points)
    return next(
        p
        for p in range(1, n + 1)
        if n % p == 0 and np.abs(points - np.roll(points, p, axis=0)).max() <= EQUAL
    )
