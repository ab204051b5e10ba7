"""What a batch costs beside meshing: the same models by every runner, cold and warm, against a server of its own."""

import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import pandas as pd
import psutil
import typer

from drl_meshgen.batch import TABLE
from flows import run_command
from flows.chain import Detail
from flows.runners import RunnerKind
from flows.server import start

ROOT = Path(__file__).parents[1]
RUNNERS = [
    (kind, detail, workers)
    for kind, detail in (
        (RunnerKind.PROCESSES, Detail.STAGES),
        (RunnerKind.PROCESSES, Detail.MODELS),
        (RunnerKind.DASK, Detail.STAGES),
        (RunnerKind.WORKERS, Detail.STAGES),
        (RunnerKind.WORKERS, Detail.MODELS),
    )
    for workers in (1, 2)
]
"""Who meshes, what is a task run of its own, and how many workers there are."""
WORKER = {"PREFECT_WORKER_QUERY_SECONDS": "2"}
"""Environment of workers, as in compose.yaml."""
STEP = 30
"""Triangles that each model has more than the one before: enough for another surface."""


@dataclass(frozen=True)
class Timed:
    """One run of the batch."""

    runner: str
    detail: str
    """What was a task run of its own."""
    workers: int
    models: int
    kept: bool
    """Whether all models were done before."""
    seconds: float
    """Wall clock of the command, start and imports of its process included."""
    models_per_minute: float
    meshing: float
    """What the stages of all models took together (seconds); zero where all were kept."""
    overhead: float
    """What the workers had time for beside the stages, per model (seconds)."""
    stored: float
    """Size of the artifact store per model (MB)."""
    recorded: float
    """What the server's database grew by, per model (MB)."""
    server: float
    """What the server worked, per model (seconds of a core)."""
    failed: int
    same_rows: bool
    """Whether the table is that of the first run, but for `seconds`."""


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextmanager
def _process(command: Sequence[str], log: Path, environment: dict[str, str]) -> Iterator[None]:
    with log.open("wb") as out:
        process = subprocess.Popen(  # noqa: S603 - a fixed command
            [sys.executable, "-m", *command], cwd=ROOT, env=environment, stdout=out, stderr=out
        )
        try:
            yield
        finally:
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:  # a worker may never end by itself
                process.kill()
                process.wait()


@contextmanager
def _server(home: Path) -> Iterator[tuple[dict[str, str], psutil.Process]]:
    """Start a server with a database of its own; yield the environment of processes that shall use it, and it."""
    from prefect.settings import PREFECT_HOME, temporary_settings

    api = f"http://127.0.0.1:{_free_port()}/api"
    with temporary_settings({PREFECT_HOME: home}):
        server = start(api)
    if server is None:
        raise typer.BadParameter(f"somebody answers at {api} already")
    try:
        yield {**os.environ, **WORKER, "PREFECT_HOME": str(home), "PREFECT_API_URL": api}, psutil.Process(server.pid)
    finally:
        server.terminate()
        server.wait(60)


