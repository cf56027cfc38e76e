"""What the diagnosis asks of a machine: observations of its runs and a catalogue of hypotheses.

Amplitudes are the values at which functions act: observation -> function -> (runs, rows).
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.coefficients import Coefficient
from herringbone_sim.diagnosis.flexible import RegressionInputs
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.diagnosis.score import Score

Amplitudes = Mapping[str, Mapping[str, Array]]


class Machine(Protocol):
    """Interface of a machine: observations of its runs, linearised about any amplitudes.

    Attributes:
        base: coefficients that every hypothesis contains: the tolerances.
        rows: number of rows of each observation.
        runs: number of runs.
    """

    base: tuple[Coefficient, ...]
    rows: Mapping[str, int]
    runs: int

    @property
    def functions(self) -> Mapping[str, tuple[str, ...]]:
        """Names of the functions (columns) of each observation."""

    def hypotheses(self) -> list[Hypothesis]:
        """The catalogue: every effect at every place with every option."""

    def proposals(self, amplitudes: Amplitudes, known: Score) -> tuple[Machine, list[Hypothesis]]:
        """Hypotheses suggested by the residual beyond the catalogue, such as a damaged tooth.

        Args:
            amplitudes: of the current fit; its residual is searched.
            known: the current fit.

        Returns:
            Machine extended by the functions of the new hypotheses (itself if there are none),
            and the new hypotheses.
        """

    def nonlinear_trials(
        self, ranked: Sequence[tuple[Hypothesis, Array]], known: Score
    ) -> list[tuple[float, Hypothesis, Array]]:
        """Evaluate hypotheses at finite sizes, for gaps that no linear fit explains.

        Args:
            ranked: hypotheses with the mean of their linear fits, best first.
            known: fit without any of them.

        Returns:
            Chi2, hypothesis and start of its fit (coefficients of ``known`` first), best first.
        """

    @property
    def estimates_states(self) -> bool:
        """Whether blocks contain unknown states that are fitted with every explanation."""

    def with_more_values(self) -> Machine | None:
        """The same machine with more values of its runs; None: all that time allows are in use."""

    def without_linearisation(self) -> Machine:
        """Copy whose blocks are computed exactly at the amplitudes, none extrapolated linearly."""

    def regression_inputs(self, observation: str, r: int, block: Block) -> RegressionInputs:
        """Measured quantities that an unknown law of these rows may depend on, for run r."""

    def cycles(self, observation: str, r: int) -> Array:
        """(n,) cycles since the start of run r at every sample."""

    def linear_observations(self, amplitudes: Amplitudes) -> tuple[str, ...]:
        """Observations whose residual is linear in the functions up to these amplitudes."""

    def blocks(
        self,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
        observations: Sequence[str],
    ) -> list[dict[str, Block]]:
        """Residuals and columns of all runs about some amplitudes.

        Args:
            wanted: functions whose columns are formed, by observation; None: all.
            observations: names of those that are formed.

        Returns:
            For each run, its blocks by observation.
        """


@dataclass(frozen=True)
class Hypothesis:
    """An effect with its options at a place.

    Attributes:
        effect, options: as in the catalogue.
        locus: place, such as (mesh, planet, side).
        coefficients: to fit; the effect's own parameters first, then departures from its curve.
        n_own: number of own parameters.
        source: object from which the machine rebuilds the hypothesis for other runs; None for
            those of the catalogue.
        measured_gain: chi2 removed at the centres of its coefficients, evaluated by the machine
            where the effect is strongly nonlinear; None: the linear screen decides.
        base_mean: values of all other coefficients at ``measured_gain``.
        partly_screened: whether it also acts in observations where its columns are zero, so that a
            linear screen misses a part of its gain.
    """

    effect: str
    options: tuple[tuple[str, object], ...]
    locus: Hashable
    coefficients: tuple[Coefficient, ...]
    n_own: int
    source: Any = None
    measured_gain: float | None = None
    base_mean: tuple[float, ...] = ()
    partly_screened: bool = False

    @property
    def law(self) -> object:
        """Which of the effect's laws it has: its option ``law``; None if there is one only."""
        return dict(self.options).get("law")

    @property
    def is_linear(self) -> bool:
        """Whether its columns stay as they are when its coefficients change."""
        return all(c.scales_with_effect for c in self.coefficients)

    @property
    def vanishes_at_zero(self) -> bool:
        """Whether it does nothing where its coefficients are zero: no exchange and no part."""
        return not any(c.center for c in self.coefficients)

    def __post_init__(self) -> None:
        departures = [replace(c, departs_from=self.n_own) for c in self.coefficients[self.n_own :]]
        object.__setattr__(self, "coefficients", (*self.coefficients[: self.n_own], *departures))
