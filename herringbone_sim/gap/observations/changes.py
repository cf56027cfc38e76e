"""Changes of the force law: functions at amplitudes, and parts that move by themselves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from herringbone_sim.core.model import Model
from herringbone_sim.gap.observations.basis import Function
from herringbone_sim.gap.observations.law import Change, Displacements, Law, Motion, law

Array = NDArray[np.float64]

STAGES: tuple[Callable[[Function], bool], ...] = (
    lambda f: f.slot in ("d", "b_plus", "b_minus"),
    lambda f: f.slot in ("kappa", "mean_kappa", "gamma"),
    lambda f: f.slot == "more",
)


class Part(Protocol):
    """A part that moves by itself, driven by the meshes."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of its parameters."""

    def displacements(
        self, model: Model, m: Motion, change: Change, label: str, offsets: Array, slopes: bool
    ) -> Displacements:
        """What each of its functions stands for, by name.

        Args:
            m: between samples, at equal steps.
            change: of the law by all else.
            label: that the names of its functions begin with.
            offsets: of its parameters.
            slopes: whether those by its parameters are wanted.
        """


class Changes:
    """Functions of a gear's force law, and the parts among them.

    Args:
        functions: all of them.
        parts: by the label that the names of their functions begin with.
    """

    def __init__(
        self, model: Model, functions: Sequence[Function], parts: Mapping[str, Part]
    ) -> None:
        self._model = model
        self.functions = tuple(functions)
        self.parts = dict(parts)
        heads = tuple(f"{label} " for label in parts)
        self._others = [f for f in functions if not f"{f.name} ".startswith(heads)]
        self._last: dict[str, tuple[object, set[str], Displacements]] = {}

    def of(
        self,
        m: Motion,
        between: Motion | None,
        amplitudes: Mapping[str, Array],
        wanted: Sequence[str] | None = (),
    ) -> Change:
        """What functions at amplitudes (n_mesh,) do to the law of a run.

        Args:
            between: the same run between samples, where parts are integrated; None: they rest;
                ``m`` itself where its steps are fine enough.
            wanted: functions whose columns will be formed (None: all).
        """
        change = Change(displacements=self._displacements(m, between, amplitudes, wanted))
        for label in self.parts:
            _displace(change, change.displacements, label, amplitudes)
        self._add(change, m, amplitudes)
        return change

    def _add(self, change: Change, m: Motion, amplitudes: Mapping[str, Array]) -> None:
        """Add all functions but those of parts."""
        on = [f for f in self._others if np.any(amplitudes.get(f.name, 0.0))]
        # Displacements first: what depends on the load looks at the law that they leave.
        for stage in STAGES:
            chosen = [f for f in on if stage(f)]
            if chosen:
                now = law(m, change)
                for f in chosen:
                    _add(change, f, m, now, amplitudes[f.name])

    def _displacements(
        self,
        m: Motion,
        between: Motion | None,
        amplitudes: Mapping[str, Array],
        wanted: Sequence[str] | None,
    ) -> Displacements:
        """Those of parts that are there or wanted, at the samples of a motion."""
        asked = set(self.parts) if wanted is None else set(wanted) & set(self.parts)
        on = [x for x in self.parts if x in asked or np.any(amplitudes.get(x, 0.0))]
        if not on:
            return {}
        if between is None:
            rest = np.zeros_like(m.x)
            names = [n for x in on for n in (x, *(f"{x} {p}" for p in self.parts[x].names))]
            return dict.fromkeys(names, (rest, rest))
        if between is m:
            return self._integrated(m, amplitudes, on, asked)
        there = sorted((name, a.tobytes()) for name, a in amplitudes.items() if np.any(a))
        key = tuple(on), tuple(there)
        last = self._last.get(m.name)
        # The force law and the balance of a run are formed about the same amplitudes.
        if last is None or last[0] != key or not asked <= last[1]:
            last = key, asked, self._integrated(between, amplitudes, on, asked)
            self._last[m.name] = last
        step = between.times[1] - between.times[0]
        at = np.rint((m.times - between.times[0]) / step).astype(int)
        return {name: (d[at], rate[at]) for name, (d, rate) in last[2].items()}

    def _integrated(
        self, m: Motion, amplitudes: Mapping[str, Array], on: Sequence[str], slopes: set[str]
    ) -> Displacements:
        """Displacements of some parts one after the other, each with those before it."""
        found: dict[str, tuple[Array, Array]] = {}
        change = Change()
        self._add(change, m, amplitudes)
        for label in on:
            part = self.parts[label]
            offsets = [amplitudes.get(f"{label} {name}", np.zeros(1)) for name in part.names]
            sizes = np.array([float(a[np.argmax(np.abs(a))]) for a in offsets])
            found |= part.displacements(self._model, m, change, label, sizes, label in slopes)
            _displace(change, found, label, amplitudes)
        return found


def _displace(
    change: Change, displacements: Displacements, label: str, amplitudes: Mapping[str, Array]
) -> None:
    """Add the displacement of a part at its amplitude."""
    a = amplitudes.get(label)
    if a is not None and np.any(a):
        d, rate = displacements[label]
        change.d, change.d_rate = change.d + d * a, change.d_rate + rate * a


def _add(change: Change, f: Function, m: Motion, now: Law, a: Array) -> None:
    if f.bent is not None:
        value, rate = f.bent(m, a)
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
