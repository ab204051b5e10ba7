"""Who meshes the models of a batch: this process, other processes, a Dask cluster, or workers of a work pool."""

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from concurrent.futures.process import BrokenProcessPool
from enum import Enum
from typing import Any

from prefect import Task
from prefect.futures import PrefectFuture
from prefect.task_runners import ProcessPoolTaskRunner, TaskRunner

from drl_meshgen.errors import MeshgenError


class RunnerKind(Enum):
    """Where models are meshed."""

    HERE = "here"
    """One after another in the process of the flow."""
    PROCESSES = "processes"
    """In processes on this machine."""
    DASK = "dask"
    """In a Dask cluster."""
    WORKERS = "workers"
    """In shards, each a run of a deployment, by the workers of its work pool."""


class MissingRunnerError(MeshgenError):
    """The package of a runner is not installed."""

    exit_code = 2


Runner = Callable[[int], TaskRunner[Any]]
"""Gives a task runner for so many tasks at once, to be used as a context manager."""


def dask(address: str | None) -> Runner:
    """Return the runner of a Dask cluster: the one at an address, else one on this machine for the time being.

    Raises `MissingRunnerError` where the extra `scale` is not installed.
    """
    try:
        from prefect_dask import DaskTaskRunner
    except ImportError:
        raise MissingRunnerError("the runner dask needs the package prefect-dask (extra `scale`)") from None

    def runner(workers: int) -> TaskRunner[Any]:
        if address is not None:
            return DaskTaskRunner(address=address)
        own = {
            "n_workers": workers,
            "threads_per_worker": 1,
            "dashboard_address": None,
            "silence_logs": logging.ERROR,
            "scheduler_kwargs": {"allowed_failures": 0},  # the batch itself finds out who ended a worker
        }
        return DaskTaskRunner(cluster_kwargs=own)

    return runner


def processes(workers: int) -> TaskRunner[Any]:
    """Return the runner of so many processes."""
    return ProcessPoolTaskRunner(max_workers=workers)


def submitted(
    runner: TaskRunner[Any], task: Task[..., Any], calls: Iterable[Mapping[str, Any]], at_once: int
) -> Iterator[None]:
    """Run a task with each of these parameters, at most `at_once` waiting at a time; yield after each that ended.

    Ends early where the processes of the runner did; which calls were done is for the caller to find out.
    """
    waiting: list[PrefectFuture[Any]] = []
    pending = iter(calls)
    while True:
        for call in pending:
            waiting.append(runner.submit(task, parameters=dict(call)))
            if len(waiting) >= at_once:
                break
        if not waiting:
            return
        if not ended(waiting.pop(0)):
            return
        yield


def ended(future: PrefectFuture[Any]) -> bool:
    """Wait for a task; tell whether it ended by itself, not with the process that ran it."""
    try:
        future.wait()
    except (BrokenProcessPool, CancelledError):
        return False
    return True


def shards(names: Sequence[str], size: int) -> list[list[str]]:
    """Return the names in groups of about the same size, none larger than `size`."""
    count = -(-len(names) // size)
    return [list(names[k::count]) for k in range(count)]
