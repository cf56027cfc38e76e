"""Flows whose exponents are known, for the tests of ``dynamics``."""

from __future__ import annotations

import numpy as np


class Henon:
    """Hénon map a = 1.4, b = 0.3. Exponents 0.4192, -1.6229 (Sprott, Chaos and Time-Series
    Analysis, 2003, p. 421); their sum is ln 0.3."""

    n, period = 2, 1.0

    def advance(self, y, tangents, at=0):
        jacobian = np.array([[-2.8 * y[0], 1.0], [0.3, 0.0]])
        return np.array([1.0 - 1.4 * y[0] ** 2 + y[1], 0.3 * y[0]]), tangents @ jacobian.T


class Lorenz:
    """Lorenz system 10, 28, 8/3 by RK4. Exponents 0.9056, 0, -14.5723 (Sprott, 2003, p. 431);
    their sum is -41/3."""

    n, period, h, steps = 3, 0.2, 0.01, 20

    def slope(self, z):
        x, y, w = z[0]
        J = np.array([[-10.0, 10.0, 0.0], [28.0 - w, -1.0, -x], [y, x, -8.0 / 3.0]])
        out = z @ J.T
        out[0] = 10.0 * (y - x), x * (28.0 - w) - y, x * y - 8.0 / 3.0 * w
        return out

    def advance(self, y, tangents, at=0):
        z, h = np.vstack([y, tangents]), self.h
        for _ in range(self.steps):
            a = self.slope(z)
            b = self.slope(z + h / 2 * a)
            c = self.slope(z + h / 2 * b)
            z = z + h / 6 * (a + 2 * b + 2 * c + self.slope(z + h * c))
        return z[0], z[1:]


class CoupledLogistic:
    """Two logistic maps r = 4 that leak a share eps into each other. In step they have the
    exponents ln 2 and ln 2 + ln |1 - 2 eps| (Pikovsky and Grassberger, 1991)."""

    n, period = 2, 1.0
    exchange = np.array([1, 0])

    def __init__(self, eps):
        self.eps = eps

    def advance(self, y, tangents, at=0):
        f, slope = 4.0 * y * (1.0 - y), 4.0 - 8.0 * y

        def mix(a):
            return (1.0 - self.eps) * a + self.eps * a[..., ::-1]

        return mix(f), mix(tangents * slope)


class Cubics:
    """Two cubic maps x -> r x - x^3 side by side; 1.5 < r < 2.598 keeps the sign of a start with
    0 < |x| < 1, so that four attractors share the starts evenly, two of them mirror images."""

    n, period = 2, 1.0
    exchange = np.array([1, 0])

    def __init__(self, r):
        self.r = r

    def sections(self, starts, transient=300, points=100):
        y = np.array(starts)
        kept = []
        for i in range(transient + points):
            y = self.r * y - y**3
            if i >= transient:
                kept.append(y)
        return np.array(kept).transpose(1, 0, 2)


def logistic(r, n, x=0.3, transient=1000):
    values = []
    for _ in range(transient + n):
        x = r * x * (1.0 - x)
        values.append(x)
    return np.array(values[transient:])


def circle_map(n, Omega=0.5 * (5**0.5 - 1), k=0.8):
    """sin(2 pi theta) of the sine circle map below the critical coupling: quasi-periodic."""
    theta, values = 0.1, []
    for _ in range(n):
        theta += Omega - k / (2 * np.pi) * np.sin(2 * np.pi * theta)
        values.append(np.sin(2 * np.pi * theta))
    return np.array(values)
