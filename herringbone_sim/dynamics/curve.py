"""Curve of periodic orbits over a parameter, as a system with one equation less than unknowns.

The unknowns are z = (points / sqrt(period), s): points are the orbit's states in a basis of the
symmetric states or of all, s in 0 .. 1 is the parameter scaled to its range. One more equation, a
hyperplane that cuts the curve, fixes an orbit: the orbit at a value of the parameter, or the next
one of a continuation step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.dynamics.flow import Flow
from herringbone_sim.dynamics.newton import newton
from herringbone_sim.dynamics.orbits import Multipliers, Orbit, basis_of, multipliers, shoot
from herringbone_sim.errors import AnalysisError

DIFFERENCE = 1e-7  # step of the derivative by the parameter, as a fraction of its range


@dataclass(frozen=True)
class Family:
    """Flows over the range of one parameter.

    Attributes:
        flow_at: returns the flow at a value; raises ParameterError where no flow exists.
        low, high: ends of the range.
        mirror: (n,) indices that swap left and right, or None.
    """

    flow_at: Callable[[float], Flow]
    low: float
    high: float
    mirror: Indices | None = None

    def value(self, s: float) -> float:
        """Parameter value at s in 0 .. 1."""
        return self.low + s * (self.high - self.low)


@dataclass(frozen=True)
class BranchPoint:
    """An orbit of a branch.

    Attributes:
        value: value of the parameter.
        z: (period k + 1,) the unknowns, see above.
        tangent: (period k + 1,) unit tangent of the curve, in the direction of the continuation.
        orbit: states and Jacobians.
        multipliers: Floquet multipliers over the whole period.
        iterations: Newton iterations in which it was found.
    """

    value: float
    z: Array
    tangent: Array
    orbit: Orbit
    multipliers: Multipliers
    iterations: int


class Curve:
    """Orbits of one period and symmetry over a family of flows: their equations and a solver.

    Args:
        family: flows over the range of the parameter.
        period: in forcing periods.
        basis: (n, k) orthonormal columns that span the states: all, or the symmetric ones.
    """

    def __init__(self, family: Family, period: int, basis: Array) -> None:
        self.family, self.period, self.basis = family, period, basis
        self._scale = np.sqrt(period)

    @property
    def symmetric(self) -> bool:
        """Whether left and right are equal along the curve."""
        return int(self.basis.shape[1]) < len(self.basis)

    def place(self, points: Array, value: float) -> Array:
        """Unknowns z (period k + 1,) of an orbit, from its states (period, n) and its value."""
        s = (value - self.family.low) / (self.family.high - self.family.low)
        return np.append((points @ self.basis).ravel() / self._scale, s)

    def points(self, z: Array) -> Array:
        """States (period, n) of an orbit from the unknowns z, inverse of ``place``."""
        states: Array = (z[:-1] * self._scale).reshape(self.period, -1) @ self.basis.T
        return states

    def equations(self, z: Array) -> tuple[Array, Array]:
        """Closing equations (period k,) and their Jacobian (period k, period k + 1) by z.

        The column of the parameter is a difference quotient.
        """
        inner, s = z[:-1] * self._scale, float(z[-1])
        residual, by_points = shoot(self.family.flow_at(self.family.value(s)), inner, self.basis)
        ds = DIFFERENCE if s < 0.5 else -DIFFERENCE
        aside = self.family.flow_at(self.family.value(s + ds))
        none = np.zeros((0, aside.n))
        images = np.array([aside.advance(y, none)[0] for y in self.points(z)])
        by_s = ((images - np.roll(self.points(z), -1, axis=0)) @ self.basis).ravel() - residual
        return residual, np.column_stack([by_points * self._scale, by_s / ds])

    def solve(self, guess: Array, across: Array, tangent: Array | None = None) -> BranchPoint:
        """Find the orbit in the hyperplane through ``guess`` with the normal ``across``.

        Args:
            tangent: the new tangent is oriented along it; along ``across`` by default.

        Raises:
            AnalysisError: Newton's method failed.
        """

        def bordered(z: Array) -> tuple[Array, Array]:
            residual, jacobian = self.equations(z)
            return np.append(residual, across @ (z - guess)), np.vstack([jacobian, across])

        solution = newton(bordered, guess)
        if solution.reason:
            raise AnalysisError(f"no orbit of period {self.period}: {solution.reason}")
        along = self.tangent(solution.z)
        ahead = across if tangent is None else tangent
        return self._point(
            solution.z, along if along @ ahead >= 0 else -along, solution.iterations
        )

    def tangent(self, z: Array) -> Array:
        """Unit tangent (period k + 1,) of the curve at z; its sign is arbitrary."""
        null: Array = np.linalg.svd(self.equations(z)[1])[2][-1]
        return null

    def _point(self, z: Array, tangent: Array, iterations: int) -> BranchPoint:
        """Branch point at z, with orbit, Jacobians and multipliers computed."""
        value, points = self.family.value(float(z[-1])), self.points(z)
        flow = self.family.flow_at(value)
        jacobians = np.array([flow.advance(y, np.eye(flow.n))[1].T for y in points])
        orbit = Orbit(points, jacobians)
        mirror = self.family.mirror if self.symmetric else None
        return BranchPoint(value, z, tangent, orbit, multipliers(orbit, mirror), iterations)


def begin(family: Family, points: Array, value: float) -> tuple[Curve, BranchPoint]:
    """Find the orbit at a parameter value near given states, and the curve through it.

    Its tangent is oriented towards higher values.

    Args:
        points: (period, n) states of the orbit, or near them.

    Raises:
        AnalysisError: Newton's method finds no orbit near.
    """
    curve = Curve(family, len(points), basis_of(points, family.mirror))
    z = curve.place(points, value)
    return curve, curve.solve(z, np.eye(len(z))[-1])


def backwards(point: BranchPoint) -> BranchPoint:
    """The same branch point with its tangent reversed."""
    return replace(point, tangent=-point.tangent)
