"""Search windows of the motion for damaged teeth: the events that remove most chi2.

The contact of a damaged tooth excites the motion, so its response outlasts it and reaches all
channels. The response of the windows to a contact of every mesh at every time is computed once,
states are projected out, and responses are summed over the revolutions of each member.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.arrays import Array
from herringbone_sim.diagnosis.machine import Amplitudes
from herringbone_sim.diagnosis.parallel import parallel_map
from herringbone_sim.diagnosis.products import Block
from herringbone_sim.effects.effect import Locus
from herringbone_sim.effects.registry import effects as known_effects
from herringbone_sim.effects.site import whole_cycles
from herringbone_sim.gap.observations import force_law
from herringbone_sim.gap.observations.gear import GearObservations
from herringbone_sim.gap.observations.hypotheses.damaged_teeth import (
    EVENT_KINDS,
    HALF_CONTACT,
    Event,
    contact_shape,
    event_columns,
    mesh_delays,
    tooth_meets,
)
from herringbone_sim.gap.observations.windows import trajectory
from herringbone_sim.gap.observations.windows.columns import responses
from herringbone_sim.gap.observations.windows.trajectory import Trajectory

MIDDLES_PER_CYCLE = 4  # trial positions of a contact per mesh cycle, a sixth of its length apart
MEMBERS = ("sun", "planet", "ring")


@dataclass(frozen=True)
class Contacts:
    """Response of the windows of a run to a damaged contact of each mesh at each time.

    Attributes:
        first_time: middle of the first contact in 1 / ``MIDDLES_PER_CYCLE`` mesh cycles.
        response: by kind of event (n_mesh, times, rows), over the noise, states projected out;
            in single precision, as it takes most of the memory of a diagnosis.
        residual: (rows,) residual of the windows, over the noise.
    """

    first_time: int
    response: dict[str, NDArray[np.float32]]
    residual: Array

    def folded(self, kind: str, bins: int) -> Array:
        """Sum the response over the revolutions of a member.

        Args:
            kind: kind of event, a key of ``response``.
            bins: trial positions of a contact per revolution, ``MIDDLES_PER_CYCLE`` a mesh cycle.

        Returns:
            (n_mesh, bins, rows), over the noise. Bin i holds the sum over the times i, i + bins,
            i + 2 bins, ..., counted from mesh phase 0 as ``first_time`` is.
        """
        response = self.response[kind]
        sums = np.zeros((len(response), bins, response.shape[2]))
        done, times = 0, response.shape[1]
        while done < times:
            at = (self.first_time + done) % bins
            length = min(bins - at, times - done)
            sums[:, at : at + length] += response[:, done : done + length]
            done += length
        return sums


def contact_responses(run_trajectory: Trajectory, block: Block) -> Contacts:
    """Response of the windows of a run to a damaged contact of each mesh at each time.

    Args:
        run_trajectory: windows of the run.
        block: last block of ``run_trajectory``; responses are linear about its states.
    """
    s = run_trajectory.windows
    solution, now, m = run_trajectory.last_linearisation
    at = s.first_half_step[:, None] // 2 + np.arange(s.steps_per_window + 1)
    cycles = m.phase[at] / (2.0 * np.pi)
    before = np.floor((cycles[:, 0] - HALF_CONTACT) * MIDDLES_PER_CYCLE).astype(int)
    last = np.ceil((cycles[:, -1] + HALF_CONTACT) * MIDDLES_PER_CYCLE).astype(int)
    near = np.arange(int((last - before).max()) + 1)
    away = cycles[..., None] - (before[:, None, None] + near) / MIDDLES_PER_CYCLE
    shape = contact_shape(away)
    M = len(s.G)
    clear = run_trajectory.last_elimination.clear
    times = int(before.max() - before.min()) + len(near)
    W, samples, k = s.measured.shape
    of_window = np.repeat(np.arange(W), samples * k)
    of_window = np.append(of_window, np.repeat(np.arange(W - 1), s.G.shape[1] * 2))
    offset, rows = before[of_window] - before.min(), np.arange(len(of_window))
    residual = block.residual[:, 0] / block.sigma[0, 0]
    by_kind = {}
    for kind, force in event_columns(m, now).items():
        by_kind[kind] = np.empty((M, times, len(residual)), dtype=np.float32)
        for j in range(M):  # one by one: responses at all times take much memory
            response = responses(
                s,
                solution,
                np.repeat(-s.inverse_masses * s.G[j : j + 1], len(near), axis=0),
                shape * force[at, j][..., None],
                np.repeat(np.eye(M)[j : j + 1], len(near), axis=0),
            )
            at_times = np.zeros((len(response), times))
            for i in near:
                at_times[rows, offset + i] = response[:, i]
            by_kind[kind][j] = clear(at_times).T / block.sigma[0, 0]
    return Contacts(int(before.min()), by_kind, residual)


def proposals(gear: GearObservations, amplitudes: Amplitudes, per_kind: int = 4) -> list[Event]:
    """Damaged teeth that remove most chi2, ``per_kind`` of each kind; see ``events.proposals``."""
    blocks = gear.blocks(amplitudes, {}, (trajectory.NAME,))
    contacts = parallel_map(
        lambda r: contact_responses(
            gear.trajectory_under(r, amplitudes), blocks[r][trajectory.NAME]
        ),
        range(len(blocks)),
    )
    found = parallel_map(
        lambda of: list(_best_events(gear, contacts, *of)), product(EVENT_KINDS, MEMBERS)
    )
    chosen = []
    for kind in EVENT_KINDS:
        ranked = [best for events in found for best in events if best[1].effect == kind]
        ranked.sort(key=lambda c: -c[0])
        chosen += _distinct_events(gear, ranked)[:per_kind]
    return chosen


def _distinct_events(gear: GearObservations, ranked: Sequence[tuple[float, Event]]) -> list[Event]:
    """Events best first, without those that are equal but for contacts outside the windows.

    Of events of a member that remove the same chi2, the one on most meshes stays, as a tooth meets
    all meshes of its member.
    """
    distinct: dict[tuple[str, str], Event] = {}
    for squares, event in ranked:
        key = event.member, f"{squares:.5e}"
        chosen = distinct.setdefault(key, event)
        if _mesh_count(gear, event) > _mesh_count(gear, chosen):
            distinct[key] = event
    return list(distinct.values())


def _mesh_count(gear: GearObservations, event: Event) -> int:
    """Number of meshes on which an event acts."""
    return int(np.count_nonzero(event.locus.mask(gear.model.layout)))


def _best_events(
    gear: GearObservations, runs: Sequence[Contacts], kind: str, member: str
) -> Iterator[tuple[float, Event]]:
    """Yield chi2 removed and event, for each place and assembly at the time that removes most."""
    layout = gear.model.layout
    cycles = force_law.cycles_per_member_turn(gear.model)[member]
    bins = round(MIDDLES_PER_CYCLE * cycles)
    sought: list[tuple[Locus, Array]] = []
    for locus in known_effects()[kind].candidates(layout):
        # In windows shorter than a revolution, only its meshes tell a planet's tooth from others.
        if tooth_meets(member, locus) and (member == "planet") == (locus.planet != "all"):
            mask = locus.mask(layout)
            ways = [late for _, late in mesh_delays(gear, member)]
            if np.count_nonzero(mask) == 1:
                ways = [whole_cycles(gear.model, mask, {"member": member})[2]]
            sought += [(locus, late) for late in ways]
    A, b = np.zeros((2, len(sought), bins))
    for contacts in runs:
        folded = contacts.folded(kind, bins)
        for i, (locus, late) in enumerate(sought):
            force_column = sum(
                np.roll(folded[j], -round(late[j] * MIDDLES_PER_CYCLE), axis=0)
                for j in np.flatnonzero(locus.mask(layout))
            )
            A[i] += np.einsum("br,br->b", force_column, force_column)
            b[i] += force_column @ contacts.residual
    fall = np.where((b > 0.0) | (kind != "tooth_crack"), b**2 / np.maximum(A, 1e-300), 0.0)
    for i, (locus, late) in enumerate(sought):
        top = int(np.argmax(fall[i]))
        yield (
            float(fall[i, top]),
            Event(kind, locus, member, cycles, top / MIDDLES_PER_CYCLE, tuple(late.tolist())),
        )
