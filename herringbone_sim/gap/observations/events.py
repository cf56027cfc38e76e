"""Teeth: events once a revolution, found by folding the residual over the turn of a member.

A cracked tooth takes stiffness, a spalled one displaces; its window over the path of contact is a
curve of its own. Where the same tooth meets the other meshes is a place that assembly leaves open
to half a mesh cycle.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.diagnosis.products import Block, residual_without_nuisance
from herringbone_sim.diagnosis.search import Hypothesis
from herringbone_sim.effects.effect import Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.effects.site import is_ring, planet_angles
from herringbone_sim.gap.observations import balance, force_law
from herringbone_sim.gap.observations.basis import Function
from herringbone_sim.gap.observations.curves import SHAPE
from herringbone_sim.gap.observations.gear import Amplitudes, Gear
from herringbone_sim.gap.observations.law import Law, Motion
from herringbone_sim.gap.observations.places import Places, Weights
from herringbone_sim.gap.observations.runs import GearRun
from herringbone_sim.gap.residuals.balance import inertia_parts, window_of

Array = NDArray[np.float64]

BINS = 6  # to a mesh cycle, which has ten samples or more
SPAN = 1.5  # mesh cycles that a pair of teeth is in contact (contact ratio), data sheet's geometry
WIDE = 0.5 * SPAN  # from the middle of a contact to its end
APART = 0.125  # mesh cycles between knots of a window's curve: three samples of 24 a cycle
KNOTS = np.arange(-9, 10, dtype=np.float64) * APART  # from the window's middle


@dataclass(frozen=True)
class Fold:
    """Sums over the turn of a member: (n_mesh, bins) squares of a column and products with r."""

    A: Array
    b: Array


def lags(gear: Gear, member: str) -> Iterator[tuple[str, Array]]:
    """When in mesh cycles (n_mesh,) a tooth of a member meets each mesh, by ways of assembly."""
    cycles = force_law.members(gear.model)[member]
    if member == "planet":
        for half in (0.5 * cycles, np.floor(0.5 * cycles), np.ceil(0.5 * cycles)):
            yield f"{half:g}", half * is_ring(gear.model.layout)
        return
    turn = planet_angles(gear.model) / (2.0 * np.pi) * cycles
    for name, late in (("forward", turn), ("backward", -turn)):
        yield name, late
        if not np.allclose(np.rint(late), late):
            yield f"{name} in step", np.rint(late)


def meets(member: str, locus: Locus) -> bool:
    """Whether a tooth of a member meets just these meshes."""
    if member == "planet":
        return locus.planet != "all"
    return locus.mesh == {"sun": "sp", "ring": "rp"}[member]


@dataclass(frozen=True)
class _Row:
    """What one row of an observation says of one mesh: arrays (n,).

    Attributes:
        mesh: its number.
        phase: [rad].
        residual: over its noise.
        columns: by kind of event, per unit of it, over the noise.
    """

    mesh: int
    phase: Array
    residual: Array
    columns: Mapping[str, Array]


def rows(gear: Gear, amplitudes: Amplitudes) -> list[_Row]:
    """All rows about a change of the law: force law, or the balance of meshes without force."""
    found: list[_Row] = []
    through = gear.balanced and bool(gear.modelled.any())
    balances = gear.blocks(amplitudes, {}, (balance.NAME,)) if through else []
    for r, g in enumerate(gear.runs):
        m = g.some
        of_law = {f: a[r] for f, a in amplitudes.get(force_law.NAME, {}).items()}
        now = gear.law_of(m, of_law, ())
        residual = (m.F - now.force) / now.sigma
        columns = {kind: c / now.sigma for kind, c in columns_of(m, now).items()}
        found += [
            _Row(j, m.phase, residual[:, j], {kind: c[:, j] for kind, c in columns.items()})
            for j in np.flatnonzero(np.isfinite(residual).all(axis=0)).tolist()
        ]
        if through:
            now = gear.law_of(g.motion, of_law, ())
            found += _balance_rows(gear, g, now, balances[r][balance.NAME])
    return found


def columns_of(m: Motion, now: Law) -> dict[str, Array]:
    """(n, n_mesh) force [N] that a unit of each kind of event adds."""
    return {
        "tooth_crack": -m.k * now.f,
        "tooth_spall": now.k * (now.drive + now.back),
    }


def _balance_rows(gear: Gear, g: GearRun, now: Law, block: Block) -> list[_Row]:
    """Rows of the balance, one for each mesh whose force comes from the law."""
    look = window_of(g.run, gear.width)
    stride = max(1, round(look.deviation))
    root = np.sqrt(block.independent_share)
    residual, phase = root * residual_without_nuisance(block), g.motion.phase[block.sample_index]
    reach = inertia_parts(gear.model).sum(0)
    pushed = {k: look.average(c)[::stride] for k, c in columns_of(g.motion, now).items()}
    return [
        _Row(
            j,
            phase,
            residual[:, z],
            {k: root * reach[z, j] * c[:, j] / block.sigma[:, z] for k, c in pushed.items()},
        )
        for j in np.flatnonzero(gear.modelled).tolist()
        for z in np.flatnonzero(reach[:, j]).tolist()
    ]


def fold(gear: Gear, every: Sequence[_Row], member: str) -> dict[str, Fold]:
    """Folds of both kinds of event over the turn of a member."""
    cycles = force_law.members(gear.model)[member]
    bins = round(BINS * cycles)
    n = gear.model.layout.n_mesh
    found = {kind: Fold(np.zeros((n, bins)), np.zeros((n, bins))) for kind in KINDS}
    for row in every:
        turned = np.mod(row.phase / (2.0 * np.pi), cycles)
        at = np.floor(turned * BINS).astype(int) % bins
        for kind, c in row.columns.items():
            found[kind].A[row.mesh] += np.bincount(at, c * c, bins)
            found[kind].b[row.mesh] += np.bincount(at, c * row.residual, bins)
    return found


KINDS = ("tooth_crack", "tooth_spall")


def proposals(gear: Gear, amplitudes: Amplitudes, per_kind: int = 4) -> list[Event]:
    """The most promising events of both kinds."""
    found: list[tuple[float, Event]] = []
    every = rows(gear, amplitudes)
    for member in ("sun", "planet", "ring"):
        for kind, one in fold(gear, every, member).items():
            found += _ranked(gear, member, kind, one)
    found.sort(key=lambda c: -c[0])
    chosen: list[Event] = []
    for _, event in found:
        if sum(other.effect == event.effect for other in chosen) < per_kind:
            chosen.append(event)
    return chosen


def _ranked(gear: Gear, member: str, kind: str, one: Fold) -> list[tuple[float, Event]]:
    layout = gear.model.layout
    cycles = force_law.members(gear.model)[member]
    bins = one.A.shape[1]
    wide = round(SPAN * BINS)
    kernel = np.zeros(bins)
    kernel[:wide] = 1.0
    spectrum = np.fft.rfft(kernel)

    def summed(values: Array) -> Array:
        return np.asarray(np.fft.irfft(np.fft.rfft(values, axis=1) * spectrum, bins, axis=1))

    A, b = summed(one.A), summed(one.b)
    ranked = []
    for locus in known_effects()[kind].candidates(layout):
        if not meets(member, locus):
            continue
        mask = locus.mask(layout) > 0.0
        ways = list(lags(gear, member)) if mask.sum() > 1 else [("alone", np.zeros(layout.n_mesh))]
        for _, late in ways:
            shift = np.rint(late * BINS).astype(int)
            total_A = sum(np.roll(A[j], -shift[j]) for j in np.flatnonzero(mask))
            total_b = sum(np.roll(b[j], -shift[j]) for j in np.flatnonzero(mask))
            fall = (
                total_b**2
                / np.maximum(total_A, 1e-300)
                * (total_b > 0.0 if kind == "tooth_crack" else 1.0)
            )
            top = int(np.argmax(fall))
            middle = (top - wide + 1 + 0.5 * wide) / BINS % cycles
            event = Event(kind, locus, member, float(middle), tuple(late.tolist()))
            ranked.append((float(fall[top]), event))
    ranked.sort(key=lambda c: -c[0])
    return ranked[:6]


def window(
    gear: Gear, label: str, kind: str, member: str, middle: float, late: Array
) -> list[Function]:
    """Hats over the mesh cycles from the middle of an event, each mesh at its own time."""
    cycles = force_law.members(gear.model)[member]

    def from_event(m: Motion) -> Array:
        s = m.phase[:, None] / (2.0 * np.pi) - middle - late
        return s - cycles * np.floor(s / cycles + 0.5)

    def made(i: int) -> Function:
        def values(m: Motion, _: Law) -> Array:
            return np.asarray(np.maximum(0.0, 1.0 - np.abs(from_event(m) - KNOTS[i]) / APART))

        def rate(m: Motion, _: Law) -> Array:
            s = from_event(m) - KNOTS[i]
            inside = np.abs(s) < APART
            return np.where(inside, -np.sign(s), 0.0) / APART * m.omega / (2.0 * np.pi)

        if kind == "tooth_crack":
            return Function(f"{label} {i}", "kappa", values)
        return Function(f"{label} {i}", "d", values, rate)

    return [made(i) for i in range(len(KNOTS))]


@dataclass(frozen=True)
class Event:
    """An event once a revolution.

    Attributes:
        effect, locus: as in the catalogue.
        member: that carries the tooth.
        middle: of its window [mesh cycles].
        late: (n_mesh,) when it meets each mesh [mesh cycles].
    """

    effect: str
    locus: Locus
    member: str
    middle: float
    late: tuple[float, ...]

    def functions(self, gear: Gear, label: str) -> tuple[Function, ...]:
        late = np.array(self.late)
        at = tuple(np.flatnonzero(self.locus.mask(gear.model.layout)).tolist())
        every = window(gear, label, self.effect, self.member, self.middle, late)
        return tuple(replace(f, meshes=at) for f in every)

    def place(self, places: Places, label: str) -> Hypothesis:
        """With its coefficients: a raised cosine and departures from it."""
        mask = self.locus.mask(places.gear.model.layout)
        sign, unit = (-1.0, 0.3) if self.effect == "tooth_crack" else (1.0, 5e-6)
        main: Weights = {f"{label} {i}": sign * w * mask for i, w in enumerate(BUMP) if w}
        terms = [places.coefficient(_NAMES[self.effect], main, unit)]
        for i in range(len(KNOTS)):
            bend: Weights = {f"{label} {i}": sign * mask}
            terms.append(places.coefficient(f"window {i}", bend, unit * 2 * SHAPE))
        options = (("member", self.member),)
        # A window of its own time and place is no rival's way out: its form is free.
        return Hypothesis(self.effect, options, self.locus, tuple(terms), len(terms), self)


BUMP = np.where(np.abs(KNOTS) < WIDE, 0.5 + 0.5 * np.cos(np.pi * KNOTS / WIDE), 0.0)
_NAMES = {"tooth_crack": "depth", "tooth_spall": "height"}
