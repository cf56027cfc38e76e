"""Interface of a machine to the diagnosis: observations of its runs, catalogue of hypotheses.

Amplitudes are the values at which functions act: observation -> function -> (runs, rows).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.coefficients import Coefficient
from herringbone_sim.diagnosis.flexible import RegressionInputs
from herringbone_sim.diagnosis.parallel import forked_map
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.diagnosis.score import Score

A = TypeVar("A")
B = TypeVar("B")
Amplitudes = Mapping[str, Mapping[str, Array]]


class Machine(Protocol):
    """A machine with recorded runs; its observations can be linearised about any amplitudes.

    What a method does by default is right for a machine that is nearly linear, without hidden
    parts or unknown states of motion, all of whose recorded values are in use.

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
        """All hypotheses of the catalogue: every effect at every place with every option."""

    def proposals(self, amplitudes: Amplitudes, known: Score) -> tuple[Machine, list[Hypothesis]]:
        """Hypotheses that a residual suggests beyond the catalogue, such as a damaged tooth.

        By default none.

        Args:
            amplitudes: of the current fit, whose residual is searched.
            known: score of the current fit.

        Returns:
            Machine extended by the functions of the new hypotheses (itself if there are none),
            and the new hypotheses.
        """
        return self, []

    def improved(
        self, hypothesis: Hypothesis, amplitudes: Amplitudes, known: Score
    ) -> tuple[Machine, list[Hypothesis]]:
        """Search better parameters of a moving part about its fit.

        Args:
            hypothesis: that of the fit.
            amplitudes, known: of the fit.

        Returns:
            Machine extended by the functions of parts with other parameters, and their
            hypotheses; none, as by default, where nothing can be searched.
        """
        return self, []

    def restarted_from_other_sizes(self, hypothesis: Hypothesis, fit: Score) -> Array | None:
        """Start values (p,) at which an effect may fit better than it does, with other states.

        None where states are not estimated, as by default, or none was found.
        """
        return None

    def orders(self) -> tuple[list[Mapping[str, str]], NDArray[np.bool_]]:
        """Orders of hidden parts that are alike, see ``diagnosis.orders``.

        Returns:
            For each order the functions that replace those named, the present order first; and
            (runs,) whether a run may be reordered. By default one order.
        """
        return [{}], np.zeros(self.runs, dtype=bool)

    def reordered(self, choice: Sequence[int]) -> Machine:
        """The machine with the parts of each run in one of ``orders``; by default itself."""
        return self

    def nonlinear_trials(
        self, ranked: Sequence[tuple[Hypothesis, Array]], known: Score
    ) -> list[tuple[float, Hypothesis, Array]]:
        """Evaluate hypotheses at finite sizes, for gaps that no linear fit explains.

        Args:
            ranked: hypotheses with the mean of their linear fits (coefficients of ``known``
                first), best first.
            known: fit without any of them.

        Returns:
            Triples of chi2 left, hypothesis and start values of its fit (p,), best first; may be
            empty, as by default.
        """
        return []

    @property
    def estimates_states(self) -> bool:
        """Whether blocks contain unknown states of motion, fitted anew with every explanation.

        By default they do not.
        """
        return False

    def fitted_in_parallel(self, fit: Callable[[Machine, A], B], items: Sequence[A]) -> list[B]:
        """Results of ``fit(machine, item)``, which can be pickled, for each item; side by side.

        What ``fit`` changes may be lost, but for states of motion: those fitted for one item are
        no starts of those for another, but of all later ones. By default in processes, without
        states to remember.
        """
        return forked_map(lambda item: fit(self, item), items)

    def states_improve(self, amplitudes: Amplitudes) -> bool:
        """Whether states fitted again at amplitudes leave less chi2, by more than chance.

        False, as by default, where states are not estimated.
        """
        return False

    def with_more_values(self) -> Machine | None:
        """Copy that compares more values of its runs; None where no more can be, as by default."""
        return None

    def without_linearisation(self) -> Machine:
        """Copy whose blocks are computed exactly at the amplitudes, none extrapolated linearly.

        The machine itself, as by default, where its blocks always are.
        """
        return self

    def regression_inputs(self, observation: str, r: int, block: Block) -> RegressionInputs:
        """Measured quantities on which an unknown law of the rows of a block of run r may depend.

        See ``diagnosis.flexible``.
        """

    def cycles(self, observation: str, r: int) -> Array:
        """(n,) number of cycles since the start of run r, at every sample."""

    def linear_observations(self, amplitudes: Amplitudes) -> tuple[str, ...]:
        """Names of observations whose residual is linear in the amplitudes up to these ones."""

    def blocks(
        self,
        amplitudes: Amplitudes,
        wanted: Mapping[str, Sequence[str]] | None,
        observations: Sequence[str],
    ) -> list[dict[str, Block]]:
        """Residuals and columns of all runs about some amplitudes.

        Args:
            amplitudes: point of linearisation.
            wanted: functions whose columns are formed, by observation; None: all.
            observations: names of those for which blocks are formed.

        Returns:
            For each run, its blocks by observation.
        """


@dataclass(frozen=True)
class Hypothesis:
    """An effect with its options at a place, and its coefficients to fit.

    Attributes:
        effect, options: id of the effect, and names and values of its options, as in the
            catalogue.
        locus: place, such as (mesh, planet, side).
        coefficients: those of the effect itself first, then departures from the curve that the
            catalogue gives it, whose ``departs_from`` is set to ``n_own`` here.
        n_own: number of coefficients of the effect itself.
        source: object from which the machine rebuilds the hypothesis for other runs; None for a
            hypothesis of the catalogue.
        measured_gain: chi2 removed at the centres of its coefficients, evaluated by the machine
            where the effect is strongly nonlinear; None: the linear screen decides.
        base_mean: values of the base coefficients (the tolerances, in every hypothesis) with which
            ``measured_gain`` was evaluated; empty without it.
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
        """Value of the option ``law``, by which an effect has several laws; None without it."""
        return dict(self.options).get("law")

    @property
    def is_linear(self) -> bool:
        """Whether its columns do not change with its coefficients."""
        return all(c.scales_with_effect for c in self.coefficients)

    @property
    def vanishes_at_zero(self) -> bool:
        """Whether all prior means are zero, so that a fit can start without the effect.

        False for exchanged channels and moving parts, which are present or absent.
        """
        return not any(c.center for c in self.coefficients)

    def __post_init__(self) -> None:
        departures = [replace(c, departs_from=self.n_own) for c in self.coefficients[self.n_own :]]
        object.__setattr__(self, "coefficients", (*self.coefficients[: self.n_own], *departures))


def with_slices(hypotheses: Sequence[Hypothesis], n: int) -> list[tuple[Hypothesis, slice]]:
    """Hypotheses with the slices of their coefficients, which are the last of ``n``, in order."""
    counts = [len(h.coefficients) for h in hypotheses]
    ends = list(accumulate(counts, initial=n - sum(counts)))
    return [(h, slice(*of)) for h, of in zip(hypotheses, pairwise(ends), strict=True)]
