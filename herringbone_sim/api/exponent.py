"""Lyapunov exponents of a gear in Python."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from herringbone_sim.api.gear import Gear, any_gear, model_of
from herringbone_sim.api.shown import NotebookResult, Picture
from herringbone_sim.core import integrate
from herringbone_sim.dynamics.exponent_methods import ExponentComparison, compare_exponents
from herringbone_sim.dynamics.spectrum import kaplan_yorke
from herringbone_sim.views.figures.exponents import exponents_figure


@any_gear()
def largest_exponent(
    gear: Gear = None,
    cycles: int = 500,
    transient: int = 200,
    effects: str | None = None,
    **changes: Any,
) -> tuple[float, float]:
    """Largest Lyapunov exponent per unit of the dimensionless time, and its standard error.

    Args:
        gear: parameters, a parameter file, or None for Tables 1 and 2 of the paper.
        cycles: mesh cycles averaged over, at least 2.
        transient: mesh cycles discarded first.
        effects: text that replaces the effects of the file, see ``simulate``; None to use those.
        changes: parameters by name.

    Raises:
        ParameterError: fewer than 2 cycles, a value out of range, or no such effect.
        DivergenceError: the motion diverges.
    """
    return integrate.largest_exponent(model_of(gear, effects, changes), cycles, transient)


@dataclass(frozen=True, repr=False)
class Exponents(NotebookResult):
    """Lyapunov exponents of one motion by all methods.

    Attributes:
        methods: tangent flow, two trajectories, symmetry, recorded series, 0-1 test.
    """

    methods: ExponentComparison

    @property
    def spectrum(self) -> Any:
        """Lyapunov exponents (n,) per unit of the dimensionless time, descending."""
        return self.methods.spectrum.exponents

    def title(self) -> str:
        return self.methods.motion

    def facts(self) -> list[tuple[str, str]]:
        growth = self.methods.spectrum
        pairs = zip(growth.exponents, growth.errors, strict=True)
        alike = self.methods.symmetric
        own = growth if alike is None else alike.within  # the attractor lies in the symmetric part
        return [
            ("exponents", ", ".join(f"{value:+.4f} ± {error:.4f}" for value, error in pairs)),
            ("Kaplan-Yorke dimension", f"{kaplan_yorke(np.asarray(own.exponents)):.3f}"),
            ("0-1 test", f"{self.methods.zero_one.K:.3f}"),
        ]

    def plot(self) -> Picture:
        """Figure with convergence, spectrum, two trajectories and 0-1 test."""
        return Picture(exponents_figure(self.methods, ""))


@any_gear()
def exponents(
    gear: Gear = None,
    cycles: int = 2000,
    transient: int = 1000,
    effects: str | None = None,
    **changes: Any,
) -> Exponents:
    """Compute the Lyapunov exponents of the motion of a gear by all methods.

    Args:
        gear, effects, changes: as for ``largest_exponent``.
        cycles: mesh cycles that each method evaluates.
        transient: mesh cycles discarded first.

    Raises:
        ParameterError: a value out of range, or no such effect.
        DivergenceError: the motion diverges.
        AnalysisError: too few cycles for a method.
    """
    return Exponents(compare_exponents(model_of(gear, effects, changes), cycles, transient))