@contextmanager
def _pool(name: str, count: int, home: Path, environment: dict[str, str]) -> Iterator[None]:
    """Deploy the shards of batches as batch/`name` to a pool with so many workers, each with one run at a time."""
    deploy = (
        "from flows.batch import batch;"
        f"batch.from_source({str(ROOT)!r}, 'flows/batch.py:batch').deploy({name!r}, work_pool_name={name!r}, "
        "parameters={'runner': 'here'})"
    )
    create = [sys.executable, "-m", "prefect", "work-pool", "create", name, "--type", "process"]
    for command in (create, [sys.executable, "-c", deploy]):
        done = subprocess.run(  # noqa: S603 - fixed commands
            command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise typer.BadParameter(done.stdout + done.stderr)
    with ExitStack() as stack:
        for k in range(count):
            command = ["prefect", "worker", "start", "--pool", name, "--type", "process", "--limit", "1"]
            stack.enter_context(_process([*command, "--name", f"{name}-{k}"], home / f"{name}-{k}.log", environment))
        yield


def _run(models: Sequence[str], options: Sequence[str], environment: dict[str, str]) -> float:
    began = time.monotonic()
    done = subprocess.run(  # noqa: S603 - a fixed command
        [sys.executable, "-m", "flows.batch", *models, *options],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode not in {0, 4, 5}:
        raise typer.BadParameter(done.stderr)
    return time.monotonic() - began


def _megabytes(paths: Iterable[Path]) -> float:
    return sum(path.stat().st_size for path in paths if path.is_file()) / 1e6


def _database(home: Path) -> float:
    """Return the size of the server's database with its journals (MB)."""
    return _megabytes(home.glob("prefect.db*"))


def _busy(server: psutil.Process) -> float:
    """Return the time on a core that a server has used so far (seconds)."""
    used = [one.cpu_times() for one in (server, *server.children(recursive=True))]
    return sum(times.user + times.system for times in used)


def _timed(
    way: tuple[RunnerKind, Detail, int],
    seconds: float,
    table: pd.DataFrame,
    first: pd.DataFrame,
    *,
    spent: tuple[float, float, float],
    kept: bool,
) -> Timed:
    """Return the figures of a run, its table held to the first rows of the first run's.

    `spent` is, for all models, what store and database grew by (MB) and the server's time on a core (seconds).
    """
    runner, detail, workers = way
    meshing = 0.0 if kept else float(table["seconds"].sum())
    common = first.iloc[: len(table)].reset_index(drop=True)
    return Timed(
        runner.value,
        detail.value,
        workers,
        len(table),
        kept,
        seconds,
        60 * len(table) / seconds,
        meshing,
        (seconds * (1 if kept else workers) - meshing) / len(table),
        *(one / len(table) for one in spent),
        int((~table["status"].isin(["fine", "below gate"])).sum()),
        table.drop(columns="seconds").equals(common.drop(columns="seconds")),
    )


def _markdown(rows: Sequence[Timed]) -> str:
    head = (
        "| runner | task runs | workers | models | run | seconds | models/min | meshing, s | beside it, s per model |"
    )
    head += " store, MB per model | database, MB per model | server, s per model | failed | same rows |"
    lines = [head, "| --- | --- " + "| ---: " * 2 + "| --- " + "| ---: " * 8 + "| --- |"]
    for row in rows:
        cells = [row.runner, row.detail, row.workers, row.models, "all kept" if row.kept else "cold"]
        cells += [f"{row.seconds:.1f}"]
        cells += [f"{row.models_per_minute:.1f}", f"{row.meshing:.1f}", f"{row.overhead:.2f}"]
        cells += [f"{row.stored:.2f}", f"{row.recorded:.3f}", f"{row.server:.2f}", row.failed]
        lines.append("| " + " | ".join(map(str, [*cells, "yes" if row.same_rows else "**no**"])) + " |")
    return "\n".join(lines) + "\n"


def main(
    *,
    count: Annotated[int, typer.Option("--models", min=1, help="Models of a run by processes.")] = 200,
    others: Annotated[int | None, typer.Option(min=1, help="Models of other runs.  [default: the same]")] = None,
    triangles: Annotated[int, typer.Option(help=f"Size of the smallest model; each next one has {STEP} more.")] = 5000,
    target_quads: Annotated[int, typer.Option(min=4, help="Wanted number of quads.")] = 200,
    out: Annotated[Path, typer.Option(help="Folder of batch.csv and batch-table.md.")] = Path("out/bench-batch"),
) -> None:
    """Mesh hemispheres of different sizes with each runner in a fresh store, then again with all rows kept."""
    out.mkdir(parents=True, exist_ok=True)
    rows: list[Timed] = []
    first: pd.DataFrame | None = None
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        home = Path(folder) / "prefect"
        home.mkdir()
        environment, server = stack.enter_context(_server(home))
        for way in RUNNERS:
            runner, detail, workers = way
            number = count if runner is RunnerKind.PROCESSES else min(others or count, count)
            name = f"{runner.value}-{detail.value}-{workers}"
            place = Path(folder) / name
            manifest = Path(folder) / f"models-{number}.csv"
            sizes = [triangles + STEP * k for k in range(number)]
            pd.DataFrame({"model": "hemisphere", "triangles": sizes}).to_csv(manifest, index=False)
            options = ["--out", str(place), "--store", str(place / "store")]
            options += ["--target-quads", str(target_quads), "--no-pictures"]
            options += ["--runner", runner.value, "--detail", detail.value]
            with ExitStack() as helpers:
                if runner is RunnerKind.WORKERS:
                    helpers.enter_context(_pool(name, workers, home, environment))
                    options += ["--deployment", f"batch/{name}", "--shard-size", str(-(-number // (2 * workers)))]
                else:
                    options += ["--workers", str(workers)]
                for kept in (False, True):
                    before = _database(home), _busy(server)
                    seconds = _run([str(manifest)], options, environment)
                    table = pd.read_parquet(place / TABLE)
                    first = table if first is None else first
                    stored = _megabytes((place / "store").rglob("*"))
                    spent = stored, _database(home) - before[0], _busy(server) - before[1]
                    rows.append(_timed(way, seconds, table, first, spent=spent, kept=kept))
                    pd.DataFrame([asdict(row) for row in rows]).round(3).to_csv(out / "batch.csv", index=False)
                    (out / "batch-table.md").write_text(_markdown(rows), "utf-8")
                    typer.echo(f"{name} {'kept' if kept else 'cold'}: {seconds:.1f} s")


if __name__ == "__main__":
    run_command(main)
