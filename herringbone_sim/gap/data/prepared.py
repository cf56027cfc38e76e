"""A campaign as arrays: measured channels, their noise, nominal k(t) and e(t) at each sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from herringbone_sim.arrays import Array, Flags
from herringbone_sim.core.model import Model
from herringbone_sim.core.parameters import Parameters
from herringbone_sim.gap.data.mesh_excitation import Waves, waves
from herringbone_sim.gap.data.screen import Finding


@dataclass(frozen=True)
class Measured:
    """Channels of one quantity over a run, such as x of all meshes.

    Attributes:
        values: (n, k) [SI]; NaN where a channel was not recorded.
        recorded: (k,) whether each channel was recorded.
        sigma: (k,) standard deviation of the noise, same unit; NaN where not recorded.
        sigma_given: (k,) whether campaign.yaml gives the noise of a channel; None: of no channel.
    """

    values: Array
    recorded: Flags
    sigma: Array
    sigma_given: Flags | None = None

    @property
    def complete(self) -> bool:
        """Whether every channel was recorded."""
        return bool(self.recorded.all())

    def without(self, off: Flags) -> Measured:
        """Copy with the channels ``off`` (k,) not recorded."""
        values, sigma = (np.where(off, np.nan, array) for array in (self.values, self.sigma))
        return replace(self, values=values, recorded=self.recorded & ~off, sigma=sigma)

    def with_noise(self, sigma: Array) -> Measured:
        """Copy with the noise ``sigma`` (k,), except for channels with ``sigma_given`` set."""
        new_sigma = (
            sigma if self.sigma_given is None else np.where(self.sigma_given, self.sigma, sigma)
        )
        return replace(self, sigma=new_sigma)


SHAFTS = ("s_L", "s_R", "c")


@dataclass(frozen=True)
class PreparedRun:
    """One run as arrays, the input of the diagnosis.

    ``x``, ``v``, ``F``, ``u``, ``a`` and ``pin`` are ``Measured``: NaN where not recorded.

    Attributes:
        name: of the folder of the run.
        role: ``fit`` or ``held_out``.
        point: operating point delta_T [K], K, T_1 [N m], Omega.
        times: (n,) [s] since the first sample of the recording; the run begins later than 0 if
            its first part was left out.
        phase: (n,) mesh phase [rad], unwrapped.
        x, v, F: (n, n_mesh) displacement [m], rate [m/s], force [N], in the order of the layout.
        u, a: (n, n_bodies) rotation times base radius [m], and its second derivative [m/s^2].
        pin: (n, planets) force of each planet on the carrier [N].
        model: nominal model at the operating point.
        waves: nominal k(t), e(t) and the derivative of e(t) at ``phase`` minus ``delay_rad``, the
            harmonics of e(t) times ``e_share``.
        recorded_point: samples (n,) of K, delta_T and T_1, by name, as far as recorded.
        findings: problems of the recording, such as channels left out and breaks of the clock.
        delay_rad: delay common to all channels [rad of mesh phase], see
            ``gap.sensors.filter_delay``.
        e_share: factor on the harmonics of e(t) in x by a filter common to all channels; 1: none.
        detrended: names of rotations, such as ``u_c``, recorded without mean and trend: those of
            an encoder that counts from an arbitrary mark.
        encoder_errors: (2 n_bodies,) cos and sin amplitudes [m] by body of errors once a
            revolution that were taken off u or x, see ``observations.encoder_error``; None: none.
    """

    name: str
    role: str
    point: Mapping[str, float]
    times: Array
    phase: Array
    x: Measured
    v: Measured
    F: Measured
    u: Measured
    a: Measured
    pin: Measured
    model: Model
    waves: Waves
    recorded_point: Mapping[str, Array] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    delay_rad: float = 0.0
    e_share: float = 1.0
    detrended: tuple[str, ...] = ()
    encoder_errors: Array | None = None

    def __len__(self) -> int:
        return len(self.times)

    def with_measured(self, quantity: str, measured: Measured) -> PreparedRun:
        """Copy with another ``x``, ``v``, ``F``, ``u``, ``a`` or ``pin``."""
        changed: dict[str, Any] = {quantity: measured}
        return replace(self, **changed)

    def without(self, quantity: str, off: Flags) -> PreparedRun:
        """Copy with the channels ``off`` (k,) of a quantity not recorded."""
        measured: Measured = getattr(self, quantity)
        return self.with_measured(quantity, measured.without(off))

    @property
    def gear_phase(self) -> Array:
        """Mesh phase (n,) [rad] of the motion that the channels show: ``delay_rad`` earlier."""
        return self.phase - self.delay_rad

    def waves_at(self, phase: Array) -> Waves:
        """Nominal waves at recorded mesh phases (n,) [rad], with ``delay_rad`` and ``e_share``."""
        return waves(self.model, phase - self.delay_rad, self.omega_rad_per_s, self.e_share)

    @property
    def shafts_known(self) -> bool:
        """Whether rotations or accelerations of both suns and the carrier are measured."""
        at = [self.model.layout.bodies.index(name) for name in SHAFTS]
        u = np.isfinite(self.u.values[:, at]).all(axis=0)
        return bool((u | self.a.recorded[at]).all())

    @property
    def means_known(self) -> bool:
        """Whether no recorded rotation lacks its mean."""
        recorded = zip(self.model.layout.bodies, self.u.recorded, strict=True)
        return not any(on and f"u_{body}" in self.detrended for body, on in recorded)

    @property
    def rotations_alone(self) -> bool:
        """Whether rotations of all bodies, and no displacement, rate or force, are recorded."""
        others = self.x.recorded.any() or self.v.recorded.any() or self.F.recorded.any()
        return bool(self.u.complete and self.shafts_known and not others)

    @property
    def step_s(self) -> float:
        """Mean time between samples [s]."""
        return float((self.times[-1] - self.times[0]) / (len(self.times) - 1))

    @property
    def cycles(self) -> float:
        """Number of mesh cycles."""
        return float((self.phase[-1] - self.phase[0]) / (2.0 * np.pi))

    @property
    def cycle_s(self) -> float:
        """Time of a mesh cycle [s]."""
        return 2.0 * np.pi / self.omega_rad_per_s

    @property
    def omega_rad_per_s(self) -> float:
        """Mean mesh frequency [rad/s]."""
        return float((self.phase[-1] - self.phase[0]) / (self.times[-1] - self.times[0]))


@dataclass(frozen=True)
class PreparedCampaign:
    """Runs of one rig as arrays.

    Attributes:
        rig: name.
        nominal: parameters of the full model; each run has its own operating point.
        runs: runs that could be read.
        missing: (name, reason) of runs that could not be read.
        noise_known: whether campaign.yaml gives the noise; else it is estimated from spectra.
        gain_tolerance: (n_mesh,) relative, of force sensors by campaign.yaml; 0 where not given.
    """

    rig: str
    nominal: Parameters
    runs: tuple[PreparedRun, ...]
    missing: tuple[tuple[str, str], ...]
    noise_known: bool = True
    gain_tolerance: tuple[float, ...] = ()

    def of_role(self, role: str) -> tuple[PreparedRun, ...]:
        """Runs of the role ``fit`` or ``held_out``."""
        return tuple(run for run in self.runs if run.role == role)


def deciding(runs: Sequence[PreparedRun]) -> Sequence[PreparedRun]:
    """Return the runs that corrections of all runs are estimated from: fit runs; if none, all."""
    return [run for run in runs if run.role == "fit"] or runs
