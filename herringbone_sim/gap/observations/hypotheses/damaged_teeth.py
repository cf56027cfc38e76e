"""Damaged teeth: once-per-revolution events, found by synchronous averaging of the residual.

A cracked tooth reduces the stiffness, a spalled one adds a displacement, each by a free curve over
the path of contact. The delay after which the same tooth reaches other meshes depends on the
assembly; it is tried with and without rounding to whole mesh cycles.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import mesh_phases
from herringbone_sim.diagnosis.machine import Amplitudes, Hypothesis
from herringbone_sim.diagnosis.products import Block, residual_without_nuisance
from herringbone_sim.effects.effect import Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.effects.site import is_ring, planet_angles, whole_cycles
from herringbone_sim.gap.observations import force_law, torque_balance
from herringbone_sim.gap.observations.basis import Function
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.hypotheses.coefficients import (
    DEPARTURE_SHARE,
    CoefficientBuilder,
    Weights,
)
from herringbone_sim.gap.observations.runs import GearRun
from herringbone_sim.gap.residuals.mesh_law import Law, MeshMotion
from herringbone_sim.gap.residuals.torque_balance import inertia_parts, window_of

BINS_PER_CYCLE = 6  # of the synchronous sums; runs have ten samples a mesh cycle or more
CONTACT_CYCLES = 1.5  # mesh cycles of contact of a tooth pair (contact ratio), by data sheet
HALF_CONTACT = 0.5 * CONTACT_CYCLES  # mesh cycles from the middle of a contact to its end
KNOT_SPACING = 0.125  # mesh cycles between knots of the curve; three samples at 24 a cycle
# Knots of the curve [mesh cycles], from the middle of the contact.
KNOTS = np.arange(-9, 10, dtype=np.float64) * KNOT_SPACING


def contact_shape(s: Array) -> Array:
    """Raised cosine over a contact, 1 at its middle; s: mesh cycles from the middle."""
    return np.where(np.abs(s) < HALF_CONTACT, 0.5 + 0.5 * np.cos(np.pi * s / HALF_CONTACT), 0.0)


BUMP = contact_shape(KNOTS)
WHOLE = np.floor, np.ceil


def mesh_delays(gear: GearObservations, member: str) -> Iterator[tuple[str, Array]]:
    """Yield the name of each assembly tried and the delays (n_mesh,) of a tooth [mesh cycles].

    By the angles of the planets, and in step with k(t) of each mesh, see ``site.whole_cycles``.
    """
    cycles = force_law.cycles_per_member_turn(gear.model)[member]
    ahead = mesh_phases(gear.model.parameters) / (2.0 * np.pi)
    if member == "planet":
        late = 0.5 * cycles * is_ring(gear.model.layout)
        whole = [np.where(late > 0.0, to(late + ahead), np.rint(ahead)) for to in WHOLE]
        tried = [late, *(way - ahead for way in whole)]
        for way in {tuple(np.round(way, 9)): way for way in tried}.values():
            yield f"{way[-1]:g}", way
        return
    turn = planet_angles(gear.model) / (2.0 * np.pi) * cycles
    for name, late in (("forward", turn), ("backward", -turn)):
        yield name, late
        in_step = np.rint(late + ahead) - ahead
        if not np.allclose(in_step, late):
            yield f"{name} in step", in_step


def tooth_meets(member: str, locus: Locus) -> bool:
    """Whether a tooth of ``member`` (sun, planet or ring) may act at all meshes of a place."""
    if member == "planet":
        return locus.planet != "all"
    return locus.mesh == {"sun": "sp", "ring": "rp"}[member]


@dataclass(frozen=True)
class _Row:
    """Residual of one row of an observation, and its response to events at one mesh; arrays (n,).

    Attributes:
        mesh: index of the mesh.
        phase: mesh phase [rad].
        residual: over its noise.
        columns: by kind of event: change by a unit event that acts all the time, over the noise.
    """

    mesh: int
    phase: Array
    residual: Array
    columns: Mapping[str, Array]


def mesh_rows(gear: GearObservations, amplitudes: Amplitudes) -> list[_Row]:
    """Rows of force law and, for meshes without force, balance; all runs, about ``amplitudes``."""
    rows: list[_Row] = []
    through = gear.has_balance and bool(gear.modelled.any())
    balances = gear.blocks(amplitudes, {}, (torque_balance.NAME,)) if through else []
    for r, g in enumerate(gear.runs):
        m = g.strided
        of_law = {f: a[r] for f, a in amplitudes.get(force_law.NAME, {}).items()}
        now = gear.law_of(m, of_law, ())
        residual = (m.F - now.force) / now.sigma
        columns = {kind: c / now.sigma for kind, c in event_columns(m, now).items()}
        rows += [
            _Row(j, m.phase, residual[:, j], {kind: c[:, j] for kind, c in columns.items()})
            for j in np.flatnonzero(np.isfinite(residual).all(axis=0)).tolist()
        ]
        if through:
            now = gear.law_of(g.motion, of_law, ())
            rows += _balance_rows(gear, g, now, balances[r][torque_balance.NAME])
    return rows


def event_columns(m: MeshMotion, now: Law) -> dict[str, Array]:
    """Force (n, n_mesh) [N] of an event of unit size that acts all the time, by kind."""
    return {
        "tooth_crack": -m.k * now.f,
        "tooth_spall": -now.k * (now.contact_drive + now.contact_back),
    }


def _balance_rows(gear: GearObservations, g: GearRun, now: Law, block: Block) -> list[_Row]:
    """Return a row for each mesh without recorded force and coordinate that it accelerates."""
    look = window_of(g.run)
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


def fold_over_turn(gear: GearObservations, rows: Sequence[_Row], member: str) -> dict[str, Array]:
    """Sum rows over all revolutions of a member, by bin of the revolution.

    Returns:
        (2, n_mesh, bins) by kind of event: sums of the squared column, and of column times
        residual; both over the noise.
    """
    cycles = force_law.cycles_per_member_turn(gear.model)[member]
    bins = round(BINS_PER_CYCLE * cycles)
    folds = {kind: np.zeros((2, gear.model.layout.n_mesh, bins)) for kind in EVENT_KINDS}
    for row in rows:
        turned = np.mod(row.phase / (2.0 * np.pi), cycles)
        at = np.floor(turned * BINS_PER_CYCLE).astype(int) % bins
        for kind, c in row.columns.items():
            A, b = folds[kind]
            A[row.mesh] += np.bincount(at, c * c, bins)
            b[row.mesh] += np.bincount(at, c * row.residual, bins)
    return folds


EVENT_KINDS = ("tooth_crack", "tooth_spall")


def proposals(gear: GearObservations, amplitudes: Amplitudes, per_kind: int = 4) -> list[Event]:
    """Return the events that remove most chi2, best first, at most ``per_kind`` of each kind.

    Args:
        amplitudes: of the current fit, whose residual is searched.
    """
    candidates: list[tuple[float, Event]] = []
    rows = mesh_rows(gear, amplitudes)
    for member in ("sun", "planet", "ring"):
        for kind, fold in fold_over_turn(gear, rows, member).items():
            candidates += _best_events(gear, member, kind, fold)
    candidates.sort(key=lambda c: -c[0])
    chosen: list[Event] = []
    for _, event in candidates:
        if sum(other.effect == event.effect for other in chosen) < per_kind:
            chosen.append(event)
    return chosen


def _best_events(
    gear: GearObservations, member: str, kind: str, fold: Array
) -> list[tuple[float, Event]]:
    """Chi2 removed and event, of the best six places and assemblies.

    ``fold``: (2, n_mesh, bins) sums of the kind, see ``fold_over_turn``.
    """
    layout = gear.model.layout
    cycles = force_law.cycles_per_member_turn(gear.model)[member]
    bins = fold.shape[2]
    wide = round(CONTACT_CYCLES * BINS_PER_CYCLE)
    kernel = np.zeros(bins)
    kernel[:wide] = 1.0
    spectrum = np.fft.rfft(kernel)

    def summed(values: Array) -> Array:
        """Circular sum over the length of a contact, by the last bin of the contact."""
        return np.asarray(np.fft.irfft(np.fft.rfft(values, axis=1) * spectrum, bins, axis=1))

    A, b = map(summed, fold)
    ranked = []
    for locus in known_effects()[kind].candidates(layout):
        if not tooth_meets(member, locus):
            continue
        mask = locus.mask(layout) > 0.0
        ways = [late for _, late in mesh_delays(gear, member)]
        if mask.sum() == 1:
            ways = [whole_cycles(gear.model, mask.astype(float), {"member": member})[2]]
        for late in ways:
            shift = np.rint(late * BINS_PER_CYCLE).astype(int)
            total_A = sum(np.roll(A[j], -shift[j]) for j in np.flatnonzero(mask))
            total_b = sum(np.roll(b[j], -shift[j]) for j in np.flatnonzero(mask))
            fall = total_b**2 / np.maximum(total_A, 1e-300)
            fall *= total_b > 0.0 if kind == "tooth_crack" else 1.0
            top = int(np.argmax(fall))
            middle = (top - wide + 1 + 0.5 * wide) / BINS_PER_CYCLE % cycles
            event = Event(kind, locus, member, cycles, float(middle), tuple(late.tolist()))
            ranked.append((float(fall[top]), event))
    ranked.sort(key=lambda c: -c[0])
    return ranked[:6]


@dataclass(frozen=True)
class Event:
    """A damaged tooth.

    Attributes:
        effect, locus: as in the catalogue.
        member: member with the tooth: sun, planet or ring.
        turn: mesh cycles per revolution of the member relative to the carrier.
        middle: mesh phase of the middle of its contact [mesh cycles].
        late: (n_mesh,) delay of the contact at each mesh [mesh cycles].
    """

    effect: str
    locus: Locus
    member: str
    turn: float
    middle: float
    late: tuple[float, ...]

    def functions(self, gear: GearObservations, label: str) -> tuple[Function, ...]:
        """Return a hat function of the force law for each of ``KNOTS``, on the event's meshes.

        They are named ``LABEL i`` and span the curve of the event.
        """
        late: Array = np.array(self.late)
        at = tuple(np.flatnonzero(self.locus.mask(gear.model.layout)).tolist())

        last: tuple[Array, Array] | None = None  # of the functions, which follow one another

        def from_event(m: MeshMotion) -> Array:
            nonlocal last
            known = last  # another thread may replace it
            if known is not None and known[0] is m.phase:
                return known[1]
            s = m.phase[:, None] / (2.0 * np.pi) - self.middle - late
            cycles: Array = s - self.turn * np.floor(s / self.turn + 0.5)
            last = m.phase, cycles
            return cycles

        def made(i: int) -> Function:
            def values(m: MeshMotion, _: Law) -> Array:
                return np.asarray(
                    np.maximum(0.0, 1.0 - np.abs(from_event(m) - KNOTS[i]) / KNOT_SPACING)
                )

            def rate(m: MeshMotion, _: Law) -> Array:
                s = from_event(m) - KNOTS[i]
                inside = np.abs(s) < KNOT_SPACING
                return np.where(inside, -np.sign(s), 0.0) / KNOT_SPACING * m.omega / (2.0 * np.pi)

            if self.effect == "tooth_crack":
                return Function(f"{label} {i}", "kappa", values, meshes=at)
            return Function(f"{label} {i}", "d", values, rate, meshes=at)

        return tuple(made(i) for i in range(len(KNOTS)))

    def hypothesis(self, builder: CoefficientBuilder, label: str) -> Hypothesis:
        """Hypothesis of the event: a raised cosine over the contact, and departures from it."""
        mask = self.locus.mask(builder.gear.model.layout)
        unit = 0.3 if self.effect == "tooth_crack" else 5e-6
        main: Weights = {f"{label} {i}": -w * mask for i, w in enumerate(BUMP) if w}
        terms = [builder.coefficient(_PARAMETER_NAMES[self.effect], main, unit)]
        for i in range(len(KNOTS)):
            bend: Weights = {f"{label} {i}": -mask}
            terms.append(builder.coefficient(f"window {i}", bend, unit * 2 * DEPARTURE_SHARE))
        options = (("member", self.member),)
        # None counts as a departure: a free curve at a single tooth imitates no other effect.
        return Hypothesis(self.effect, options, self.locus, tuple(terms), len(terms), self)


_PARAMETER_NAMES = {"tooth_crack": "depth", "tooth_spall": "height"}
