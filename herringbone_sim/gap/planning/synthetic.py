"""Simulate campaigns of the nominal gear, recorded by a choice of sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.integrate import simulate
from herringbone_sim.core.layout import QUANTITIES, Layout
from herringbone_sim.core.model import Model, build
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.errors import ParameterError, listed
from herringbone_sim.gap.campaign_checks import FEWEST_CYCLES
from herringbone_sim.gap.data.kinematics import bodies_to_meshes, inverse_masses
from herringbone_sim.gap.data.mesh_excitation import waves
from herringbone_sim.gap.data.prepared import Measured, PreparedCampaign, PreparedRun
from herringbone_sim.gap.observations.body_motion import body_loads
from herringbone_sim.gap.observations.windows.channels import pin_weights
from herringbone_sim.recording.importing.spec import recorded_name

TRANSIENT = 80  # mesh cycles simulated before a recording, as for practice rigs


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviation of the noise of each channel.

    Attributes:
        share: noise over RMS of channels with none of the prefixes below.
        shares: noise over RMS, by prefix of the channel name.
        values: noise [SI], by prefix of the channel name.
    """

    share: float = 0.01
    shares: Mapping[str, float] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)

    @staticmethod
    def is_of(prefix: str, channel: str) -> bool:
        """Whether a channel's name begins with a prefix; a single letter is a whole quantity."""
        return channel.startswith(prefix) and (len(prefix) > 1 or channel[1] == "_")

    def sigma(self, channel: str, rms: float) -> float:
        """Noise [SI] of a channel with an RMS of ``rms`` [SI]; its longest known prefix counts.

        A single letter is a quantity: ``a`` of accelerations, not of angles.
        """
        prefixes = [n for n in (*self.shares, *self.values) if self.is_of(n, channel)]
        longest = max(prefixes, key=len, default="")
        if longest in self.values:
            return self.values[longest]
        return rms * self.shares.get(longest, self.share)


def known_sensors(layout: Layout) -> tuple[str, ...]:
    """Names of all channels that can be recorded, raw angles of encoders included."""
    channels = [name for quantity in QUANTITIES for name in layout.channels_of(quantity)]
    return (*channels, *(f"angle_{body}" for body in layout.bodies))


def check_sensors(layout: Layout, sensors: Sequence[str]) -> None:
    """Check names of sensors; raise ParameterError if there are none, or an unknown one."""
    known = known_sensors(layout)
    foreign = [name for name in sensors if name not in known]
    if foreign or not sensors:
        raise ParameterError(
            "sensors are some of u_s_L, angle_s_L, a_c, x_sp1_L, v_rp2_R, F_sp1_L, F_pin1 and the "
            f"like, got {listed(foreign) or 'none'}: name bodies {', '.join(layout.bodies)}, "
            f"meshes {', '.join(layout.meshes)} or pins {', '.join(layout.channels_of('pin'))}"
        )


def simulate_campaign(
    nominal: Parameters,
    points: Sequence[Mapping[str, float]],
    sensors: Sequence[str],
    noise: SensorNoise,
    cycles: int,
) -> PreparedCampaign:
    """Simulate runs of the nominal gear and record them by some sensors with noise.

    Each run starts from a randomly disturbed state, and its first ``TRANSIENT`` mesh cycles are
    left out. Random numbers are the same in every call.

    Args:
        nominal: parameters of the full model.
        points: delta_T [K], K [-], T_1 [N m] and Omega [-] of each run.
        sensors: names of the recorded channels, see ``known_sensors``.
        noise: standard deviation of the noise of each channel.
        cycles: recorded mesh cycles of each run.

    Returns:
        Campaign of one run per point, all of role ``fit``.

    Raises:
        ParameterError: no sensor or an unknown one, a run that is too short, or a point out of
            range.
        DivergenceError: the motion diverges.
    """
    check_sensors(nominal.layout, sensors)
    if cycles < FEWEST_CYCLES:
        raise ParameterError(
            f"a run has {FEWEST_CYCLES:g} mesh cycles or more, got {cycles}: a diagnosis leaves "
            "out shorter ones"
        )
    rng = np.random.default_rng(0)
    runs = tuple(
        _run(f"run_{i:02d}", nominal, point, sensors, noise, cycles, rng)
        for i, point in enumerate(points)
    )
    return PreparedCampaign("plan", nominal, runs, ())


def _run(
    name: str,
    nominal: Parameters,
    point: Mapping[str, float],
    sensors: Sequence[str],
    noise: SensorNoise,
    cycles: int,
    rng: np.random.Generator,
) -> PreparedRun:
    """Simulate and record one run of ``simulate_campaign``; angles become detrended rotations."""
    start = {"initial_noise": 0.05, "seed": int(rng.integers(2**31 - 1))}
    model = build(nominal.changed({**point, **start}))
    _, settled = simulate(model, TRANSIENT)
    series, _ = simulate(model, cycles, settled)
    layout, phase = model.layout, series["phase"].copy()
    omega = model.parameters.Omega * model.scales.omega_n
    clean = {q: series.columns(layout.channels_of(q)) for q in "xvFu"}
    clean["a"] = accelerations(model, phase, clean["F"])
    clean["pin"] = clean["F"] @ pin_weights(layout).T

    angles = {recorded_name(n): n for n in sensors if n.startswith("angle_")}

    def noise_of(name: str, rms: float) -> float:
        if name not in angles:
            return noise.sigma(name, rms)
        radius = model.scales.base_radius(name.removeprefix("u_"))
        return radius * noise.sigma(angles[name], rms / radius)

    def record(q: str) -> Measured:
        names = layout.channels_of(q)
        there = np.array([n in sensors or n in angles for n in names])
        rms = np.sqrt(np.mean(clean[q] ** 2, axis=0))
        sigma = np.array([noise_of(n, r) for n, r in zip(names, rms, strict=True)])
        values = clean[q] + sigma * rng.normal(size=clean[q].shape)
        return Measured(np.where(there, values, np.nan), there, np.where(there, sigma, np.nan))

    measured: dict[str, Any] = {q: record(q) for q in QUANTITIES}
    return PreparedRun(
        name=name,
        role="fit",
        point=dict(point),
        times=series.times - series.times[0],
        phase=phase,
        **measured,
        model=model,
        waves=waves(model, phase, omega),
        detrended=tuple(name for name in angles if name not in sensors),
    )


def accelerations(model: Model, phase: Array, force: Array) -> Array:
    """Accelerations d2u/dt2 (n, n_bodies) [m/s^2] of the nominal gear.

    From the mesh phase (n,) [rad], which the loads depend on, and mesh forces (n, n_mesh) [N].
    """
    G = bodies_to_meshes(model)
    return np.asarray(inverse_masses(model) * (body_loads(model, phase) - force @ G))
