"""Damaged teeth: once-per-revolution events, found by synchronous averaging of the residual.

A cracked tooth reduces stiffness, a spalled one adds a displacement, each over a window of the
path of contact with a free curve. The phase at which the same tooth meets the other meshes depends
on the assembly, to half a mesh cycle.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.machine import Amplitudes, Hypothesis
from herringbone_sim.diagnosis.products import Block, residual_without_nuisance
from herringbone_sim.effects.effect import Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.effects.site import is_ring, planet_angles
from herringbone_sim.gap.observations import balance, force_law
from herringbone_sim.gap.observations.basis import Function
from herringbone_sim.gap.observations.coefficients import (
    DEPARTURE_SHARE,
    CoefficientBuilder,
    Weights,
)
from herringbone_sim.gap.observations.gear import Gear
from herringbone_sim.gap.observations.law import Law, MeshMotion
from herringbone_sim.gap.observations.runs import GearRun
from herringbone_sim.gap.residuals.balance import inertia_parts, window_of

BINS_PER_CYCLE = 6  # of the average; runs have ten samples a mesh cycle or more
CONTACT_CYCLES = 1.5  # mesh cycles of contact of a tooth pair (contact ratio), by data sheet
HALF_CONTACT = 0.5 * CONTACT_CYCLES  # mesh cycles from the middle of a contact to its end
KNOT_SPACING = 0.125  # mesh cycles between knots of the window; three samples at 24 a cycle
# Mesh cycles from the middle of the window.
KNOTS = np.arange(-9, 10, dtype=np.float64) * KNOT_SPACING


@dataclass(frozen=True)
class Fold:
    """Synchronous sums over the revolution of a member, by mesh and bin.

    Attributes:
        A, b: (n_mesh, bins) column squared, and column times residual.
    """

    A: Array
    b: Array


def mesh_delays(gear: Gear, member: str) -> Iterator[tuple[str, Array]]:
    """Name and delay (n_mesh,) [mesh cycles] of a tooth at each mesh, by variant of assembly."""
    cycles = force_law.cycles_per_member_turn(gear.model)[member]
    if member == "planet":
        for half in (0.5 * cycles, np.floor(0.5 * cycles), np.ceil(0.5 * cycles)):
            yield f"{half:g}", half * is_ring(gear.model.layout)
        return
    turn = planet_angles(gear.model) / (2.0 * np.pi) * cycles
    for name, late in (("forward", turn), ("backward", -turn)):
        yield name, late
        if not np.allclose(np.rint(late), late):
            yield f"{name} in step", np.rint(late)


def tooth_meets(member: str, locus: Locus) -> bool:
    """Whether a place is one that a tooth of the member can have."""
    if member == "planet":
        return locus.planet != "all"
    return locus.mesh == {"sun": "sp", "ring": "rp"}[member]


@dataclass(frozen=True)
class _Row:
    """One row of an observation as far as it concerns one mesh: arrays (n,).

    Attributes:
        mesh: number of the mesh.
        phase: mesh phase [rad].
        residual: over its noise.
        columns: by kind of event: change by a unit event at all times, over the noise.
    """

    mesh: int
    phase: Array
    residual: Array
    columns: Mapping[str, Array]


def mesh_rows(gear: Gear, amplitudes: Amplitudes) -> list[_Row]:
    """All rows about a change of the law: force law, and balance for meshes without force."""
    found: list[_Row] = []
    through = gear.has_balance and bool(gear.modelled.any())
    balances = gear.blocks(amplitudes, {}, (balance.NAME,)) if through else []
    for r, g in enumerate(gear.runs):
        m = g.strided
        of_law = {f: a[r] for f, a in amplitudes.get(force_law.NAME, {}).items()}
        now = gear.law_of(m, of_law, ())
        residual = (m.F - now.force) / now.sigma
        columns = {kind: c / now.sigma for kind, c in event_columns(m, now).items()}
        found += [
            _Row(j, m.phase, residual[:, j], {kind: c[:, j] for kind, c in columns.items()})
            for j in np.flatnonzero(np.isfinite(residual).all(axis=0)).tolist()
        ]
        if through:
            now = gear.law_of(g.motion, of_law, ())
            found += _balance_rows(gear, g, now, balances[r][balance.NAME])
    return found


def event_columns(m: MeshMotion, now: Law) -> dict[str, Array]:
    """(n, n_mesh) force [N] that an event of unit size adds, by kind, as if it never ended."""
    return {
        "tooth_crack": -m.k * now.f,
        "tooth_spall": -now.k * (now.contact_drive + now.contact_back),
    }


def _balance_rows(gear: Gear, g: GearRun, now: Law, block: Block) -> list[_Row]:
    """Rows of the balance for each mesh whose force comes from the law."""
    look = window_of(g.run, gear.window_cycles)
    stride = max(1, round(look.deviation))
    root = np.sqrt(block.independent_share)
    residual, phase = root * residual_without_nuisance(block), g.motion.phase[block.sample_index]
    reach = inertia_parts(gear.model).sum(0)
    pushed = {k: look.average(c)[::stride] for k, c in event_columns(g.motion, now).items()}
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


def fold_over_turn(gear: Gear, every: Sequence[_Row], member: str) -> dict[str, Fold]:
    """Average rows synchronously with a member's revolution, for both kinds of event."""
    cycles = force_law.cycles_per_member_turn(gear.model)[member]
    bins = round(BINS_PER_CYCLE * cycles)
    n = gear.model.layout.n_mesh
    found = {kind: Fold(np.zeros((n, bins)), np.zeros((n, bins))) for kind in EVENT_KINDS}
    for row in every:
        turned = np.mod(row.phase / (2.0 * np.pi), cycles)
        at = np.floor(turned * BINS_PER_CYCLE).astype(int) % bins
        for kind, c in row.columns.items():
            found[kind].A[row.mesh] += np.bincount(at, c * c, bins)
            found[kind].b[row.mesh] += np.bincount(at, c * row.residual, bins)
    return found


