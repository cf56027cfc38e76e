"""Draw a practice campaign: the rig within its tolerances, operating points, and causes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random import Generator

from herringbone_sim.arrays import Array
from herringbone_sim.errors import ParameterError
from herringbone_sim.practice.catalogue import CATALOGUE
from herringbone_sim.practice.cause import Cause, Kind
from herringbone_sim.practice.channels import CHANNEL_SETS, drawn_channels
from herringbone_sim.practice.laws import LAWS, draw_law
from herringbone_sim.practice.noise import Noise, draw_noise
from herringbone_sim.practice.outside import OUTSIDE, UNSEEN
from herringbone_sim.practice.random_physics import RANDOM_PHYSICS
from herringbone_sim.practice.record import SAMPLES_PER_CYCLE
from herringbone_sim.practice.rig_model import N_COORDINATE, TOLERANCE, TOLERATED
from herringbone_sim.practice.sensors import OUTSIDE_SENSORS, SENSORS

KINDS: dict[str, Kind] = {
    **CATALOGUE,
    **SENSORS,
    **OUTSIDE,
    **OUTSIDE_SENSORS,
    **UNSEEN,
    **RANDOM_PHYSICS,
}
NAMED = (*CATALOGUE, *SENSORS)
INVISIBLE = {"raw_shafts": ("sensor_bias",)}  # effects that a channel set can't show
UNNAMED = (*OUTSIDE, *OUTSIDE_SENSORS)
RANDOM_SHARE = 0.5  # probability that an unknown cause is random physics, not of ``UNNAMED``
TRUTHS = {"none": 0.2, "single": 0.4, "pair": 0.2, "unknown": 0.2}
DETECTABILITIES = (1.0, 3.0, 10.0)

# Ranges of delta_T [K], K, T_1 [N m] and Omega of the runs of a campaign.
VARIED = (
    ((75, 98), (0, 0), (205, 320), (0.92, 1.06)),
    ((13, 46), (0, 0), (205, 480), (0.91, 1.12)),
    ((20, 80), (0, 0), (1640, 2150), (0.3, 0.36)),
    ((41, 69), (0.2, 0.48), (300, 900), (0.64, 0.9)),
    ((12, 83), (0.02, 0.13), (930, 1680), (1.06, 1.3)),
    ((46, 79), (0, 0), (315, 800), (0.75, 0.95)),
    ((5, 40), (0.01, 0.3), (970, 1830), (0.5, 0.75)),
    ((62, 92), (0.08, 0.42), (260, 1280), (1.0, 1.24)),
)
QUIET = (((10, 90), (0, 0), (1500, 2200), (0.22, 0.38)),) * 8
FIT_RUNS = 5


@dataclass(frozen=True)
class RequestedNoise:
    """Kind and level of the noise of a campaign; its parameters are drawn with the campaign.

    Attributes:
        kind: of ``noise.NOISES``.
        snr_dB: RMS of a channel over that of its noise [dB].
    """

    kind: str = "white"
    snr_dB: float = 40.0


WHITE_NOISE = RequestedNoise()


@dataclass(frozen=True)
class Plan:
    """All that is drawn for a campaign before sizes are solved for.

    Attributes:
        seed: of all draws.
        d: requested detectability, 0 without effect.
        snr_dB: RMS of a channel over that of its noise [dB].
        noise: the measuring chain.
        channels: name of the channel set; ``names``: the recorded channels.
        regime: ``varied`` or ``quiet`` operating points.
        factors: on nominal constants, by name: the rig within its tolerances.
        points: operating point of each run; the first five runs are for the fit.
        phases: mesh phase [rad] of the first sample of each run.
        starts: (runs, 30) initial state of the transient of each run.
        causes: at most two.
        samples_per_cycle: of a mesh cycle.
    """

    seed: int
    d: float
    snr_dB: float
    noise: Noise
    channels: str
    names: tuple[str, ...]
    regime: str
    factors: dict[str, float]
    points: tuple[dict[str, float], ...]
    phases: tuple[float, ...]
    starts: Array
    causes: tuple[Cause, ...]
    samples_per_cycle: int = SAMPLES_PER_CYCLE


def draw_plan(
    seed: int,
    truth: str | None = None,
    d: float | None = None,
    noise: RequestedNoise = WHITE_NOISE,
    channels: str = "full",
    regime: str = "varied",
    law: str = "both",
) -> Plan:
    """Draw a campaign from a seed; ``Plan.samples_per_cycle`` can be replaced afterwards.

    Args:
        truth: none, single, pair, unknown, unseen, random_physics or a kind of effect; None: one
            of ``TRUTHS``, with the probabilities there.
        d: requested detectability; None: one of 1, 3, 10.
        noise: its kind and its level.
        channels: a set of ``channels.CHANNEL_SETS``.
        regime: ``varied`` or ``quiet`` operating points.
        law: catalogue, other or both: whose curves the effects of the catalogue have.

    Raises:
        ParameterError: an unknown truth, channel set, regime, noise or law.
    """
    check_names(truth, channels, regime, law)
    share = 10.0 ** (-noise.snr_dB / 20.0)
    measures = draw_noise(np.random.default_rng([seed, 0x9B]), noise.kind, share)
    names = drawn_channels(np.random.default_rng([seed, 0x9C]), channels)
    rng = np.random.default_rng([seed, 0x9A])
    shares = np.array(list(TRUTHS.values()))
    drawn, drawn_d = str(rng.choice(list(TRUTHS), p=shares)), float(rng.choice(DETECTABILITIES))
    tolerance = rng.uniform(1.0 - TOLERANCE, 1.0 + TOLERANCE, len(TOLERATED))
    points = tuple(_point(rng, ranges) for ranges in (QUIET if regime == "quiet" else VARIED))
    phases = tuple(float(phase) for phase in rng.uniform(0.0, 2.0 * np.pi, len(points)))
    starts = np.stack([_start(rng) for _ in points])
    named = tuple(name for name in NAMED if name not in INVISIBLE.get(channels, ()))
    causes = _causes(rng, truth or drawn, names, law, named)
    return Plan(
        seed=seed,
        d=(drawn_d if d is None else d) if causes else 0.0,
        snr_dB=noise.snr_dB,
        noise=measures,
        channels=channels,
        names=names,
        regime=regime,
        factors=dict(zip(TOLERATED, map(float, tolerance), strict=True)),
        points=points,
        phases=phases,
        starts=starts,
        causes=causes,
    )


def check_names(truth: str | None, channels: str, regime: str, law: str) -> None:
    """Raise ParameterError for a name that ``draw_plan`` does not list; a truth may be None."""
    for what, value, known in (
        ("truth", truth, (*TRUTHS, "unseen", *KINDS)),
        ("channels", channels, tuple(CHANNEL_SETS)),
        ("regime", regime, ("varied", "quiet")),
        ("law", law, (*LAWS, "both")),
    ):
        if value is not None and value not in known:
            raise ParameterError(f"{what} must be one of {', '.join(known)}, got {value!r}")
    if truth in INVISIBLE.get(channels, ()):
        raise ParameterError(f"{truth} can't be seen in {channels}: choose other channels")


def _point(rng: Generator, ranges: Any) -> dict[str, float]:
    """Draw an operating point from ranges of delta_T, K, T_1 and Omega."""
    digits = {"delta_T": 1, "K": 2, "T_1": 0, "Omega": 3}
    return {
        name: round(float(rng.uniform(*low_high)), digit)
        for (name, digit), low_high in zip(digits.items(), ranges, strict=True)
    }


def _start(rng: Generator) -> Array:
    """Draw an initial state (30,): at rest, or in 60 % of the cases with displaced suns, planets.

    All planets of a side start equal to a nanometre. Runs from rest would miss the chaotic motions
    with different left and right that coexist with regular ones.
    """
    start = 1e-9 * rng.normal(size=2 * N_COORDINATE)
    start[9:N_COORDINATE] = start[N_COORDINATE + 9 :] = 0.0
    far = 10.0 ** rng.uniform(-2.0, 0.5) * float(rng.random() < 0.6)
    for side in range(2):
        sun, planet = far * 5e-5 * rng.normal(size=2)
        sun_rate, planet_rate = far * 1.5 * rng.normal(size=2)
        start[side] += sun
        start[3 + 3 * side : 6 + 3 * side] += planet
        start[N_COORDINATE + side] += sun_rate
        start[N_COORDINATE + 3 + 3 * side : N_COORDINATE + 6 + 3 * side] += planet_rate
    return start


def _causes(
    rng: Generator, truth: str, names: tuple[str, ...], law: str, named: tuple[str, ...]
) -> tuple[Cause, ...]:
    """Draw the causes for a truth; ``named``: catalogue effects that the channels can show."""
    if truth == "none":
        return ()
    if truth == "pair":
        return tuple(draw_cause(rng, effect, names, law) for effect in _pair(rng, named))
    among = {"single": named, "unseen": tuple(UNSEEN), "unknown": UNNAMED}.get(truth, (truth,))
    if truth == "unknown" and rng.random() < RANDOM_SHARE:
        among = tuple(RANDOM_PHYSICS)
    return (draw_cause(rng, str(rng.choice(among)), names, law),)


def _pair(rng: Generator, named: tuple[str, ...]) -> tuple[str, str]:
    """Draw two different effects of ``named`` that can act together."""
    while True:
        first, second = (str(name) for name in rng.choice(named, 2, replace=False))
        if not _clash(first, second):
            return first, second


def _clash(first: str, second: str) -> bool:
    """Return whether two effects use the same fields of the rig model, or are both of sensors."""
    return {first, second} == {"tooth_crack", "tooth_spall"} or (
        first in SENSORS and second in SENSORS
    )


def draw_cause(rng: Generator, name: str, names: tuple[str, ...], law: str = "both") -> Cause:
    """Draw locus, shape and law of an effect; its size is the first one to try.

    Args:
        name: key of ``KINDS``.
        names: recorded channels.
        law: catalogue, other or both.
    """
    kind = KINDS[name]
    locus, shape = kind.draw(rng, names)
    effect = name if name in NAMED else "unknown"
    return Cause(effect, name, locus, shape | draw_law(rng, name, law), kind.start)
