"""Jobs in worker processes that live on from job to job: with a time limit each, and nothing lost when one dies.

Unix only, because the limit of memory is.
"""

import multiprocessing
import os
import resource
import signal
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Generic, TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")

THREAD_SETTINGS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@dataclass(frozen=True)
class PoolOptions:
    """How jobs are run."""

    workers: int = 0
    """Processes at the same time (count); 0: as many as the machine has cores."""
    timeout: float = 300.0
    """Time limit of one job, seconds; its process is ended then."""
    memory: float = 8.0
    """Limit of the data one process may hold, GiB."""
    jobs: int = 40
    """Jobs after which a process is replaced by a fresh one (count)."""


@dataclass(frozen=True, eq=False)
class Ended(Generic[Result]):
    """How one job ended."""

    index: int
    """Its place among the jobs."""
    result: Result | None
    """What the work returned; None where its process was ended or died."""
    cause: str
    """Why there is no result; empty where there is one."""
    timed_out: bool
    """Whether the time limit was the cause."""
    seconds: float
    """Wall time, without the start of the process."""


class _Worker(Generic[Job, Result]):
    """A process, the line to it, and the job it is at."""

    def __init__(self, work: Callable[[Job], Result], options: PoolOptions) -> None:
        context = multiprocessing.get_context("spawn")
        self.line, theirs = context.Pipe()
        limit = int(options.memory * 2**30)
        self.process: BaseProcess = context.Process(target=_serve, args=(theirs, work, limit), daemon=True)
        self.process.start()
        theirs.close()
        self.index, self.start, self.served = -1, 0.0, 0

    def give(self, index: int, job: Job) -> None:
        self.index, self.start, self.served = index, time.monotonic(), self.served + 1
        self.line.send(job)

    def collect(self) -> Ended[Result]:
        """Take the result; that of a process that died is its exit status or signal."""
        try:
            result, seconds = self.line.recv()
        except (EOFError, ConnectionResetError):
            self.process.join()
            code = self.process.exitcode or 0
            cause = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit status {code}"
            return Ended(self.index, None, cause, timed_out=False, seconds=time.monotonic() - self.start)
        return Ended(self.index, result, "", timed_out=False, seconds=seconds)

    def end(self) -> None:
        self.process.kill()
        self.process.join()
        self.process.close()
        self.line.close()


def _serve(line: Connection, work: Callable[[Job], object], limit: int) -> None:
    """Do jobs until told to end; runs in the process."""
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends its processes itself
    while True:
        try:
            job = line.recv()
        except EOFError:  # nobody is left to work for
            return
        start = time.perf_counter()
        result = work(job)
        line.send((result, time.perf_counter() - start))


def run_jobs(
    work: Callable[[Job], Result], jobs: Sequence[Job], options: PoolOptions | None = None
) -> Iterator[Ended[Result]]:
    """Do `work(job)` for every job and yield how each ended, in the order in which they end.

    `work` is a function of a module (or a partial of one), as processes are started afresh; it is imported once per
    process. What it raises ends its process and is the cause. Jobs start in the given order.
    """
    options = options or PoolOptions()
    for name in THREAD_SETTINGS:
        os.environ.setdefault(name, "1")
    waiting = deque(enumerate(jobs))
    busy: list[_Worker[Job, Result]] = []
    idle: list[_Worker[Job, Result]] = []
    try:
        while waiting or busy:
            while waiting and len(busy) < (options.workers or os.cpu_count() or 1):
                worker = idle.pop() if idle else _Worker(work, options)
                worker.give(*waiting.popleft())
                busy.append(worker)
            deadline = min(worker.start for worker in busy) + options.timeout
            ready = wait([worker.line for worker in busy], max(0.0, deadline - time.monotonic()))
            for worker in list(busy):
                late = time.monotonic() - worker.start >= options.timeout
                if worker.line not in ready and not late:
                    continue
                busy.remove(worker)
                if worker.line in ready:
                    ended = worker.collect()
                else:
                    cause = f"limit {options.timeout:g} s"
                    ended = Ended[Result](worker.index, None, cause, timed_out=True, seconds=options.timeout)
                if ended.cause or worker.served >= options.jobs:
                    worker.end()
                else:
                    idle.append(worker)
                yield ended
    finally:
        for worker in (*busy, *idle):
            worker.end()
