"""Change of the force law by basis functions at given amplitudes, moving parts included."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from herringbone_sim.arrays import Array
from herringbone_sim.core.model import Model
from herringbone_sim.gap.observations.basis import Function
from herringbone_sim.gap.residuals.mesh_law import (
    Displacements,
    Law,
    LawChange,
    MeshMotion,
    law,
)

if TYPE_CHECKING:
    from herringbone_sim.gap.observations.hypotheses.moving_parts import MovingPart

# Order in which slots are filled: functions of a later stage act on the law that the earlier
# stages have changed.
STAGES: tuple[Callable[[Function], bool], ...] = (
    lambda f: f.slot in ("d", "b_plus", "b_minus"),
    lambda f: f.slot in ("kappa", "mean_kappa", "gamma"),
    lambda f: f.slot == "extra_force",
)
NOTHING = np.empty(0)
# For functions that don't depend on the law, see ``Function.by_law``.
NO_LAW = Law(NOTHING, NOTHING, NOTHING, NOTHING, NOTHING, NOTHING, NOTHING, NOTHING)


class LawChanges:
    """Evaluates the change of a gear's force law for amplitudes of its functions.

    Args:
        functions: all functions of the law.
        parts: moving parts, by the label that prefixes the names of their functions.
    """

    def __init__(
        self, model: Model, functions: Sequence[Function], parts: Mapping[str, MovingPart]
    ) -> None:
        self._model = model
        self.functions = tuple(functions)
        self.parts = dict(parts)
        heads = tuple(f"{label} " for label in parts)
        self._others = [f for f in functions if not f"{f.name} ".startswith(heads)]
        self._last: dict[str, tuple[object, set[str], Displacements]] = {}

    def evaluated(
        self,
        m: MeshMotion,
        between: MeshMotion | None,
        amplitudes: Mapping[str, Array],
        wanted: Sequence[str] | None = (),
    ) -> LawChange:
        """Return the change of the law of a run by functions at given amplitudes.

        Args:
            m: motion of the run.
            between: the same motion at finer steps, on which parts are integrated; ``m`` itself
                if its steps are fine enough; None: parts do not move.
            amplitudes: (n_mesh,) by function name.
            wanted: functions whose columns will be formed; None: all.
        """
        change = LawChange(displacements=self._displacements(m, between, amplitudes, wanted))
        for label in self.parts:
            _displace(change, change.displacements, label, amplitudes)
        self._add(change, m, amplitudes)
        return change

    def _add(self, change: LawChange, m: MeshMotion, amplitudes: Mapping[str, Array]) -> None:
        """Add all functions but those of moving parts, at their amplitudes, to ``change``."""
        acting = {name for name, a in amplitudes.items() if np.any(a)}
        on = [f for f in self._others if f.name in acting]
        for stage in STAGES:
            chosen = [f for f in on if stage(f)]
            if chosen:
                now = law(m, change) if any(f.by_law for f in chosen) else NO_LAW
                for f in chosen:
                    _add(change, f, m, now, amplitudes[f.name])

    def _displacements(
        self,
        m: MeshMotion,
        between: MeshMotion | None,
        amplitudes: Mapping[str, Array],
        wanted: Sequence[str] | None,
    ) -> Displacements:
        """Displacements at ``m`` by parts with an amplitude, and derivatives of those wanted."""
        needed = set(self.parts) if wanted is None else set(wanted) & set(self.parts)
        on = [x for x in self.parts if x in needed or np.any(amplitudes.get(x, 0.0))]
        if not on:
            return {}
        if between is None:
            rest = np.zeros_like(m.x)
            names = [n for x in on for n in (x, *(f"{x} {p}" for p in self.parts[x].names))]
            return dict.fromkeys(names, (rest, rest))
        if between is m:
            return self._integrated(m, amplitudes, on, needed)
        there = sorted((name, a.tobytes()) for name, a in amplitudes.items() if np.any(a))
        key = tuple(on), tuple(there)
        last = self._last.get(m.name)
        # Cached: force law and balance of a run are formed at the same amplitudes.
        if last is None or last[0] != key or not needed <= last[1]:
            last = key, needed, self._integrated(between, amplitudes, on, needed)
            self._last[m.name] = last
        step = between.times[1] - between.times[0]
        at = np.rint((m.times - between.times[0]) / step).astype(int)
        return {name: (d[at], rate[at]) for name, (d, rate) in last[2].items()}

    def _integrated(
        self,
        m: MeshMotion,
        amplitudes: Mapping[str, Array],
        on: Sequence[str],
        slopes: set[str],
    ) -> Displacements:
        """Integrate the parts ``on`` in turn, each under the law as changed by those before it.

        ``slopes``: labels of parts whose derivatives by their parameters are computed too.
        """
        displacements: dict[str, tuple[Array, Array]] = {}
        change = LawChange()
        self._add(change, m, amplitudes)
        for label in on:
            part = self.parts[label]
            offsets = [amplitudes.get(f"{label} {name}", np.zeros(1)) for name in part.names]
            sizes = np.array([float(a[np.argmax(np.abs(a))]) for a in offsets])
            displacements |= part.displacements(
                self._model, m, change, label, sizes, label in slopes
            )
            _displace(change, displacements, label, amplitudes)
        return displacements


def _displace(
    change: LawChange, displacements: Displacements, label: str, amplitudes: Mapping[str, Array]
) -> None:
    """Add the displacement of part ``label`` at its amplitude to ``change``."""
    a = amplitudes.get(label)
    if a is not None and np.any(a):
        d, rate = displacements[label]
        change.d, change.d_rate = change.d + d * a, change.d_rate + rate * a


def _add(change: LawChange, f: Function, m: MeshMotion, now: Law, a: Array) -> None:
    """Add a function at amplitudes ``a`` (n_mesh,), evaluated at ``now``, to ``change``."""
    if f.nonlinear is not None:
        value, rate = f.nonlinear(m, a)
        setattr(change, f.slot, getattr(change, f.slot) + value)
        if f.slot == "d":
            change.d_rate = change.d_rate + rate
        return
    g = f.values(m, now)
    g = g[:, None] if g.ndim == 1 else g
    setattr(change, f.slot, getattr(change, f.slot) + g * a)
    if f.slot == "d" and f.rate is not None:
        rate = f.rate(m, now)
        change.d_rate = change.d_rate + (rate[:, None] if rate.ndim == 1 else rate) * a
