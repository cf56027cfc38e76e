"""Command-line options that several verbs share."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from herringbone_sim.errors import AnalysisError

NO_ROS = (
    "no ROS 2 here ({error}): source /opt/ros/jazzy/setup.bash, or "
    "pip install 'ros-jazzy-rclpy[fastrtps]' ros-jazzy-common-interfaces"
)


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
