"""Smallest size at which each effect would be detected and named with a choice of sensors.

Each effect at each place is evaluated at many sizes on simulated runs of the nominal gear. The
change of the observations by the effect, and what a fit of every other explanation leaves of it
(``diagnosis.information``), give the probabilities that the judge of the diagnosis would report.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.diagnosis.evidence import Candidate, Evidence
from herringbone_sim.diagnosis.information import Information
from herringbone_sim.diagnosis.judge import chances
from herringbone_sim.diagnosis.machine import Hypothesis
from herringbone_sim.diagnosis.search import Search
from herringbone_sim.effects.effect import Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.attribution.undecidable_by_channels import FEW_NEED_THREE_PLANETS
from herringbone_sim.gap.named_effects import moderate_size
from herringbone_sim.gap.observations.force_law import cycles_per_member_turn
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.gear_machine import GearMachine
from herringbone_sim.gap.observations.hypotheses.damaged_teeth import (
    EVENT_KINDS,
    Event,
    mesh_delays,
)
from herringbone_sim.gap.observations.hypotheses.moving_parts import SEAT_PARAMETERS
from herringbone_sim.gap.planning.synthetic import SensorNoise, simulate_campaign
from herringbone_sim.gap.sensor_calibration import STRIDE
from herringbone_sim.gap.sensors.detrended import only_windows_possible, without_detrended

Say = Callable[[str], None]
NAMED = 0.9  # least probability at which an effect, or a place, counts as named
SIZES = np.geomspace(1e-3, 10.0, 81)  # in units of a moderate effect; ten is beyond any real gear
TOOTH = {"sun": "sp", "planet": "sp", "ring": "rp"}  # meshes where a tooth of a member is tried
# Mesh cycles from phase 0 to the contact of a damaged tooth, arbitrary; where windows of a
# trajectory are fitted, the middle one of the first run is used instead.
MIDDLE = 5.0


@dataclass(frozen=True)
class Detectability:
    """Detectability of an effect at a place.

    Attributes:
        effect, locus, options: as in the catalogue.
        unit: unit of the sizes.
        moderate: size of a moderate effect.
        named_from: least size at which its probability is ``NAMED`` or more; inf: none.
        detected_from: least size at which ``none`` has at most 1 - ``NAMED``; inf: none.
        rival: id of the other effect that fits it best.
        rival_leaves: fraction of its chi2 that remains after a fit of the rival.
        place_probability: of the place, given the effect, at ``named_from`` or the largest size.
        run_shares: fraction of its chi2 in each run.
    """

    effect: str
    locus: Locus
    options: tuple[tuple[str, object], ...]
    unit: str
    moderate: float
    named_from: float
    detected_from: float
    rival: str
    rival_leaves: float
    place_probability: float
    run_shares: tuple[float, ...]


@dataclass(frozen=True)
class Plan:
    """Detectability of all effects with a choice of sensors.

    Attributes:
        sensors: names of the channels.
        observations: names of the observations that these channels allow.
        count: number of values that the diagnosis would compare with the model.
        detectabilities: of every effect at every place and with every option that is visible.
        not_sought: ids of effects that these sensors don't show at all.
        not_planned: ids of effects without a linear response: moving parts and swapped channels.
    """

    sensors: tuple[str, ...]
    observations: tuple[str, ...]
    count: float
    detectabilities: tuple[Detectability, ...]
    not_sought: tuple[str, ...]
    not_planned: tuple[str, ...]

    def of_effect(self, effect: str) -> tuple[Detectability, ...]:
        """Detectability of an effect at all its places."""
        return tuple(d for d in self.detectabilities if d.effect == effect)

    @property
    def effects(self) -> tuple[str, ...]:
        """Ids of the effects in ``detectabilities``."""
        return tuple(dict.fromkeys(d.effect for d in self.detectabilities))


def plan(
    nominal: Parameters,
    points: Sequence[Mapping[str, float]],
    sensors: Sequence[str],
    noise: SensorNoise,
    cycles: int,
    say: Say = lambda text: None,
) -> Plan:
    """Compute the detectability of every effect with a choice of sensors.

    Args:
        nominal: parameters of the full model.
        points: delta_T [K], K, T_1 [N m], Omega of each fit run.
        sensors: names of the channels.
        noise: noise of the sensors.
        cycles: mesh cycles of a run.
        say: called with a line of progress.

    Raises:
        ParameterError: no sensor or an unknown one, too few cycles, or a point out of range.
        DivergenceError: a simulated motion diverges.
        AnalysisError: the sensors don't allow any observation.
    """
    say("recording")
    campaign = simulate_campaign(nominal, points, sensors, noise, cycles)
    runs = campaign.runs
    if not only_windows_possible(runs):
        runs = tuple(map(without_detrended, runs))
    machine = GearMachine(GearObservations(runs, stride=STRIDE))
    if not machine.gear.observation_names:
        if nominal.n_planets != 3:
            raise AnalysisError(f"{FEW_NEED_THREE_PLANETS}; got {', '.join(sensors)}")
        raise AnalysisError(
            "sensors must allow a diagnosis one observation at least, got none: measure rotations "
            f"or accelerations of both suns and the carrier, got {', '.join(sensors)}"
        )
    say("calibration")
    search = Search(machine)
    hypotheses = machine.hypotheses()
    machine, events = machine.with_parts(_teeth(machine.gear))
    hypotheses += [replace(h, n_own=1) for h in events]
    search = search.onwards(machine)
    say(f"{len(hypotheses)} hypotheses")
    # Effects that are present or absent, such as swapped channels, have no size to vary.
    hypotheses = [h for h in hypotheses if h.coefficients[0].center == 0.0]
    information = Information(search.campaign, hypotheses, hypotheses)
    visible = [i for i, s in enumerate(information.squares) if s > 0.0]
    detectabilities = tuple(
        _detectability(i, hypotheses, information, machine.estimates_states) for i in visible
    )
    sought = {d.effect for d in detectabilities}
    others = [name for name in known_effects() if name not in sought]
    parts = tuple(n for n in others if n in (*SEAT_PARAMETERS, "channel_swap"))
    return Plan(
        tuple(sensors),
        machine.gear.observation_names,
        information.count,
        detectabilities,
        tuple(name for name in others if name not in parts),
        parts,
    )


def _teeth(gear: GearObservations) -> list[Event]:
    """A crack and a spall of one tooth of each member, each at one mesh."""
    layout = gear.model.layout
    events, middle = [], MIDDLE
    turns = cycles_per_member_turn(gear.model)
    if gear.uses_windows:
        s = gear.trajectories[0].recorded
        middle = float(s.phase[s.first_half_step[s.n_windows // 2]] / (2.0 * np.pi))
    for kind in EVENT_KINDS:
        for member, mesh in TOOTH.items():
            places = [
                p
                for p in known_effects()[kind].candidates(layout)
                if p.mesh == mesh and p.planet != "all" and p.side != "all"
            ]
            _, late = next(iter(mesh_delays(gear, member)))
            at = turns[member], middle, tuple(late.tolist())
            events += [Event(kind, p, member, *at) for p in places[:1]]
    return events


def _detectability(
    i: int, hypotheses: Sequence[Hypothesis], information: Information, by_density: bool
) -> Detectability:
    """Detectability of hypothesis i by the judge; for ``by_density`` see ``_probabilities``."""
    h = hypotheses[i]
    rivals = _rivals(i, hypotheses, information.left[i])

    @cache
    def judged(k: int) -> tuple[dict[str, float], float]:
        return _probabilities(i, float(SIZES[k]), hypotheses, rivals, information, by_density)

    named = _first_size(lambda k: judged(k)[0].get(h.effect, 0.0) >= NAMED)
    detected = _first_size(lambda k: judged(k)[0]["none"] <= 1.0 - NAMED)
    _, place = judged(min(named, len(SIZES) - 1))
    best = next(j for j in rivals if hypotheses[j].effect != h.effect)
    moderate, unit = moderate_size(h)
    return Detectability(
        h.effect,
        h.locus if isinstance(h.locus, Locus) else Locus(),
        h.options,
        unit,
        moderate,
        float(SIZES[named] * moderate) if named < len(SIZES) else np.inf,
        float(SIZES[detected] * moderate) if detected < len(SIZES) else np.inf,
        hypotheses[best].effect,
        float(information.left[i, best] / information.squares[i]),
        place,
        tuple(information.by_run[i].tolist()),
    )


def _first_size(condition: Callable[[int], bool]) -> int:
    """First index of ``SIZES`` at which a monotonic condition holds; ``len(SIZES)`` if at none."""
    return bisect_left(range(len(SIZES)), True, key=condition)


def _rivals(i: int, hypotheses: Sequence[Hypothesis], left: Array) -> list[int]:
    """Indices of the rivals of hypothesis i: of each effect, the place that leaves least of it.

    Of the effect of hypothesis i itself, only other places are rivals.

    Args:
        i: index of the hypothesis.
        hypotheses: all hypotheses.
        left: (n_hypotheses,) chi2 of hypothesis i that a fit of each hypothesis leaves.
    """
    h = hypotheses[i]
    best: dict[str, int] = {}
    for j in np.argsort(left).tolist():
        other = hypotheses[j]
        if other.effect != h.effect or other.locus != h.locus:
            best.setdefault(other.effect, j)
    return list(best.values())


def _probabilities(
    i: int,
    size: float,
    hypotheses: Sequence[Hypothesis],
    rivals: Sequence[int],
    information: Information,
    by_density: bool,
) -> tuple[dict[str, float], float]:
    """Probabilities that the judge would report if hypothesis i were true.

    Each main coefficient of a hypothesis adds 1 to its expected chi2 on runs left out.

    Args:
        i: index of the true hypothesis.
        size: size of the effect, in units of a moderate one.
        hypotheses: all hypotheses.
        rivals: indices of the hypotheses that compete with it.
        information: of all hypotheses.
        by_density: whether a diagnosis compares explanations by density, see ``Score.loss``.

    Returns:
        Probability by id (``none``, ``unknown``, and effects alone or with something unknown
        beside them), and probability of the true place, given the true effect.
    """
    h, count = hypotheses[i], information.count

    def candidate(of: Hypothesis | None, more: float) -> Candidate:
        """Of a hypothesis or none, with ``more`` chi2 than noise leaves, without strain."""
        effects, places = ((), ()) if of is None else ((of.effect,), (str(of.locus),))
        n_own = 0 if of is None else of.n_own
        chi2 = count + more + n_own
        density = -0.5 * chi2 if by_density else None
        return Candidate(effects, places, chi2, chi2, n_own, 0.0, chi2 / count, density)

    none, true_candidate = candidate(None, information.seen(i, size)), candidate(h, 0.0)
    others = [candidate(hypotheses[j], information.left_at(i, j, size)) for j in rivals]
    singles = sorted((true_candidate, *others), key=lambda c: c.chi2)
    judged = chances(Evidence(count, (none, *singles), {}, {}))
    total: dict[str, float] = {}
    for chance in judged:
        name = chance.effects[0] if chance.effects else "none"
        total[name] = total.get(name, 0.0) + chance.probability
    place = sum(chance.probability for chance in judged if chance.candidate is true_candidate)
    return total, place / max(total[h.effect], 1e-300)
