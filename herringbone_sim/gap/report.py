"""The report of a diagnosis, as the page draws it and as ``report.json`` stores it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from herringbone_sim.core.layout import PREFIX_UNITS
from herringbone_sim.effects.channels import names_of
from herringbone_sim.effects.effect import Active, Locus
from herringbone_sim.gap.data.screen import Finding
from herringbone_sim.gap.learned_law import LearnedLaw
from herringbone_sim.gap.observations.calibration.noise_report import ChannelNoise
from herringbone_sim.gap.observations.reconstructed_forces import ReconstructedForces
from herringbone_sim.gap.verdict.decide import Verdict
from herringbone_sim.gap.verdict.next_experiment import NextExperiment
from herringbone_sim.gap.verification.residual_gap import Gap
from herringbone_sim.gap.verification.senses import Senses
from herringbone_sim.gap.verification.serialise import (
    attractor_to_dict,
    forces_to_dict,
    gap_to_dict,
    senses_to_dict,
)
from herringbone_sim.recording.safe_json import plain_numbers

SCHEMA = "herringbone_sim/gap-report/1"
OF_FINDING = ("what", "run", "channels", "time_s", "text")  # attributes in ``report.json``
OWN_UNIT = "unit of the channel"  # in the catalogue, unit of parameters of sensor effects


@dataclass(frozen=True)
class Estimate:
    """Value of a parameter or an option of a cause.

    Attributes:
        value: of a parameter, in ``unit``; of an option, an integer, a name or channel names.
        unit: ``-`` for none.
        ci90: 90 % interval (low, high), NaN where unknown; None for an option.
    """

    value: Any
    unit: str = "-"
    ci90: tuple[float, float] | None = None


@dataclass(frozen=True)
class Cause:
    """An effect of the catalogue, ``none`` or ``unknown``, with its probability.

    Attributes:
        effect: id.
        locus: its most probable place; all meshes where it was not fitted.
        probability: of the effect at any place.
        parameters: parameters and options by name; empty where it was not fitted.
    """

    effect: str
    locus: Locus
    probability: float
    parameters: Mapping[str, Estimate] = field(default_factory=dict)

    @property
    def place(self) -> str:
        """Mesh kind, planet and side, as ``sp/2/L``."""
        return "/".join(asdict(self.locus).values())


@dataclass(frozen=True)
class Report:
    """All results of a diagnosis.

    Attributes:
        campaign: name of the rig.
        verdict: of the diagnosis.
        where: meshes with their fraction of the residual, or of the probability of a cause,
            largest first; see ``location.residual_by_mesh``.
        gap: of all runs in the metric of the verdict.
        undecidable: sentences on what the data can't decide.
        next_experiment: operating point to run next, and why.
        findings: problems of the data.
        senses: the gap in three senses; None where not measured.
        channels: names of the recorded channels.
        noise: noise of each recorded channel, by name.
        observations: names of the observations used.
        forces: forces of all meshes in one run, from few channels; None where not reconstructed.
    """

    campaign: str
    verdict: Verdict
    where: Sequence[tuple[Locus, float]]
    gap: Gap
    undecidable: Sequence[str]
    next_experiment: NextExperiment
    findings: Sequence[Finding] = ()
    senses: Senses | None = None
    channels: Sequence[str] = ()
    noise: Mapping[str, ChannelNoise] = field(default_factory=dict)
    observations: Sequence[str] = ()
    forces: ReconstructedForces | None = None

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Every effect of the catalogue, ``none`` and ``unknown``, the most probable first."""
        chances = sorted(self.verdict.probabilities.items(), key=lambda item: -item[1])
        return tuple(self._cause(name, chance) for name, chance in chances)

    @property
    def laws(self) -> tuple[LearnedLaw, ...]:
        """Learned curves of the effects of the verdict."""
        return self.verdict.chosen.laws if self.verdict.chosen else ()

    @property
    def runner_up_effects(self) -> tuple[str, ...]:
        """Ids of the effects of the runner-up; empty without one."""
        other = self.verdict.runner_up
        return () if other is None else tuple(active.effect.id for active in other.actives)

    def to_dict(self) -> dict[str, Any]:
        """Content of ``report.json``; numbers that are not finite become None."""
        verdict = self.verdict
        data = {
            "schema": SCHEMA,
            "campaign": self.campaign,
            "verdict": verdict.verdict,
            "effects": list(verdict.effects),
            "where": [{"locus": asdict(locus), "share": share} for locus, share in self.where],
            "causes": [asdict(cause) for cause in self.causes],
            "ambiguous_with": list(verdict.ambiguous_with),
            "gap": gap_to_dict(self.gap)
            | {"runner_up_effects": list(self.runner_up_effects)}
            | ({"senses": senses_to_dict(self.senses)} if self.senses else {}),
            "attractor": attractor_to_dict(self.senses),
            "undecidable": list(self.undecidable),
            "next_experiment": {**self.next_experiment.point, "why": self.next_experiment.why},
            "findings": [{n: getattr(f, n) for n in OF_FINDING} for f in self.findings],
            "hypotheses": _hypotheses(verdict),
            "law": [law.to_dict() for law in self.laws],
            "noise": {name: asdict(noise) for name, noise in self.noise.items()},
            "recorded": sorted(self.noise),
            "observations": list(self.observations),
            "reconstructed_forces": forces_to_dict(self.forces),
        }
        finite: dict[str, Any] = plain_numbers(data)
        return finite

    def _cause(self, name: str, chance: float) -> Cause:
        """An effect as a cause, with place and size of its most probable fit if it has one."""
        if name not in self.verdict.best:
            return Cause(name, Locus(), chance)
        explanation, i = self.verdict.best[name]
        spans = explanation.intervals[i] if i < len(explanation.intervals) else ()
        active = explanation.actives[i]
        return Cause(name, active.locus, chance, _estimates(active, spans, self.channels))


def _estimates(
    active: Active, spans: Sequence[tuple[float, float]], channels: Sequence[str]
) -> dict[str, Estimate]:
    """Parameters and options of a fitted effect.

    Args:
        active: the effect.
        spans: 90 % interval of each parameter; empty where unknown.
        channels: names of the recorded channels.
    """
    spans = spans or ((float("nan"),) * 2,) * len(active.theta)
    concerned = names_of(channels, active) or active.chosen.get("channels", ())
    values = {
        p.name: Estimate(value, _unit(p.unit, concerned), span)
        for p, value, span in zip(active.effect.parameters, active.theta, spans, strict=True)
    }
    for key, choice in active.options:
        values[key] = Estimate(concerned if key == "channels" else choice)
    if active.effect.level == "sensor" and not concerned:
        values["channels"] = Estimate(("t",))  # the clock of all channels
    return values


def _hypotheses(verdict: Verdict) -> list[dict[str, Any]]:
    """All explanations with effects, loci and probability, best first."""
    return [
        {
            "effects": list(c.effects or ("none",)),
            "loci": [] if c.candidate is None else list(c.candidate.places),
            "probability": c.probability,
        }
        for c in verdict.chances
    ]


def _unit(unit: str, channels: Sequence[str]) -> str:
    """Unit of a parameter; the common unit of ``channels``, if any, instead of ``OWN_UNIT``."""
    quantities = {name.partition("_")[0] for name in channels}
    known = {PREFIX_UNITS.get(quantity, unit) for quantity in quantities}
    return known.pop() if unit == OWN_UNIT and len(known) == 1 else unit
