"""A Dask cluster as an executor, and submission of tasks to an executor a few at a time.

If the scheduler or its workers are missing, an error says so before any work begins.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any, TypeVar

from herringbone_sim.errors import AnalysisError

RETRIES = 10
CONNECT_S = 10
WORKERS_S = 60
AHEAD = 2  # tasks submitted per core: one is computed, one waits
_Task = TypeVar("_Task")
_Made = TypeVar("_Made")


@contextmanager
def cluster(address: str) -> Iterator[tuple[Executor, int]]:
    """Context with an executor on a Dask cluster and its number of cores.

    Tasks of a worker that is lost are repeated on another.

    Args:
        address: of the scheduler, such as ``tcp://HOST:8786``.

    Raises:
        AnalysisError: no scheduler answers there, it has no workers, or Dask is not installed.
    """
    try:
        from distributed import Client
    except ImportError:
        raise AnalysisError(
            'a scheduler needs Dask: type pip install "dask[distributed]"'
        ) from None
    _check(address)
    connect: Any = Client
    with connect(address, timeout=CONNECT_S, set_as_default=False) as client:
        try:
            client.wait_for_workers(1, timeout=WORKERS_S)
        except TimeoutError:
            raise AnalysisError(
                f"the Dask scheduler at {address} has no workers: start some with dask worker"
            ) from None
        cores = sum(client.nthreads().values())
        yield client.get_executor(pure=False, retries=RETRIES), cores


def _check(address: str) -> None:
    """Raise AnalysisError if no scheduler answers.

    Without this check a Client that finds none would block the exit of the process.
    """
    from distributed.comm.addressing import get_address_host_port

    try:
        get_address_host_port(address)
        with ThreadPoolExecutor(1) as thread:  # the caller may run in an event loop
            thread.submit(asyncio.run, _greet(address)).result()
    except (OSError, ValueError, OverflowError) as error:
        raise AnalysisError(
            f"no Dask scheduler answers at {address!r} ({_last_cause(error)}): give its address, "
            "such as tcp://HOST:8786"
        ) from None


async def _greet(address: str) -> None:
    """Open and close a Dask connection to an address; OSError if nothing there speaks Dask."""
    from distributed.core import connect
    from distributed.security import Security

    call: Any = connect
    security: Any = Security()
    calling = call(address, timeout=CONNECT_S, **security.get_connection_args("client"))
    try:
        comm = await asyncio.wait_for(calling, CONNECT_S + 1)
    except asyncio.TimeoutError:
        raise OSError("what listens there does not speak as Dask does") from None
    await comm.close()


def _last_cause(error: BaseException) -> BaseException:
    """The first exception of a chain of causes."""
    while error.__cause__ is not None:
        error = error.__cause__
    return error


def completed(
    submit: Callable[[_Task], Future[_Made]], waiting: deque[_Task], cores: int
) -> Iterator[tuple[_Task, _Made]]:
    """Yield each task with its result as it completes; at most two tasks per core are submitted.

    Args:
        submit: submits a task and returns its future.
        waiting: tasks in order, emptied; the caller may add tasks while this iterates.
        cores: number of cores of the executor.
    """
    running: dict[Future[_Made], _Task] = {}
    try:
        while waiting or running:
            while waiting and len(running) < AHEAD * cores:
                task = waiting.popleft()
                running[submit(task)] = task
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                yield running.pop(future), future.result()
    finally:
        for future in running:
            future.cancel()