EVENT_KINDS = ("tooth_crack", "tooth_spall")


def proposals(gear: Gear, amplitudes: Amplitudes, per_kind: int = 4) -> list[Event]:
    """The events that remove most chi2, ``per_kind`` of each kind.

    Args:
        amplitudes: of the current fit; its residual is searched.
    """
    found: list[tuple[float, Event]] = []
    every = mesh_rows(gear, amplitudes)
    for member in ("sun", "planet", "ring"):
        for kind, one in fold_over_turn(gear, every, member).items():
            found += _best_events(gear, member, kind, one)
    found.sort(key=lambda c: -c[0])
    chosen: list[Event] = []
    for _, event in found:
        if sum(other.effect == event.effect for other in chosen) < per_kind:
            chosen.append(event)
    return chosen


def _best_events(gear: Gear, member: str, kind: str, one: Fold) -> list[tuple[float, Event]]:
    """Chi2 removed and event, for the best six places and assemblies of a member."""
    layout = gear.model.layout
    cycles = force_law.cycles_per_member_turn(gear.model)[member]
    bins = one.A.shape[1]
    wide = round(CONTACT_CYCLES * BINS_PER_CYCLE)
    kernel = np.zeros(bins)
    kernel[:wide] = 1.0
    spectrum = np.fft.rfft(kernel)

    def summed(values: Array) -> Array:
        """Circular sum over the length of a contact, for every start bin."""
        return np.asarray(np.fft.irfft(np.fft.rfft(values, axis=1) * spectrum, bins, axis=1))

    A, b = summed(one.A), summed(one.b)
    ranked = []
    for locus in known_effects()[kind].candidates(layout):
        if not tooth_meets(member, locus):
            continue
        mask = locus.mask(layout) > 0.0
        ways = (
            list(mesh_delays(gear, member))
            if mask.sum() > 1
            else [("alone", np.zeros(layout.n_mesh))]
        )
        for _, late in ways:
            shift = np.rint(late * BINS_PER_CYCLE).astype(int)
            total_A = sum(np.roll(A[j], -shift[j]) for j in np.flatnonzero(mask))
            total_b = sum(np.roll(b[j], -shift[j]) for j in np.flatnonzero(mask))
            fall = (
                total_b**2
                / np.maximum(total_A, 1e-300)
                * (total_b > 0.0 if kind == "tooth_crack" else 1.0)
            )
            top = int(np.argmax(fall))
            middle = (top - wide + 1 + 0.5 * wide) / BINS_PER_CYCLE % cycles
            event = Event(kind, locus, member, cycles, float(middle), tuple(late.tolist()))
            ranked.append((float(fall[top]), event))
    ranked.sort(key=lambda c: -c[0])
    return ranked[:6]


