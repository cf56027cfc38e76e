"""Lyapunov exponents of one motion by several methods, and the kind of the motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from herringbone_sim.analysis.lyapunov import LONGEST, Exponent, largest_exponent
from herringbone_sim.analysis.periods import MIN_REPEATS, find_period
from herringbone_sim.analysis.zero_one import ZeroOne, zero_one_test
from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model, divergence
from herringbone_sim.dynamics.attractors import Attractor
from herringbone_sim.dynamics.flow import GearFlow, effect_cycles, iterate, settle, symmetry
from herringbone_sim.dynamics.growth import Growth
from herringbone_sim.dynamics.spectrum import lyapunov_spectrum
from herringbone_sim.dynamics.transverse import SymmetryExponents, symmetric_exponents
from herringbone_sim.dynamics.two_trajectories import DISTANCES, over_distances

TURNING = 200  # periods in which perturbations align with the directions of growth
SIGMAS, NEUTRAL = 4.0, 5e-4  # an exponent is non-zero beyond both, see motion_kind


@dataclass(frozen=True)
class ExponentComparison:
    """Exponents of one motion per unit of tau, by every method.

    Attributes:
        spectrum: all exponents, from the tangent flow.
        divergence: trace of the Jacobian, which the sum of the spectrum must equal; NaN if it
            depends on the state, see ``core.model.divergence``.
        distances: (m,) initial distances of the two-trajectory method.
        two_trajectories: (m, 2) largest exponent and its standard error at each distance.
        symmetric: exponents of symmetric and antisymmetric perturbations, as many of each as there
            are of the latter; None for a motion without left-right symmetry.
        section: (cycles, n) states at phase 0.
        longest: longest period that is looked for in the section, in mesh cycles.
        series: largest exponent estimated from the section alone, per mesh cycle.
        zero_one: 0-1 test for chaos on the first coordinate of the section.
    """

    spectrum: Growth
    divergence: float
    distances: Array
    two_trajectories: Array
    symmetric: SymmetryExponents | None
    section: Array
    longest: int
    series: Exponent
    zero_one: ZeroOne

    @property
    def motion(self) -> str:
        """Kind of the motion (``motion_kind``); whether left and right are equal, and stay so."""
        if self.symmetric is None:
            return motion_kind(self.section, self.spectrum, self.longest)
        lasts = not _positive(self.symmetric.transverse)
        words = "left = right" if lasts else "left = right, transversally unstable"
        return f"{motion_kind(self.section, self.symmetric.within, self.longest)}, {words}"


def compare_exponents(
    model: Model,
    cycles: int = 2000,
    transient: int = 1000,
    seed: int = 0,
    step: Callable[[str], None] = lambda name: None,
) -> ExponentComparison:
    """Compute the exponents of the motion from the initial state by every method, and a 0-1 test.

    Args:
        model: the gear, with its effects, see ``effects.assemble``.
        cycles: mesh cycles that each method evaluates. Methods by perturbations integrate
            ``TURNING`` cycles more before these, in which the perturbations align.
        transient: mesh cycles discarded before that.
        seed: of the bootstrap resampling for the interval of the exponent of the section, and of
            the frequencies of the 0-1 test.
        step: called with a name before each of five stages: transient, spectrum, two trajectories,
            left and right, recorded series (which includes the 0-1 test).

    Raises:
        DivergenceError: the state left the range of any physical motion.
        AnalysisError: too few cycles for a method.
        ParameterError: tangents can't be integrated, see ``GearFlow.advance``.
    """
    flow, exchange, rng = GearFlow(model, 1), symmetry(model), np.random.default_rng(seed)
    step("transient")
    y = settle(flow, flow.start(), transient)
    step("spectrum")
    spectrum = lyapunov_spectrum(flow, y, cycles, TURNING, at=transient)
    step("two trajectories")
    pairs = over_distances(flow, y, DISTANCES, cycles, TURNING, at=transient)
    step("left and right")
    symmetric = None
    if exchange is not None and np.array_equal(y, y[exchange]):
        half = int(np.sum(exchange > np.arange(flow.n)))
        symmetric = symmetric_exponents(flow, y, exchange, cycles, TURNING, half, transient)
    step("recorded series")
    section = iterate(flow, y, cycles, transient)
    return ExponentComparison(
        spectrum=spectrum,
        divergence=divergence(model),
        distances=np.array(DISTANCES),
        two_trajectories=pairs,
        symmetric=symmetric,
        section=section,
        longest=LONGEST * effect_cycles(model),
        series=largest_exponent(section, rng),
        zero_one=zero_one_test(section[:, 0], rng),
    )


def motion_kind(section: Array, spectrum: Growth, longest: int = LONGEST) -> str:
    """Name the kind of a motion: ``P2``, ``quasi-periodic``, ``chaotic``, ``hyperchaotic``, ...

    Hyperchaotic means two positive exponents. An exponent counts as non-zero beyond 4 standard
    errors and 5e-4. A motion that does not repeat and has no positive exponent is quasi-periodic
    if the largest one is zero, and ``a long period`` if all are negative.

    Args:
        section: (cycles, n) states at phase 0.
        spectrum: growth of perturbations of the motion.
        longest: longest period that is looked for, in mesh cycles.
    """
    positive = _positive(spectrum)
    if positive:
        return "chaotic" if positive == 1 else "hyperchaotic"
    period = find_period(section, max_period=longest).value
    if period:
        return f"P{period}"
    return "a long period" if spectrum.exponents[0] < -_floor(spectrum)[0] else "quasi-periodic"


def identify_motion(
    model: Model, attractor: Attractor, cycles: int = 1000, transient: int = 200, at: int = 0
) -> tuple[str, Growth]:
    """Name the kind of the motion on an attractor, and compute its two largest exponents.

    A symmetric motion is named after the exponents of symmetric perturbations (``motion_kind``);
    the returned exponents are those of all perturbations.

    Args:
        cycles: mesh cycles averaged over.
        transient: mesh cycles before, in which perturbations align.
        at: mesh cycles elapsed before the last point of the attractor, the initial state.
    """
    flow, exchange, y = GearFlow(model, 1), symmetry(model), attractor.points[-1]
    whole = growth = lyapunov_spectrum(flow, y, cycles, transient, k=2, at=at)
    if exchange is not None and np.array_equal(y, y[exchange]):
        growth = symmetric_exponents(flow, y, exchange, cycles, transient, k=2, at=at).within
    longest = max(LONGEST, 2 * effect_cycles(model))
    section = iterate(flow, whole.end, MIN_REPEATS * longest, at + transient + cycles)
    return motion_kind(section, growth, longest), whole


def _positive(growth: Growth) -> int:
    """Number of positive exponents."""
    return int(np.sum(growth.exponents > _floor(growth)))


def _floor(growth: Growth) -> Array:
    """(k,) absolute value above which an exponent counts as non-zero."""
    floor: Array = np.maximum(SIGMAS * growth.errors, NEUTRAL)
    return floor
