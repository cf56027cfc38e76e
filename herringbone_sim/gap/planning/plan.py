"""Which effects a choice of sensors would tell, from which size on, and which not.

Each effect at each place is put on runs of the nominal gear at many sizes; what it adds and what
every other explanation would leave of it (``diagnosis.information``) goes to the judge of the
diagnosis, whose probability says from which size on the effect is named, and its place.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.diagnosis.evidence import Candidate, Evidence
from herringbone_sim.diagnosis.information import Information
from herringbone_sim.diagnosis.judge import chances
from herringbone_sim.diagnosis.search import Hypothesis, Search
from herringbone_sim.effects.effect import Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.errors import AnalysisError
from herringbone_sim.gap.diagnose import STRIDE
from herringbone_sim.gap.named import moderate_size
from herringbone_sim.gap.observations.events import EVENT_KINDS, Event, mesh_delays
from herringbone_sim.gap.observations.gear import Gear
from herringbone_sim.gap.observations.machine import GearMachine
from herringbone_sim.gap.observations.seats import SEAT_PARAMETERS
from herringbone_sim.gap.planning.sensed import Noise, sensed

Array = NDArray[np.float64]
Say = Callable[[str], None]
NAMED = 0.9  # probability from which on an effect, or a place, counts as named
# Of a moderate effect; more than ten of them is no gear that runs.
SIZES = np.geomspace(1e-3, 10.0, 81)
TOOTH = {"sun": "sp", "planet": "sp", "ring": "rp"}  # meshes where a tooth of a member is tried
MIDDLE = 5.0  # mesh cycles from the start to the middle of a tooth's window: any would do
# (where windows of the motion are followed, the middle of those of the first run)


@dataclass(frozen=True)
class Outlook:
    """An effect at a place, as the sensors would see it.

    Attributes:
        effect, locus, options: as in the catalogue.
        unit, moderate: of its size, and the size that counts as one.
        size: from which on it is named with a probability of ``NAMED``; inf: it never is.
        seen: from which on the nominal gear alone is that improbable; inf: never.
        rival: other effect that would follow it best.
        apart: share of its squares that the rival would leave.
        place: probability of the place, given the effect, at ``size``.
        runs: share of the squares that each run tells.
    """

    effect: str
    locus: Locus
    options: tuple[tuple[str, object], ...]
    unit: str
    moderate: float
    size: float
    seen: float
    rival: str
    apart: float
    place: float
    runs: tuple[float, ...]


@dataclass(frozen=True)
class Plan:
    """What sensors would tell.

    Attributes:
        sensors: channels.
        observations: that can be formed of them.
        count: values that the diagnosis would compare with the model.
        outlooks: of every effect at every place.
        left_out: effects that these sensors give the diagnosis no way to seek.
        not_planned: effects without a linear response: parts that move by themselves, exchanges.
    """

    sensors: tuple[str, ...]
    observations: tuple[str, ...]
    count: float
    outlooks: tuple[Outlook, ...]
    left_out: tuple[str, ...]
    not_planned: tuple[str, ...]

    def of_effect(self, effect: str) -> tuple[Outlook, ...]:
        return tuple(one for one in self.outlooks if one.effect == effect)

    @property
    def effects(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(one.effect for one in self.outlooks))


def plan(
    nominal: Parameters,
    points: Sequence[Mapping[str, float]],
    sensors: Sequence[str],
    noise: Noise,
    cycles: int,
    say: Say = lambda text: None,
) -> Plan:
    """What some sensors would tell of each effect.

    Args:
        nominal: parameters of the full model.
        points: delta_T [K], K, T_1 [N m], Omega of each run that would be fitted.
        sensors: channels.
        cycles: mesh cycles of a run.
        say: told of the progress.

    Raises:
        ParameterError: no such sensor, or a point at which the gear can't run.
        AnalysisError: the diagnosis could form no observation of these sensors.
    """
    say("recording")
    campaign = sensed(nominal, points, sensors, noise, cycles)
    machine = GearMachine(Gear(campaign.runs, stride=STRIDE))
    if not machine.observation_names:
        raise AnalysisError(
            "sensors must allow a diagnosis one observation at least, got none: measure rotations "
            f"or accelerations of both suns and the carrier, got {', '.join(sensors)}"
        )
    say("calibration")
    search = Search(machine)
    hypotheses = machine.hypotheses()
    by_windows = machine.gear.uses_windows
    machine, events = machine.with_parts(_teeth(machine.gear))
    hypotheses += [replace(h, n_own=1) for h in events]
    search = search.onwards(machine)
    say(f"{len(hypotheses)} hypotheses")
    # What is there or not, such as exchanged channels, has no size.
    hypotheses = [h for h in hypotheses if h.coefficients[0].center == 0.0]
    found = Information(search.campaign, hypotheses, hypotheses)
    seen = [i for i, s in enumerate(found.squares) if s > 0.0]
    outlooks = tuple(_outlook(i, hypotheses, found, machine.gear.model) for i in seen)
    sought = {one.effect for one in outlooks}
    others = [name for name in known_effects() if name not in sought]
    known = ("channel_swap",) if by_windows else (*SEAT_PARAMETERS, "channel_swap")
    parts = tuple(n for n in others if n in known)
    return Plan(
        tuple(sensors),
        machine.observation_names,
        found.count,
        outlooks,
        tuple(name for name in others if name not in parts),
        parts,
    )


def _teeth(gear: Gear) -> list[Event]:
    """A tooth of each member, cracked and spalled, at the first mesh that it meets."""
    layout = gear.model.layout
    found, middle = [], MIDDLE
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
            found += [Event(kind, p, member, middle, tuple(late.tolist())) for p in places[:1]]
    return found


def _outlook(
    i: int, hypotheses: Sequence[Hypothesis], found: Information, model: Model
) -> Outlook:
    """Of hypothesis i, by the judge."""
    h = hypotheses[i]
    rivals = _rivals(i, hypotheses, found.left[i])

    def judged(k: int) -> tuple[dict[str, float], float]:
        return _judged(i, float(SIZES[k]), hypotheses, rivals, found)

    first = _first(lambda k: judged(k)[0].get(h.effect, 0.0) >= NAMED)
    seen = _first(lambda k: judged(k)[0]["none"] <= 1.0 - NAMED)
    _, place = judged(min(first, len(SIZES) - 1))
    follows = next(j for j in rivals if hypotheses[j].effect != h.effect)
    moderate, unit = moderate_size(h, model)
    return Outlook(
        h.effect,
        h.locus if isinstance(h.locus, Locus) else Locus(),
        h.options,
        unit,
        moderate,
        float(SIZES[first] * moderate) if first < len(SIZES) else np.inf,
        float(SIZES[seen] * moderate) if seen < len(SIZES) else np.inf,
        hypotheses[follows].effect,
        float(found.left[i, follows] / found.squares[i]),
        place,
        tuple(found.by_run[i].tolist()),
    )


def _first(on: Callable[[int], bool]) -> int:
    """First size at which something is so that is so at all larger ones; their number if none."""
    return bisect_left(range(len(SIZES)), True, key=on)


def _rivals(i: int, hypotheses: Sequence[Hypothesis], left: Array) -> list[int]:
    """The best of every other effect, and the same effect at its likeliest other place."""
    h = hypotheses[i]
    best: dict[str, int] = {}
    for j in np.argsort(left).tolist():
        other = hypotheses[j]
        if other.effect != h.effect or other.locus != h.locus:
            best.setdefault(other.effect, j)
    return list(best.values())


def _judged(
    i: int,
    size: float,
    hypotheses: Sequence[Hypothesis],
    rivals: Sequence[int],
    found: Information,
) -> tuple[dict[str, float], float]:
    """Probability of every effect, and of the place given the effect, at a size of truth i.

    An effect is there alone or with something unknown beside it. Each coefficient of an effect's
    own costs the square that noise adds to runs left out.
    """
    h, count = hypotheses[i], found.count
    none = _candidate((), Locus(), count + found.seen(i, size), 0, count)
    own = _candidate((h.effect,), h.locus, count + h.n_own, h.n_own, count)
    others = [
        _candidate(
            (r.effect,), r.locus, count + found.left_at(i, j, size) + r.n_own, r.n_own, count
        )
        for j, r in ((j, hypotheses[j]) for j in rivals)
    ]
    singles = sorted((own, *others), key=lambda c: c.energy)
    told = chances(Evidence(count, (none, *singles), {}, {}))
    total: dict[str, float] = {}
    for one in told:
        name = one.effects[0] if one.effects else "none"
        total[name] = total.get(name, 0.0) + one.probability
    place = sum(one.probability for one in told if one.candidate is own)
    return total, place / max(total[h.effect], 1e-300)


def _candidate(
    effects: tuple[str, ...], locus: object, energy: float, size: int, count: float
) -> Candidate:
    return Candidate(
        effects, (str(locus),) * len(effects), energy, energy, size, 0.0, energy / count
    )
