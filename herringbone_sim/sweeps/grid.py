"""Definition of a sweep: a gear, values of its parameters, and what is observed at each."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from herringbone_sim.core.integrate import State
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters, meaning, to_mapping
from herringbone_sim.effects.assemble import build_with
from herringbone_sim.effects.effect import Active
from herringbone_sim.effects.stepper import stepper
from herringbone_sim.effects.written import effects_text, read_effects
from herringbone_sim.errors import ParameterError, shown

STARTS = ("fixed", "up", "down", "ramp_up", "ramp_down")
KERNEL = {"order": 14, "steps_per_cycle": 8, "samples_per_cycle": 1}
CHUNK, SMALL_CHUNK = 256, 16  # values in a part, see ``default_chunk``
MOST_VALUES = 1_000_000  # values of an axis
UNSWEPT = ("n_planets", "order")  # equal for all values of one batch


@dataclass(frozen=True)
class Axis:
    """Axis of a sweep: increasing values of one parameter.

    Raises:
        ParameterError: no such numeric parameter, or values that do not increase.
    """

    name: str
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        default = getattr(Parameters, self.name, None) if meaning(self.name) else None
        if isinstance(default, (tuple, str)) or self.name in UNSWEPT:
            raise ParameterError(
                f"{self.name} makes no axis: sweep a number that leaves the size of the model as "
                "it is, such as delta_T, xi, K, Omega or T_1"
            )
        steps = np.diff(self.values)
        if not self.values or not np.isfinite(self.values).all() or (steps <= 0.0).any():
            raise ParameterError(
                f"the values of {self.name} must be finite and increase, got "
                f"{len(self.values)} from {self.values[:1]} to {self.values[-1:]}"
            )

    def __len__(self) -> int:
        return len(self.values)


@dataclass(frozen=True)
class Observation:
    """Length of the run at each value and the quantities computed from it.

    Attributes:
        transient: mesh cycles discarded first.
        cycles: mesh cycles that are averaged over; in a ramp, from one value to the next.
        points: section points, from the last cycles; a period must repeat 5 times in them.
        exponents: whether to compute Lyapunov exponents.
        mesh: name such as ``sp_L`` whose section displacements are stored, or "" for none.
    """

    transient: int = 300
    cycles: int = 100
    points: int = 100
    exponents: bool = True
    mesh: str = ""

    def __post_init__(self) -> None:
        if self.transient < 0 or not 1 <= self.points <= self.cycles:
            raise ParameterError(
                "a sweep needs transient >= 0 and 1 <= points <= cycles, got transient "
                f"{self.transient}, cycles {self.cycles}, points {self.points}"
            )


@dataclass(frozen=True)
class Sweep:
    """A grid of parameter values, flattened with the first axis slowest, cut into parts.

    Attributes:
        base: all parameters that are no axis.
        axes: one or more; a continuation goes along the first.
        observation: what is computed at each value.
        start: ``fixed``: every value starts from the initial state of the gear; ``up``, ``down``:
            from the final state of the next lower, next higher value on the first axis;
            ``ramp_up``, ``ramp_down``: one motion for each value of the other axes, with the
            parameter of the first axis changed every cycle.
        chunk: number of values in a part, which is computed and stored together; but for
            ``fixed``, rounded down to whole positions on the first axis, at least one.
        effects: of the gear, as YAML text (``effects.written``); empty for none.

    Raises:
        ParameterError: no axis, an axis twice, an unknown start, a chunk below 1, or a mesh or an
            effect that the gear does not have.
    """

    base: Parameters
    axes: tuple[Axis, ...]
    observation: Observation = field(default_factory=Observation)
    start: str = "fixed"
    chunk: int = CHUNK
    effects: str = ""

    def __post_init__(self) -> None:
        names, mesh = self.names, self.observation.mesh
        if not names or len(set(names)) < len(names):
            raise ParameterError(f"a sweep needs one or more different axes, got {names}")
        if self.start not in STARTS:
            raise ParameterError(f"start must be one of {', '.join(STARTS)}, got {self.start!r}")
        if self.chunk < 1:
            raise ParameterError(f"chunk must be 1 or more, got {self.chunk}")
        if mesh:
            self.base.layout.mesh_index(mesh)
        if self.effects:
            stepper(build(_with_room(self.base)), self.actives)

    @classmethod
    def of_gear(
        cls,
        base: Parameters,
        actives: Sequence[Active],
        axes: Sequence[Axis],
        observation: Observation,
        start: str = "fixed",
        chunk: int | None = None,
    ) -> Sweep:
        """Build the sweep of a gear with effects; without ``chunk`` parts take a few seconds.

        Raises:
            ParameterError: as ``Sweep``, or the gear lacks the place of an effect.
        """
        chunk = default_chunk(base, actives, start) if chunk is None else chunk
        return cls(base, tuple(axes), observation, start, chunk, effects_text(actives))

    @property
    def actives(self) -> tuple[Active, ...]:
        """Effects on the gear, without those of sensors, which change no motion."""
        return tuple(
            active for active in read_effects(self.effects) if active.effect.level != "sensor"
        )

    @property
    def n_state(self) -> int:
        """Length of the state vector, states added by effects included."""
        start: State = stepper(build(_with_room(self.base)), self.actives).start()
        return len(start.y)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(axis.name for axis in self.axes)

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(len(axis) for axis in self.axes)

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    @property
    def width(self) -> int:
        """Number of chains side by side: values at one position of the first axis."""
        return math.prod(self.shape[1:])

    @property
    def chained(self) -> bool:
        """Whether each value starts from the final state of the value before it."""
        return self.start != "fixed"

    @property
    def downwards(self) -> bool:
        """Whether chains run from the last value to the first."""
        return self.start.endswith("down")

    @property
    def ramped(self) -> bool:
        """Whether the parameter changes every mesh cycle."""
        return self.start.startswith("ramp")

    @property
    def n_parts(self) -> int:
        return -(-self.size // self._part_size)

    @property
    def _part_size(self) -> int:
        return max(self.chunk // self.width, 1) * self.width if self.chained else self.chunk

    def part(self, number: int) -> range:
        """Flat indices of the part with a number.

        In a chained sweep, a part has all values at each of its positions on the first axis.
        """
        first = number * self._part_size
        return range(first, min(first + self._part_size, self.size))

    def cut(self, indices: range) -> tuple[Sweep, int]:
        """Smallest sub-grid with the given flat indices, and the flat index of its first value."""
        axes, first, width = list(self.axes), 0, self.size
        for k, axis in enumerate(self.axes):
            width //= len(axis)
            low, high = ((index - first) // width for index in (indices[0], indices[-1]))
            axes[k] = Axis(axis.name, axis.values[low : high + 1])
            first += low * width
            if high > low:
                break
        return replace(self, axes=tuple(axes)), first

    def values_at(self, index: int) -> dict[str, float]:
        """Values of the axes at a flat index, by name."""
        place = np.unravel_index(index, self.shape)
        return {axis.name: axis.values[i] for axis, i in zip(self.axes, place, strict=True)}

    def parameters_at(self, index: int) -> Parameters:
        """Parameters at a flat index; ParameterError if no gear can have them."""
        return self.base.changed(self.values_at(index))

    def to_json(self) -> str:
        """JSON text from which ``grid_json.sweep_from_json`` restores an equal sweep."""
        return json.dumps(asdict(self) | {"base": to_mapping(self.base)}, indent=1)


def axis_from_text(text: str) -> Axis:
    """Read an axis from ``NAME=LOW:HIGH:COUNT`` (both ends included) or ``NAME=VALUE,VALUE,...``.

    Raises:
        ParameterError: a text of another form, or more than 1000000 values.
    """
    name, _, values = (part.strip() for part in text.partition("="))
    try:
        if ":" in values:
            low, high, count = values.split(":")
            if int(count) > MOST_VALUES:
                raise ParameterError(
                    f"an axis of {name} takes up to {MOST_VALUES} values, "
                    f"got {shown(int(count))}: ask for fewer"
                )
            spaced = np.linspace(float(low), float(high), int(count))
            return Axis(name, tuple(float(value) for value in spaced))
        return Axis(name, tuple(float(value) for value in values.split(",")))
    except ParameterError:
        raise
    except ValueError:
        raise ParameterError(
            f"an axis is NAME=LOW:HIGH:COUNT or NAME=VALUE,VALUE,..., got {shown(text)}: "
            "write it like K=0:0.6:400"
        ) from None


def default_chunk(base: Parameters, actives: Sequence[Active], start: str) -> int:
    """Number of values in a part of a sweep that takes a few seconds.

    ``SMALL_CHUNK`` in a continuation, and for a gear that is integrated by the laws of its
    effects. ParameterError if the gear lacks the place of an effect.
    """
    if start != "fixed":
        return SMALL_CHUNK
    by_laws = bool(actives) and build_with(_with_room(base), actives).integrator is not None
    return SMALL_CHUNK if by_laws else CHUNK


def _with_room(base: Parameters) -> Parameters:
    """The gear with backlash enough to be built: an axis may replace what leaves it none."""
    return base.changed({"delta_T": 0.0, "b": meaning("b").high})


def with_sweep_steps(base: Parameters, chosen: Mapping[str, Any]) -> Parameters:
    """Set the integration steps of a sweep: order 14, 8 steps and 1 sample a mesh cycle.

    With ``method: rk4`` the number of steps stays, as 8 would be too few, and there are as many
    samples, as it counts contact by them.

    Args:
        base: parameters to change.
        chosen: parameters that the user set; they are not changed.
    """
    steps = dict(KERNEL)
    if base.method == "rk4":
        own = base.steps_per_cycle if "steps_per_cycle" in chosen else base.steps
        every = own <= meaning("samples_per_cycle").high
        samples = own if every else base.samples_per_cycle
        steps |= {"steps_per_cycle": own, "samples_per_cycle": samples}
    return base.changed({name: value for name, value in steps.items() if name not in chosen})
