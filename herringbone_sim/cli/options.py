"""Command-line options, and the progress bar, that several verbs share."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tqdm import tqdm

from herringbone_sim.errors import AnalysisError, ParameterError
from herringbone_sim.views.mirror.target import MirrorTarget

NO_ROS = (
    "no ROS 2 here ({error}): source /opt/ros/jazzy/setup.bash, or "
    "pip install 'ros-jazzy-rclpy[fastrtps]' ros-jazzy-common-interfaces"
)
LETTERS = 48  # of a step in the progress bar
FORMS = "spawn, connect[=HOST:PORT], serve[=[HOST:]PORT], save[=FILE.rrd]"
MODES = tuple(form.partition("[")[0] for form in FORMS.split(", "))


def add_number(
    parser: argparse._ActionsContainer,
    option: str,
    default: float,
    text: str,
    metavar: str | None = "N",
) -> None:
    """Add an option that takes a number of the type of ``default``; the help shows the default."""
    parser.add_argument(
        option, type=type(default), default=default, metavar=metavar, help=f"{text} [%(default)s]"
    )


def add_file(
    parser: argparse._ActionsContainer, option: str, text: str, required: bool = False
) -> None:
    """Add an option that takes a file name; None if it is optional and not given."""
    parser.add_argument(option, type=Path, metavar="FILE", required=required, help=text)


def add_out(
    parser: argparse._ActionsContainer, text: str = "folder to write to; made if new"
) -> None:
    """Add the required option ``--out DIR``."""
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help=text)


def add_run(parser: argparse._ActionsContainer) -> None:
    """Add the positional argument ``run``: a recorded run."""
    parser.add_argument(
        "run", type=Path, metavar="RUN", help="run folder, as runs/my_run, or a .mcap file"
    )


def add_mesh(parser: argparse._ActionsContainer) -> None:
    """Add ``--mesh NAME``: the mesh that figures show, None for the first."""
    parser.add_argument(
        "--mesh", metavar="NAME", help="mesh that the figures show, as sp_L (default: the first)"
    )


def add_random_starts(parser: argparse._ActionsContainer, starts: int, transient: int) -> None:
    """Add ``--starts``, ``--reach``, ``--transient`` and ``--seed`` of random initial states."""
    add_number(parser, "--starts", starts, "random initial states")
    add_number(parser, "--reach", 1.0, "largest |x| in b_c and |v| in b_c omega_n", "B")
    add_number(parser, "--transient", transient, "mesh cycles to discard first")
    add_number(parser, "--seed", 0, "of the random initial states")


def add_seeds(parser: argparse._ActionsContainer) -> None:
    """Add ``--seeds A:B`` of practice campaigns."""
    text = "one campaign per seed: ranges that exclude their end, or lists"
    parser.add_argument("--seeds", metavar="A:B", help=text)


def add_workers(
    parser: argparse._ActionsContainer, default: int | None = 2, scheduler: bool = False
) -> None:
    """Add ``--workers``, where None means all cores, and on demand ``--scheduler``."""
    text = f"threads [{default}]" if default else "cores of this machine (default: all)"
    parser.add_argument("--workers", type=int, default=default, metavar="N", help=text)
    if scheduler:
        text = "run on this Dask cluster instead, as tcp://HOST:8786"
        parser.add_argument("--scheduler", metavar="ADDRESS", help=text)


def workers_from(args: argparse.Namespace) -> int:
    """Number of threads; AnalysisError if it is less than 1."""
    if args.workers is None:
        return os.cpu_count() or 1
    if args.workers < 1:
        raise AnalysisError(f"--workers must be 1 or more, got {args.workers}")
    return int(args.workers)


def add_rerun_option(parser: argparse.ArgumentParser, default: str, file: str) -> None:
    """Add ``--rerun [WHERE]``.

    Args:
        default: value of the option without an argument.
        file: name of the file that ``save`` writes, for the help.
    """
    parser.add_argument(
        "--rerun",
        nargs="?",
        const=default,
        default="",
        metavar="WHERE",
        help=f"mirror to the Rerun viewer: {FORMS} [{default}; save writes {file}]",
    )


def mirror_target(text: str, file: Path) -> MirrorTarget | None:
    """Target of the value of ``--rerun``; None if it is empty.

    Args:
        file: written by ``save`` without a name.

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
    """Progress bar on a terminal; yields a function that takes the name of each step."""
    with tqdm(total=steps, unit=unit, disable=None) as bar:

        def step(text: str) -> None:
            bar.set_description(text[:LETTERS])
            bar.total = max(bar.total or 0, bar.n + 1)
            bar.update()

        yield step
        bar.total = bar.n
