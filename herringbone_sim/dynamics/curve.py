"""The curve that a periodic orbit describes as a parameter varies.

A place on it is z = (points / sqrt(period), s), where s in 0 .. 1 is the place of the parameter in
its range. With one equation less than unknowns, a place is fixed by a hyperplane that cuts the
curve: the orbit at a value of the parameter, or the next one at a step along the tangent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.dynamics.flow import Flow
from herringbone_sim.dynamics.newton import newton
from herringbone_sim.dynamics.orbits import (
    Array,
    Multipliers,
    Orbit,
    basis_of,
    multipliers,
    shoot,
)
from herringbone_sim.errors import AnalysisError

DIFFERENCE = 1e-7  # of the range of the parameter


@dataclass(frozen=True)
class Family:
    """Flows over the range of one parameter.

    Attributes:
        flow_at: the flow at a value; ParameterError where there is none.
        low, high: the range.
        mirror: (n,) indices that swap left and right, or None.
    """

    flow_at: Callable[[float], Flow]
    low: float
    high: float
    mirror: NDArray[np.int64] | None = None

    def value(self, s: float) -> float:
        return self.low + s * (self.high - self.low)


@dataclass(frozen=True)
class BranchPoint:
    """An orbit of a branch.

    Attributes:
        value: of the parameter.
        z: (period k + 1,) its place on the curve.
        tangent: (period k + 1,) unit tangent of the curve, in the direction of travel.
        orbit: states and Jacobians.
        multipliers: over the period.
        iterations: Newton steps that it took.
    """

    value: float
    z: Array
    tangent: Array
    orbit: Orbit
    multipliers: Multipliers
    iterations: int

    @property
    def stable(self) -> bool:
        return self.multipliers.unstable == (0, 0)


class Curve:
    """Orbits of one period and symmetry over a family; a place z is all that tells one apart.

    Args:
        period: in periods of the forcing.
        basis: (n, k) orthonormal columns of the states that count.
    """

    def __init__(self, family: Family, period: int, basis: Array) -> None:
        self.family, self.period, self.basis = family, period, basis
        self._scale = np.sqrt(period)

    @property
    def symmetric(self) -> bool:
        """Whether left and right are alike along it."""
        return int(self.basis.shape[1]) < len(self.basis)

    def place(self, points: Array, value: float) -> Array:
        """z of an orbit at a value."""
        s = (value - self.family.low) / (self.family.high - self.family.low)
        return np.append((points @ self.basis).ravel() / self._scale, s)

    def points(self, z: Array) -> Array:
        """States (period, n) of a place."""
        states: Array = (z[:-1] * self._scale).reshape(self.period, -1) @ self.basis.T
        return states

    def equations(self, z: Array) -> tuple[Array, Array]:
        """Closing equations (period k,) and their Jacobian (period k, period k + 1) by z."""
        inner, s = z[:-1] * self._scale, float(z[-1])
        residual, by_points = shoot(self.family.flow_at(self.family.value(s)), inner, self.basis)
        ds = DIFFERENCE if s < 0.5 else -DIFFERENCE
        aside = self.family.flow_at(self.family.value(s + ds))
        by_s = np.empty_like(residual)
        none = np.zeros((0, aside.n))
        images = np.array([aside.advance(y, none)[0] for y in self.points(z)])
        by_s = ((images - np.roll(self.points(z), -1, axis=0)) @ self.basis).ravel() - residual
        return residual, np.column_stack([by_points * self._scale, by_s / ds])

    def solve(self, guess: Array, across: Array, tangent: Array | None = None) -> BranchPoint:
        """The orbit of the curve in the hyperplane through the guess with normal ``across``.

        Args:
            tangent: the direction of travel is the one nearer to it; ``across`` by default.

        Raises:
            AnalysisError: Newton's method failed.
        """

        def bordered(z: Array) -> tuple[Array, Array]:
            residual, jacobian = self.equations(z)
            return np.append(residual, across @ (z - guess)), np.vstack([jacobian, across])

        found = newton(bordered, guess)
        if found.reason:
            raise AnalysisError(f"no orbit of period {self.period}: {found.reason}")
        along = self.tangent(found.z)
        ahead = across if tangent is None else tangent
        return self._point(found.z, along if along @ ahead >= 0 else -along, found.iterations)

    def tangent(self, z: Array) -> Array:
        """Unit null vector of the Jacobian; its sign is arbitrary."""
        null: Array = np.linalg.svd(self.equations(z)[1])[2][-1]
        return null

    def _point(self, z: Array, tangent: Array, iterations: int) -> BranchPoint:
        value, points = self.family.value(float(z[-1])), self.points(z)
        flow = self.family.flow_at(value)
        jacobians = np.array([flow.advance(y, np.eye(flow.n))[1].T for y in points])
        orbit = Orbit(points, jacobians, 0.0, iterations)
        mirror = self.family.mirror if self.symmetric else None
        return BranchPoint(value, z, tangent, orbit, multipliers(orbit, mirror), iterations)


def begin(family: Family, points: Array, value: float) -> tuple[Curve, BranchPoint]:
    """The curve through an orbit, and the orbit on it, travelling to higher values.

    Args:
        points: (period, n) states of the orbit, or near them.

    Raises:
        AnalysisError: there is no orbit near.
    """
    curve = Curve(family, len(points), basis_of(points, family.mirror))
    z = curve.place(points, value)
    return curve, curve.solve(z, np.eye(len(z))[-1])


def backwards(point: BranchPoint) -> BranchPoint:
    """The same orbit, travelling the other way."""
    return replace(point, tangent=-point.tangent)
