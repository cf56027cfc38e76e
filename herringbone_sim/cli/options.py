"""``--workers N``: threads of a verb."""

from __future__ import annotations

import argparse
import os

from herringbone_sim.errors import AnalysisError


def add_workers(parser: argparse.ArgumentParser, default: int | None = 2) -> None:
    """Add ``--workers``, None for all cores; ``workers_from`` reads it."""
    text = f"threads [{default}]" if default else "cores of this machine (default: all)"
    parser.add_argument("--workers", type=int, default=default, metavar="N", help=text)


def workers_from(args: argparse.Namespace) -> int:
    """Number of threads; AnalysisError when there are none."""
    if args.workers is None:
        return os.cpu_count() or 1
    if args.workers < 1:
        raise AnalysisError(f"--workers must be 1 or more, got {args.workers}")
    return int(args.workers)
