"""Flows whose orbits are known in closed form, and others to test against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from herringbone_sim.dynamics.continuation import follow_both
from herringbone_sim.dynamics.curve import Family, begin
from herringbone_sim.dynamics.turning import turning_points
from herringbone_sim.errors import DivergenceError


@dataclass(frozen=True)
class MapFlow:
    """A map given by its value and its Jacobian."""

    n: int
    value: object
    jacobian: object
    period: float = 1.0

    def advance(self, y, tangents, at=0):
        if np.abs(y).max() > 1e6:
            raise DivergenceError("the map left the range")
        return self.value(y), tangents @ self.jacobian(y).T


def logistic(r):
    """x -> r x (1 - x): flip at r = 3 and 1 + sqrt(6), P3 by a fold at 1 + sqrt(8)."""
    return MapFlow(1, lambda y: r * y * (1 - y), lambda y: np.array([[r * (1 - 2 * y[0])]]))


def henon(a, b=0.3):
    """(x, y) -> (1 - a x^2 + y, b x): fold at a = -(1 - b)^2 / 4, flip at 3 (1 - b)^2 / 4."""
    return MapFlow(
        2,
        lambda y: np.array([1 - a * y[0] ** 2 + y[1], b * y[0]]),
        lambda y: np.array([[-2 * a * y[0], 1.0], [b, 0.0]]),
    )


def delayed_logistic(a):
    """(x, y) -> (a x (1 - y), x): Neimark-Sacker at a = 2, multipliers exp(+- i pi / 3)."""
    return MapFlow(
        2,
        lambda y: np.array([a * y[0] * (1 - y[1]), y[0]]),
        lambda y: np.array([[a * (1 - y[1]), -a * y[0]], [1.0, 0.0]]),
    )


def repelling(t):
    """(x, y) -> (y, t y - 1.5 x + x^3): multipliers of 0 are the roots of mu^2 - t mu + 1.5.

    A complex pair of modulus sqrt(1.5) up to t = sqrt(6), then two real ones; one passes 1 at 2.5.
    """
    return MapFlow(
        2,
        lambda y: np.array([y[1], t * y[1] - 1.5 * y[0] + y[0] ** 3]),
        lambda y: np.array([[0.0, 1.0], [3 * y[0] ** 2 - 1.5, t]]),
    )


def coupled(r, share):
    """Two logistic maps, each fed a share of the other: transverse multiplier (1 - 2 share) f'."""
    mix = np.array([[1 - share, share], [share, 1 - share]])
    return MapFlow(
        2,
        lambda y: mix @ (r * y * (1 - y)),
        lambda y: mix @ np.diag(r * (1 - 2 * y)),
    )


SWAP = np.array([1, 0])


@dataclass(frozen=True)
class LinearOscillator:
    """x'' + 2 D x' + x = F cos(Omega t), once a period; y = (x, x')."""

    damping: float
    force: float
    Omega: float
    n: int = 2

    @property
    def period(self):
        return 2 * np.pi / self.Omega

    @property
    def over_a_period(self):
        """exp(A T) with A = [[0, 1], [-1, -2 D]]."""
        D, T = self.damping, self.period
        w = np.sqrt(1 - D * D)
        A = np.array([[0.0, 1.0], [-1.0, -2 * D]])
        turned = np.cos(w * T) * np.eye(2) + np.sin(w * T) / w * (A + D * np.eye(2))
        return np.exp(-D * T) * turned

    @property
    def orbit(self):
        """The forced motion at phase 0."""
        response = self.force / (1 - self.Omega**2 + 2j * self.damping * self.Omega)
        return np.array([response.real, (1j * self.Omega * response).real])

    def advance(self, y, tangents, at=0):
        over = self.over_a_period
        return self.orbit + over @ (y - self.orbit), tangents @ over.T


class OneSidedOscillator:
    """x'' + 2 D x' + x + k max(x - gap, 0) = F cos(Omega t), by RK4 between located contacts.

    The free motion has amplitude F / |1 - Omega^2 + 2 i D Omega| and touches a stop at that gap.
    """

    n = 2

    def __init__(self, gap, force=1.0, damping=0.1, Omega=1.6, k=6.0, steps=48):
        self.gap, self.k, self.steps = gap, k, steps
        self.free = LinearOscillator(damping, force, Omega)
        self.period = self.free.period
        self.amplitude = force / abs(1 - Omega**2 + 2j * damping * Omega)

    def advance(self, y, tangents, at=0):
        z, h = np.column_stack([y, tangents.T]), self.period / self.steps
        for i in range(self.steps):
            z = self._step(z, i * h, h)
        return z[:, 0], z[:, 1:].T

    def _step(self, z, t, h):
        inside = z[0, 0] > self.gap
        end = self._rk4(z, t, h, inside)
        if (end[0, 0] > self.gap) == inside:
            return end
        low, high = 0.0, h
        for _ in range(18):
            middle = 0.5 * (low + high)
            same = (self._rk4(z, t, middle, inside)[0, 0] > self.gap) == inside
            low, high = (middle, high) if same else (low, middle)
        return self._rk4(self._rk4(z, t, high, inside), t + high, h - high, not inside)

    def _rk4(self, z, t, h, inside):
        def slope(z, t):
            stiffness = 1.0 + self.k * inside
            dz = np.array([z[1], -2 * self.free.damping * z[1] - stiffness * z[0]])
            dz[1, 0] += self.free.force * np.cos(self.free.Omega * t)
            dz[1, 0] += self.k * inside * self.gap
            return dz

        a = slope(z, t)
        b = slope(z + 0.5 * h * a, t + 0.5 * h)
        c = slope(z + 0.5 * h * b, t + 0.5 * h)
        d = slope(z + h * c, t + h)
        return z + h / 6 * (a + 2 * b + 2 * c + d)

    def touches(self, points):
        """Passes of the stop over an orbit."""
        h, states = self.period / self.steps, []
        for y in points:
            z = y[:, None]
            for i in range(self.steps):
                states.append(z[:, 0])
                z = self._step(z, i * h, h)
        heights = turning_points(*np.array(states).T, h)
        return {"stop": 2 * int((heights > self.gap).sum())}


def branch_of(flow_at, low, high, points, value, mirror=None, steps=None):
    """(curve, branch) through an orbit over a range."""
    family = Family(flow_at, low, high, mirror)
    curve, start = begin(family, np.atleast_2d(points), value)
    return curve, follow_both(curve, start, steps)
