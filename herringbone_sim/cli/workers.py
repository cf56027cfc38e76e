"""``--workers N``: threads of a verb."""

from __future__ import annotations

import argparse

from herringbone_sim.errors import AnalysisError


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add ``--workers``; ``workers_from`` reads it."""
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="threads [2]")


def workers_from(args: argparse.Namespace) -> int:
    """Number of threads; AnalysisError when there are none."""
    if args.workers < 1:
        raise AnalysisError(f"--workers must be 1 or more, got {args.workers}")
    return int(args.workers)
