"""Types of options that several verbs share, and the progress bar."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import ArgumentCollection, Group, Parameter, Token
from cyclopts.validators import Number
from tqdm import tqdm

from herringbone_sim.errors import ParameterError
from herringbone_sim.views.mirror.target import MirrorTarget

NO_ROS = (
    "no ROS 2 here ({error}): source /opt/ros/jazzy/setup.bash, or "
    "pip install 'ros-jazzy-rclpy[fastrtps]' ros-jazzy-common-interfaces"
)
LETTERS = 48  # longest name of a step in the progress bar
FORMS = "spawn, connect[=HOST:PORT], serve[=[HOST:]PORT], save[=FILE.rrd]"
MODES = tuple(form.partition("[")[0] for form in FORMS.split(", "))

flattened = Parameter(name="*")  # decorates a dataclass whose fields are options


def limits(**limits: float) -> Parameter:
    """Annotation that restricts the number of an option, such as ``gte=0, lt=1``."""
    return Parameter(validator=Number(**limits))


def one_of(title: str, least: int = 1) -> Parameter:
    """Annotation that puts options into a group of which one, or with ``least`` 0 at most one, is
    given.

    Args:
        title: title of the group in the help.
    """

    def check(arguments: ArgumentCollection) -> None:
        names = [argument.name for argument in arguments]
        given = [argument.name for argument in arguments if argument.tokens]
        if not least <= len(given) <= 1:
            got = " and ".join(given) or "none"
            rule = "one of" if least else "at most one of"
            raise ValueError(f"{rule} {', '.join(names)} must be given, got {got}")

    return Parameter(group=Group(title, validator=check))


def _whole(_: Any, tokens: Sequence[Token]) -> int:
    try:
        return int(tokens[-1].value)
    except ValueError:
        raise ValueError("must be a whole number") from None


def names_of(text: str) -> tuple[str, ...]:
    """Split a comma-separated list into names, without empty ones."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _names(_: Any, tokens: Sequence[Token]) -> tuple[str, ...]:
    return names_of(tokens[-1].value)


def _numbers(_: Any, tokens: Sequence[Token]) -> tuple[float, ...]:
    try:
        numbers = tuple(float(number) for number in tokens[-1].value.split(","))
    except ValueError:
        numbers = ()
    if not numbers or not all(map(math.isfinite, numbers)):
        raise ValueError("must be finite numbers, separated by commas")
    return numbers


File = Annotated[Path, "FILE"]
Folder = Annotated[Path, "DIR"]
Count = Annotated[int, "N", Parameter(converter=_whole, validator=Number(gte=0))]
Cycles = Annotated[Count, "CYCLES"]
Low = Annotated[float, "LOW", Parameter(name="--from")]
High = Annotated[float, "HIGH", Parameter(name="--to")]
Names = Annotated[tuple[str, ...], "NAMES", Parameter(converter=_names, n_tokens=1)]
Numbers = Annotated[tuple[float, ...], Parameter(converter=_numbers, n_tokens=1)]

Out = Annotated[Folder, "folder to write to; made if new"]
Run = Annotated[Path, "RUN", "run folder, as runs/my_run, or a .mcap file"]
Mesh = Annotated[str | None, "NAME", "mesh that the figures show, as sp_L (default: the first)"]
Workers = Annotated[Count, limits(gte=1), "threads"]
Scheduler = Annotated[str | None, "ADDRESS", "Dask cluster to run on instead, as tcp://HOST:8786"]
Seeds = Annotated[
    str | None, "A:B", "a campaign per seed: ranges that exclude their end, or lists"
]
Starts = Annotated[Count, limits(gte=1), "random initial states"]
Discarded = Annotated[Count, "mesh cycles to discard first"]


@dataclass(frozen=True, kw_only=True)
class RandomStarts:
    """Options of random initial states; verbs set the defaults of ``starts`` and ``transient``."""

    starts: Starts
    reach: Annotated[
        float, "B", limits(gt=0, lt=1e3), "largest |x| in b_c and |v| in b_c omega_n"
    ] = 1.0
    transient: Discarded
    seed: Annotated[Count, "of the random initial states"] = 0


@flattened
@dataclass(frozen=True, slots=True, kw_only=True)
class Pool:
    """Options of what runs many tasks: processes, or a Dask cluster."""

    workers: Annotated[Count, limits(gte=1), "processes, which share the cores"] = 2
    scheduler: Scheduler = None


def mirror_target(text: str | None, file: Path) -> MirrorTarget | None:
    """Parse the value of ``--rerun``; None if there is none.

    Args:
        text: value of the option, such as ``connect=HOST:PORT``.
        file: file that ``save`` without a name writes.

    Raises:
        ParameterError: a text of another form.
    """
    if not text:
        return None
    mode, _, rest = text.partition("=")
    if mode not in MODES or (mode == "spawn" and rest):
        raise ParameterError(f"--rerun takes {FORMS}, got {text!r}")
    return MirrorTarget(
        mode, "" if mode == "save" else rest, Path(rest) if mode == "save" and rest else file
    )


@contextmanager
def progress(steps: int, unit: str = "step") -> Iterator[Callable[[str], None]]:
    """Context with a progress bar; yields a function to call with the name of each step begun."""
    with tqdm(total=steps, unit=unit, disable=None) as bar:

        def step(text: str) -> None:
            bar.set_description(text[:LETTERS])
            bar.total = max(bar.total or 0, bar.n + 1)
            bar.update()

        yield step
        bar.total = bar.n
