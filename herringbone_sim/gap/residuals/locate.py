"""Distribution of the force-law residual over meshes, contact, phase, load and temperature.

The chi2 above the noise is divided among the values of each of these factors. Two tests look for a
residual that repeats with each revolution of sun, planets or ring against the carrier (a faulty
tooth) or with an order of the input shaft. The first compares with random permutations of the mesh
cycles of a run, so that neither correlation within a cycle nor the level of a run counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtri

from herringbone_sim.arrays import Array, Indices
from herringbone_sim.gap.data.prepared import MeshTable, PreparedRun
from herringbone_sim.gap.residuals.recalibrate import ForceLaw

PHASES = 12  # bins of a mesh cycle
SHAFT_ORDERS = 60
BETWEEN = (-0.6, -0.5, -0.4, 0.4, 0.5, 0.6)  # from an order to the orders it is compared with
# Parameter with the number of teeth: mesh cycles of one revolution against the carrier.
ROTATIONS = {"sun": "z_s", "planet": "z_p", "ring": "z_r"}


@dataclass(frozen=True)
class Share:
    """Distribution of a residual over the m values of one factor, such as the mesh.

    Attributes:
        labels: the values of the factor, such as names of meshes or ``back``, ``apart``,
            ``drive``.
        reduced_chi2: (m,) mean square of residual over noise at each value: 1 for noise alone.
        share: (m,) fraction of the chi2 above the noise at each value; the sum is 1, or 0 if no
            value is above the noise.
    """

    labels: tuple[str, ...]
    reduced_chi2: Array
    share: Array


@dataclass(frozen=True)
class Periodicity:
    """Test of a residual for repetition with a tooth or a shaft order.

    Attributes:
        labels: names of the m meshes, or m shaft orders as text.
        strength: (m,) test statistic of each label.
        threshold: value that the largest of the m statistics exceeds by chance once in a thousand.
    """

    labels: tuple[str, ...]
    strength: Array
    threshold: float

    @property
    def beyond(self) -> tuple[str, ...]:
        """Labels whose statistic exceeds the threshold."""
        return tuple(
            n for n, s in zip(self.labels, self.strength, strict=True) if s > self.threshold
        )


@dataclass(frozen=True)
class Location:
    """Result of ``locate``.

    Attributes:
        shares: by factor: mesh, kind, planet, side, contact, phase, T_1, delta_T, Omega, modes.
        teeth: by member (sun, planet, ring): whether the residual of each mesh repeats with every
            revolution of the member against the carrier.
        shaft: whether the residual repeats with the orders 1 ... 60 of the input shaft.
    """

    shares: Mapping[str, Share]
    teeth: Mapping[str, Periodicity]
    shaft: Periodicity


def locate(
    runs: Sequence[PreparedRun],
    laws: Sequence[ForceLaw],
    meshes: MeshTable,
    rng: np.random.Generator,
    permutations: int = 200,
) -> Location:
    """Distribute the force-law residual over meshes and other factors; test it for repetition.

    Args:
        runs: fit runs.
        laws: force law of each run.
        meshes: kind, side and planet of each mesh.
        rng: for the permutations of mesh cycles.
        permutations: number of permutations.
    """
    p = runs[0].model.parameters
    units = [law.residual_n / law.sigma_n for law in laws]
    cycles = [_cycles(run, unit) for run, unit in zip(runs, units, strict=True)]
    lengths = {name: int(getattr(p, teeth)) for name, teeth in ROTATIONS.items()}
    teeth = {
        name: _teeth(cycles, length, meshes.names, rng, permutations)
        for name, length in lengths.items()
    }
    turn = p.z_s * p.z_r / (p.z_s + p.z_r)
    shaft = shaft_order_periodicity([run.phase for run in runs], units, turn)
    return Location(_shares(runs, laws, units, meshes), teeth, shaft)


def _shares(
    runs: Sequence[PreparedRun],
    laws: Sequence[ForceLaw],
    units: Sequence[Array],
    meshes: MeshTable,
) -> dict[str, Share]:
    """Distribute the residuals of the runs, in units of noise (n, n_mesh), over every factor."""
    square = np.concatenate([u**2 for u in units])
    shares = {"mesh": _along_meshes(square, np.arange(len(meshes.names)), meshes.names)}
    shares["kind"] = _along_meshes(square, meshes.kind, ["sp", "rp"])
    shares["side"] = _along_meshes(square, meshes.side, ["L", "R"])
    planets = [str(i + 1) for i in range(int(meshes.planet.max()) + 1)]
    shares["planet"] = _along_meshes(square, meshes.planet, planets)
    contact = np.concatenate([law.flank for law in laws])
    shares["contact"] = _over(square, contact, ["back", "apart", "drive"])
    phase = np.concatenate([_phase_bin(run.phase) for run in runs])
    names = [f"{360 * i // PHASES} deg" for i in range(PHASES)]
    shares["phase"] = _over(square, np.repeat(phase[:, None], square.shape[1], axis=1), names)
    for factor in ("T_1", "delta_T", "Omega"):
        shares[factor] = _over_runs(runs, units, factor)
    shares["modes"] = _modes(np.concatenate(units), meshes)
    return shares


def _over_runs(runs: Sequence[PreparedRun], units: Sequence[Array], factor: str) -> Share:
    """Distribute the residual over the runs, sorted by ``factor`` of their operating point."""
    order = np.argsort([run.point[factor] for run in runs], kind="stable")
    labels = [f"{runs[i].point[factor]:g} ({runs[i].name})" for i in order]
    rank = [np.full(units[i].shape, place) for place, i in enumerate(order)]
    square = [units[i] ** 2 for i in order]
    return _over(np.concatenate(square), np.concatenate(rank), labels)


def _along_meshes(square: Array, of_mesh: Indices, labels: Sequence[str]) -> Share:
    """Return the ``Share`` of each label, for labels that are the same at all samples of a mesh.

    Args:
        square: (n, n_mesh) squares of residual over noise; NaN are left out.
        of_mesh: (n_mesh,) index of the label of each mesh.
    """
    return _over(square, np.broadcast_to(of_mesh, square.shape), labels)


def _over(square: Array, values: Indices, labels: Sequence[str]) -> Share:
    """Return the ``Share`` of each label; arguments as of ``_along_meshes``, index per value."""
    known = np.isfinite(square)
    at = values[known]
    chi2 = np.bincount(at, square[known], minlength=len(labels))
    count = np.bincount(at, minlength=len(labels))
    excess = np.maximum(chi2 - count, 0.0)
    total = excess.sum()
    share = excess / total if total > 0.0 else excess
    return Share(tuple(labels), chi2 / np.maximum(count, 1), share)


def _phase_bin(phase: Array) -> Indices:
    """Return the bin (n,) of the mesh cycle, 0 ... PHASES - 1, of phases (n,) [rad]."""
    return np.floor(np.mod(phase, 2.0 * np.pi) / (2.0 * np.pi) * PHASES).astype(int) % PHASES


def _modes(unit: Array, meshes: MeshTable) -> Share:
    """Distribute the residual over modes of the sides and planets, for each kind of mesh.

    Modes: sum and difference of the sides, each as mean over the planets and deviation from it.
    """
    n = int(meshes.planet.max()) + 1
    r = np.nan_to_num(unit).reshape(len(unit), 2, 2, n)
    labels, sums = [], []
    for sign, name in ((1.0, "L+R"), (-1.0, "L-R")):
        both = (r[:, :, 0] + sign * r[:, :, 1]) / np.sqrt(2.0)
        mean = both.mean(axis=2, keepdims=True)
        for kind, short in enumerate(("sp", "rp")):
            common = float(np.mean(n * mean[:, kind] ** 2))
            apart = float(np.mean(np.sum((both - mean)[:, kind] ** 2, axis=1)))
            labels += [f"{short} {name} planets alike", f"{short} {name} planets apart"]
            sums += [(common, 1.0), (apart, n - 1.0)]
    reduced_chi2 = np.array([chi2 / max(n, 1.0) for chi2, n in sums])
    excess = np.array([max(chi2 - n, 0.0) for chi2, n in sums])
    return Share(tuple(labels), reduced_chi2, excess / max(excess.sum(), 1e-300))


def _cycles(run: PreparedRun, unit: Array) -> tuple[Indices, Array]:
    """Bin a residual (n, m) by mesh cycle and phase: cycle numbers (c,), values (c, PHASES, m).

    A value is the mean of the samples in its bin times the root of their number.
    """
    cycle = np.floor(run.phase / (2.0 * np.pi)).astype(int)
    place = (cycle - cycle[0]) * PHASES + _phase_bin(run.phase)
    size = place.max() + 1
    count = np.bincount(place, minlength=size)
    sums = np.stack([np.bincount(place, np.nan_to_num(u), minlength=size) for u in unit.T], axis=1)
    whole = size // PHASES
    full = (sums / np.maximum(count, 1)[:, None] * np.sqrt(count)[:, None])[: whole * PHASES]
    return cycle[0] + np.arange(whole), full.reshape(whole, PHASES, -1)


def _teeth(
    cycles: Sequence[tuple[Indices, Array]],
    length: int,
    names: tuple[str, ...],
    rng: np.random.Generator,
    permutations: int,
) -> Periodicity:
    """Test, for each mesh, whether the residual repeats after ``length`` mesh cycles.

    The statistic is the sum over the runs of ``_repeats``, on residuals of the variance 1: large
    where one tooth differs from the others. ``cycles``: result of ``_cycles`` for each run.
    """
    strength = np.zeros(len(names))
    chance = np.zeros((permutations, len(names)))
    for number, pattern in cycles:
        if len(number) <= length:
            continue
        varied = pattern - pattern.mean(axis=0)
        level = np.maximum(np.mean(varied**2, axis=(0, 1)), 1e-12)
        flat = varied / np.sqrt(level)
        strength += _repeats(flat, number, length)
        for i in range(permutations):
            chance[i] += _repeats(flat[rng.permutation(len(flat))], number, length)
    return Periodicity(names, strength, float(np.quantile(chance.max(axis=1), 0.999)))


def _repeats(flat: Array, number: Indices, length: int) -> Array:
    """Return the largest chi2 (m,) of the mean residual at a position in the revolution.

    ``flat``: (c, PHASES, m) residual of the mesh cycles ``number`` (c,); ``length``: cycles of a
    revolution.
    """
    fold = np.mod(number, length)
    counts = np.bincount(fold, minlength=length)
    membership = np.zeros((length, len(flat)))
    membership[fold, np.arange(len(flat))] = 1.0 / np.sqrt(np.maximum(counts, 1))[fold]
    mean = membership @ flat.reshape(len(flat), -1)
    chi2 = np.sum(mean.reshape(length, *flat.shape[1:]) ** 2, axis=1)
    repeats: Array = chi2.max(axis=0)
    return repeats


def shaft_order_periodicity(
    phases: Sequence[Array], residuals: Sequence[Array], turn: float
) -> Periodicity:
    """Test residuals for repetition with the orders 1 ... 60 of the input shaft against ground.

    The statistic is the spectral power at an order over that between the orders. An order near a
    multiple, or a simple fraction, of the mesh order (``turn``) can't be separated from the motion
    itself. Channels of one run count as one observation, as they are correlated.

    Args:
        phases: (n,) mesh phase of each run [rad].
        residuals: (n, m) of each run, of the force law or of the balance.
        turn: mesh cycles of one revolution of the shaft, z_s z_r / (z_s + z_r).
    """
    orders = np.arange(1, SHAFT_ORDERS + 1)
    at = (orders[:, None] + np.array([0.0, *BETWEEN])).ravel()
    ratio = np.zeros(SHAFT_ORDERS)
    for phase, residual in zip(phases, residuals, strict=True):
        r = residual[:, np.isfinite(residual).all(axis=0)]
        r = (r - r.mean(axis=0)) / np.maximum(r.std(axis=0), 1e-300)
        r = r * np.hanning(len(r))[:, None]
        wave = np.exp(-1j * np.outer(at, phase / turn))
        power = np.mean(np.abs(wave @ r) ** 2, axis=1).reshape(SHAFT_ORDERS, -1)
        ratio += power[:, 0] / power[:, 1:].mean(axis=1) / len(phases)
    n = 2.0 * len(phases)
    limit = float(fdtri(n, n * len(BETWEEN) / 2.0, 1.0 - 1e-3 / SHAFT_ORDERS))
    return Periodicity(tuple(str(o) for o in orders), ratio, limit)