def window_functions(
    gear: Gear, label: str, kind: str, member: str, middle: float, late: Array
) -> list[Function]:
    """Hat functions over mesh cycles from an event, named ``LABEL i``, one a knot.

    Args:
        middle: of the event [mesh cycles].
        late: (n_mesh,) delay at each mesh [mesh cycles].
    """
    cycles = force_law.cycles_per_member_turn(gear.model)[member]

    def from_event(m: MeshMotion) -> Array:
        s = m.phase[:, None] / (2.0 * np.pi) - middle - late
        return s - cycles * np.floor(s / cycles + 0.5)

    def made(i: int) -> Function:
        def values(m: MeshMotion, _: Law) -> Array:
            return np.asarray(
                np.maximum(0.0, 1.0 - np.abs(from_event(m) - KNOTS[i]) / KNOT_SPACING)
            )

        def rate(m: MeshMotion, _: Law) -> Array:
            s = from_event(m) - KNOTS[i]
            inside = np.abs(s) < KNOT_SPACING
            return np.where(inside, -np.sign(s), 0.0) / KNOT_SPACING * m.omega / (2.0 * np.pi)

        if kind == "tooth_crack":
            return Function(f"{label} {i}", "kappa", values)
        return Function(f"{label} {i}", "d", values, rate)

    return [made(i) for i in range(len(KNOTS))]


@dataclass(frozen=True)
class Event:
    """A damaged tooth.

    Attributes:
        effect, locus: as in the catalogue.
        member: member with the tooth: sun, planet or ring.
        turn: mesh cycles per revolution of the member relative to the carrier.
        middle: phase of the middle of its contact [mesh cycles].
        late: (n_mesh,) delay of the contact at each mesh [mesh cycles].
    """

    effect: str
    locus: Locus
    member: str
    turn: float
    middle: float
    late: tuple[float, ...]

    def functions(self, gear: Gear, label: str) -> tuple[Function, ...]:
        """Functions of the force law that span its window, on its meshes alone.

        Args:
            gear: with the runs.
            label: prefix of their names.
        """
        late = np.array(self.late)
        at = tuple(np.flatnonzero(self.locus.mask(gear.model.layout)).tolist())
        every = window_functions(gear, label, self.effect, self.member, self.middle, late)
        return tuple(replace(f, meshes=at) for f in every)

    def hypothesis(self, builder: CoefficientBuilder, label: str) -> Hypothesis:
        """Hypothesis: a raised cosine over the window, and departures from it."""
        mask = self.locus.mask(builder.gear.model.layout)
        unit = 0.3 if self.effect == "tooth_crack" else 5e-6
        main: Weights = {f"{label} {i}": -w * mask for i, w in enumerate(BUMP) if w}
        terms = [builder.coefficient(_PARAMETER_NAMES[self.effect], main, unit)]
        for i in range(len(KNOTS)):
            bend: Weights = {f"{label} {i}": -mask}
            terms.append(builder.coefficient(f"window {i}", bend, unit * 2 * DEPARTURE_SHARE))
        options = (("member", self.member),)
        # All coefficients count as own: a free shape at one tooth imitates no other effect.
        return Hypothesis(self.effect, options, self.locus, tuple(terms), len(terms), self)


# Raised cosine over the contact, at the knots.
BUMP = np.where(
    np.abs(KNOTS) < HALF_CONTACT, 0.5 + 0.5 * np.cos(np.pi * KNOTS / HALF_CONTACT), 0.0
)
_PARAMETER_NAMES = {"tooth_crack": "depth", "tooth_spall": "height"}
