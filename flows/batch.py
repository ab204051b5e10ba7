"""Flow `batch`: many surfaces, in parallel; a bad one stops no other, and what was done is never done again."""

import multiprocessing
import os
import signal
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

import pandas as pd
import typer
from prefect import State, flow, get_run_logger, task
from prefect.cache_policies import NO_CACHE
from prefect.client.orchestration import get_client
from prefect.deployments import run_deployment
from prefect.exceptions import FailedRun, TerminationSignal
from prefect.runtime import flow_run
from prefect.states import Completed, Failed

from drl_meshgen.batch import TABLE, Job, Row, Rows, Status, Watch, collect, keys_of
from drl_meshgen.commands.arguments import leave
from drl_meshgen.commands.output import can_draw, complete, write_layout_file, write_pictures, write_results
from drl_meshgen.commands.settings import chosen
from drl_meshgen.errors import BELOW_GATE, FINE, INTERNAL, InputError, disk_sentence, overall
from drl_meshgen.models import is_generated
from drl_meshgen.pipeline import MeshOptions, ModelOptions
from drl_meshgen.report import OURS
from drl_meshgen.store import ArtifactRef, Store
from flows import dashboard, run_command
from flows.chain import Detail, Outcome, Trouble
from flows.runners import Runner, RunnerKind, dask, processes, shards, submitted
from flows.server import connected
from flows.surface import Surfaced, mesh_surface
from tasks.progress import counted

SHARD = 100
"""Models per shard (count)."""
MANY = 500
"""Models that are to be meshed; of more the dashboard shows each as one task run unless told otherwise."""
STATUS = {FINE: Status.FINE, InputError.exit_code: Status.REFUSED, BELOW_GATE: Status.BELOW_GATE}
"""Status by exit code; any other that is no trouble is a stage without a result."""
LOOK = 2.0
"""Seconds between two looks at shards that workers run."""
ROUNDS = 2
"""Rounds of shards without any sign of work after which a batch gives up."""
DEPLOYMENT = "batch/shard"
"""Deployment of this flow whose runs mesh shards, as `prefect.yaml` has it."""
SENTENCES = 20
"""Most sentences on what failed that are printed; the table has all."""


@dataclass(frozen=True)
class Work:
    """What is done with every model of a batch."""

    out: str
    """Folder of the batch."""
    store: str
    """Folder of the artifact store."""
    compare: bool = False
    """Run other meshers on the same surfaces."""
    meshes: bool = True
    """Write a folder with the mesh of each model."""
    pictures: bool = True
    """Draw it, too."""
    limit: float | None = None
    """How long the stages of one model may take together (seconds)."""
    detail: Detail = Detail.STAGES
    """What is a task run of its own."""


def _status(outcome: Outcome) -> Status:
    if outcome.trouble is not None:
        return Status.TOO_LONG if outcome.trouble is Trouble.TOO_LONG else Status.INTERNAL
    return STATUS.get(outcome.exit_code, Status.FAILED)


def _row(key: str, surfaced: Surfaced, store: Store) -> Row:
    outcome = surfaced.outcome
    return Row(
        key,
        _status(outcome),
        outcome.exit_code,
        outcome.failure,
        sum(store.seconds(ref) for ref in outcome.refs.values()),
        {name: float(value) for name, value in surfaced.methods.get(OURS, {}).items()},
        {stage: ref.key for stage, ref in outcome.refs.items()},
        outcome.picture,
    )


def _meshed(job: Job, key: str, work: Work, store: Store) -> Row:
    """Run the stages of a model, write the folder of its mesh, and return its row."""
    surfaced = mesh_surface(
        job.source,
        job.name,
        job.options,
        store,
        triangles=job.triangles,
        compare=work.compare,
        limit=work.limit,
        detail=work.detail,
    )
    if work.meshes and surfaced.done is not None and surfaced.options is not None:
        with complete(Path(work.out) / "meshes" / job.name) as folder:
            write_results(folder, surfaced.done, surfaced.options)
            write_layout_file(folder, surfaced.done, job.source, job.triangles, surfaced.options)
            if work.pictures:
                write_pictures(folder, surfaced.done)
    return _row(key, surfaced, store)


@task(name="surface", task_run_name="mesh {job.name}", cache_policy=NO_CACHE)
def mesh_model(job: Job, key: str, work: Work) -> State[None]:
    """Mesh one model of a batch and write its row."""
    store = Store(work.store)
    rows = Rows(Path(work.out), store)
    rows.begin(job.name)
    try:
        row = _meshed(job, key, work, store)
    except OSError as error:  # a disk that is full or read-only: no fault of the code
        row = Row(key, Status.INTERNAL, INTERNAL, f"{job.name}: {disk_sentence(error)}")
    except Exception as error:  # noqa: BLE001 - a row tells of it, and the others shall have their turn
        get_run_logger().exception("not meshed")
        sentence = f"{job.name}: internal error: {type(error).__name__}: {error}"
        row = Row(key, Status.INTERNAL, INTERNAL, sentence)
    rows.write(job.name, row)
    if row.status in {Status.FINE, Status.BELOW_GATE}:
        return Completed(message=row.sentence or None)
    return Failed(message=row.sentence)


class Batch:
    """The models of a batch, and which of them are still to be meshed."""

    def __init__(self, jobs: Sequence[Job], work: Work) -> None:
        """Look up what was done before; raises nothing, as a surface that cannot be read is for its row to tell."""
        self.work = work
        self.rows = Rows(Path(work.out), Store(work.store))
        self.jobs = {job.name: job for job in jobs}
        self.keys = keys_of(jobs, compare=work.compare)
        self.fresh = [name for name in self.jobs if not self._kept(name)]
        """Names of those without a row of this batch; the others are kept."""
        self.pending = [name for name in self.fresh if not self.jobs[name].refusal]
        """Names of those that are to be meshed."""
        for name in self.fresh:
            if self.jobs[name].refusal:
                row = Row(self.keys[name], Status.REFUSED, InputError.exit_code, self.jobs[name].refusal)
                self.rows.write(name, row)

    def _kept(self, name: str) -> bool:
        row = self.rows.kept(self.jobs[name], self.keys[name])
        meshed = row is not None and row.status in {Status.FINE, Status.BELOW_GATE}
        there = not meshed or not self.work.meshes or (Path(self.work.out) / "meshes" / name / "mesh.vtu").is_file()
        return row is not None and there

    def call(self, name: str) -> dict[str, Any]:
        """Return the parameters of the task that meshes a model."""
        return {"job": self.jobs[name], "key": self.keys[name], "work": self.work}

    def lost(self, names: Sequence[str]) -> list[str]:
        """Return those that have no row of this batch."""
        rows = {name: self.rows.read(name) for name in names}
        return [name for name, row in rows.items() if row is None or row.key != self.keys[name]]

    def died(self, name: str) -> None:
        """Note that the process that meshed a model ended, with nothing else in it."""
        sentence = f"{name}: the process that meshed it ended without a word, as where memory is short"
        self.rows.write(name, Row(self.keys[name], Status.DIED, INTERNAL, sentence))


def _mesh_here(batch: Batch, names: Sequence[str]) -> Iterator[None]:
    for name in names:
        mesh_model(**batch.call(name), return_state=True)
        yield


@contextmanager
def _ended_at_once() -> Iterator[None]:
    """Kill the processes of a runner where this one is told to end: else it would wait for their models."""
    try:
        yield
    except (KeyboardInterrupt, TerminationSignal, GeneratorExit):
        for process in multiprocessing.active_children():
            process.kill()
        raise


def _mesh_by(runner: Runner, workers: int, batch: Batch, names: Sequence[str]) -> Iterator[None]:
    """Mesh models in other processes.

    Where one of these ends, all that it shared the runner with are lost; then those that were begun are meshed again,
    each by itself, and so it shows which one it was.
    """
    left = list(names)
    while left:
        with runner(min(workers, len(left))) as pool, _ended_at_once():
            yield from submitted(pool, mesh_model, (batch.call(name) for name in left), 4 * workers)
        left = batch.lost(left)
        suspects = [name for name in left if batch.rows.begun(name)] or left[:1]
        for name in suspects:
            with runner(1) as pool, _ended_at_once():
                yield from submitted(pool, mesh_model, [batch.call(name)], 1)
            if batch.lost([name]):
                batch.died(name)
                yield
        left = [name for name in left if name not in suspects]


def _mesh_in_shards(batch: Batch, names: Sequence[str], size: int, deployment: str, own: dict[str, Any]) -> None:
    """Mesh models by runs of a deployment, all at once, and again for those whose run ended without their rows.

    Models that were begun are suspects and get a run each, the others shards as before. A suspect whose own run ended
    without a row ended it; all that are left have no row where two rounds in a row brought none and no suspect.
    """
    left, idle = list(names), 0
    while left and idle < ROUNDS:
        suspects = [name for name in left if batch.rows.begun(name)]
        rest = [name for name in left if name not in set(suspects)]
        _run_shards([*([name] for name in suspects), *shards(rest, size)], deployment, own)
        lost = batch.lost(left)
        for name in set(lost) & set(suspects):
            batch.died(name)
        idle = idle + 1 if lost == left and not suspects and not any(map(batch.rows.begun, lost)) else 0
        left = [name for name in lost if name not in set(suspects)]
    for name in left:
        batch.died(name)


def _run_shards(groups: Sequence[Sequence[str]], deployment: str, own: dict[str, Any]) -> None:
    """Start a run of a deployment for each group of models, and wait for all of them."""
    runs = [
        run_deployment(
            deployment,
            parameters={**own, "names": list(group)},
            flow_run_name=f"shard {number} of {len(groups)}",
            timeout=0,
        )
        for number, group in enumerate(groups, 1)
    ]
    with get_client(sync_client=True) as client:
        for one in runs:
            while not (state := client.read_flow_run(one.id).state) or not state.is_final():
                time.sleep(LOOK)


def _run_name() -> str:
    parameters = flow_run.parameters
    names = parameters.get("names")
    given = [Path(model).name or model for model in (names or parameters["models"])]
    return "batch " + (" ".join(given) if len(given) <= 3 else f"{given[0]} and {len(given) - 1} more")


def _shown(name: str, row: Row, folder: Path) -> dashboard.Shown:
    refs = {stage: ArtifactRef(stage, key, {}) for stage, key in row.artifacts.items()}
    outcome = Outcome(name, refs, row.sentence, row.exit_code, picture=row.picture)
    drawn = [(caption, folder / f"{caption}.png") for caption in ("blocks", "quality")]
    there = [one for one in drawn if one[1].exists()]
    return dashboard.Shown(outcome, {OURS: row.metrics} if row.metrics else {}, there)


@flow(name="batch", flow_run_name=_run_name, description=__doc__)
def batch(
    models: list[str],
    out: str = "reports/generated/batch",
    *,
    target_quads: int | None = None,
    triangles: int = ModelOptions.triangles,
    seed: int | None = None,
    config: str | None = None,
    store: str | None = None,
    compare: bool = False,
    meshes: bool = True,
    pictures: bool = True,
    limit: float | None = None,
    runner: RunnerKind = RunnerKind.PROCESSES,
    workers: int | None = None,
    dask_address: str | None = None,
    shard_size: int = SHARD,
    deployment: str = DEPLOYMENT,
    detail: Detail | None = None,
    names: list[str] | None = None,
) -> State[None]:
    """Mesh all models of folders, patterns and manifests; what an earlier run of the batch did is kept.

    `models` are folders, patterns, manifests, files or model names (see `drl_meshgen.batch.collect`), `out` the folder
    of the batch: `batch.parquet` with a row per model, `meshes` with a folder per model, `rows` to go on from.
    `target_quads`, `triangles`, `seed` and `config` are as for `mesh`; rows of a manifest have the last word. `limit`
    is how long one model may take (seconds). `runner` says who meshes: `workers` processes or Dask workers (default:
    one per core), or the work pool of `deployment` in shards of `shard_size` models; `detail` says what
    is a task run of its own (default: every stage, of more than 500 models every model); `names` are those of the batch
    that are meshed (default: all). The table has the exit codes.
    """
    options = chosen(None if config is None else Path(config), target_quads=target_quads, seed=seed)
    place = Store(store)
    work = Work(out, str(place.root), compare, meshes, pictures and can_draw(), limit, detail or Detail.STAGES)
    jobs = collect(models, options, triangles)
    own = Batch(jobs if names is None else [job for job in jobs if job.name in set(names)], work)
    if detail is None and len(own.pending) > MANY:
        own.work = replace(own.work, detail=Detail.MODELS)
    count = workers or os.cpu_count() or 1
    get_run_logger().info("%d models, %d of them to be meshed", len(own.jobs), len(own.pending))
    try:
        with counted(f"batch {flow_run.name}", "models meshed", len(own.pending)) as advance:
            if runner is RunnerKind.WORKERS:
                given = {
                    "models": [model if is_generated(model) else str(Path(model).absolute()) for model in models],
                    "out": str(Path(out).absolute()),
                    "target_quads": target_quads,
                    "triangles": triangles,
                    "seed": seed,
                    "config": None if config is None else str(Path(config).absolute()),
                    "store": str(place.root.absolute()),
                    "compare": compare,
                    "meshes": meshes,
                    "pictures": pictures,
                    "limit": limit,
                    "detail": own.work.detail.value,
                }
                _mesh_in_shards(own, own.pending, shard_size, deployment, given)
            elif runner is RunnerKind.HERE:
                for _ in _mesh_here(own, own.pending):
                    advance()
            else:
                made = processes if runner is RunnerKind.PROCESSES else dask(dask_address)
                for _ in _mesh_by(made, count, own, own.pending):
                    advance()
    finally:  # the table has what was done, whatever ends this
        undone = set(own.lost(own.pending))
        own.rows.write_table([job for job in jobs if job.name not in undone])
    rows = {name: row for name in own.jobs if (row := own.rows.read(name)) is not None}
    shown = [_shown(name, row, Path(out) / "meshes" / name) for name, row in rows.items()]
    dashboard.show_run(str(flow_run.name), shown, folder=out, key="batch")
    bad = [name for name, row in rows.items() if row.status not in {Status.FINE, Status.BELOW_GATE}]
    if bad:
        return Failed(message=f"{len(bad)} of {len(rows)} models failed: {', '.join(bad[:5])}")
    return Completed()


def _once(models: list[str], given: Mapping[str, Any], names: Sequence[str] | None = None) -> list[int]:
    """Run the flow, tell what failed, and return the exit codes of all models."""
    state = batch(models, **given, names=None if names is None else list(names), return_state=True)
    ended = state.result(raise_on_failure=False)
    if isinstance(ended, BaseException) and not isinstance(ended, FailedRun):  # which is ours
        raise ended
    table = pd.read_parquet(Path(given["out"]) / TABLE)
    own = table if names is None else table[table["name"].isin(names)]
    for sentence in own["sentence"][own["sentence"] != ""].head(SENTENCES):
        typer.echo(sentence, err=True)
    counts = own["status"].value_counts(sort=False)
    typer.echo(f"{len(own)} models: {', '.join(f'{count} {status}' for status, count in counts.items())}")
    typer.echo(f"table: {Path(given['out']) / TABLE}")
    return own["exit_code"].tolist()


def _watch(models: list[str], given: Mapping[str, Any], options: MeshOptions, seconds: float) -> None:
    """Mesh what is new or changed, again and again, until somebody ends it."""
    typer.echo(f"watching {' '.join(models)} every {seconds:g} s; Ctrl-C ends it")
    watch = Watch()
    while True:
        try:
            jobs = collect(models, options, given["triangles"])
        except InputError:  # an empty folder may fill
            jobs = ()
        ready = set(watch.settled([job.source for job in jobs]))
        if ready:
            work = Work(given["out"], str(Store(given["store"]).root), given["compare"], given["meshes"])
            fresh = Batch([job for job in jobs if job.source in ready], work).fresh
            if fresh:
                _once(models, given, fresh)
        time.sleep(seconds)


def _ended(_signal: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def main(
    models: Annotated[
        list[str],
        typer.Argument(help="Folders, patterns, manifests (.parquet, .csv), files, or names of models."),
    ],
    *,
    out: Annotated[Path, typer.Option(help="Folder of the batch.")] = Path("reports/generated/batch"),
    target_quads: Annotated[int | None, typer.Option(min=4, help="Wanted number of quads.")] = None,
    triangles: Annotated[int, typer.Option(help="Size of generated models.")] = ModelOptions.triangles,
    seed: Annotated[int | None, typer.Option(help="Seed of whatever is random.")] = None,
    config: Annotated[Path | None, typer.Option(help="Options of all stages, one table each (TOML).")] = None,
    store: Annotated[
        Path | None, typer.Option(help="Artifact store (default: DRL_MESHGEN_STORE or artifacts).")
    ] = None,
    compare: Annotated[bool, typer.Option(help="Run other meshers on the same surfaces.")] = False,
    meshes: Annotated[bool, typer.Option(help="Write a folder with the mesh of each model.")] = True,
    pictures: Annotated[bool, typer.Option(help="Draw the meshes, too.")] = True,
    limit: Annotated[float | None, typer.Option(min=1, help="Most seconds for one model.")] = None,
    runner: Annotated[RunnerKind, typer.Option(help="Who meshes.")] = RunnerKind.PROCESSES,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes or Dask workers.  [default: one per core]")
    ] = None,
    dask_address: Annotated[str | None, typer.Option(help="Scheduler of a Dask cluster that is there.")] = None,
    shard_size: Annotated[int, typer.Option(min=1, help="Models per shard of the runner workers.")] = SHARD,
    deployment: Annotated[str, typer.Option(help="Deployment that meshes a shard.")] = DEPLOYMENT,
    detail: Annotated[
        Detail | None,
        typer.Option(help="What the dashboard shows as a task run.  [default: stages; models where more than 500]"),
    ] = None,
    watch: Annotated[
        float | None, typer.Option(min=0.5, help="Look for new and changed models every so many seconds.")
    ] = None,
) -> None:
    """Run the batch flow against a Prefect server; a local one is started if need be.

    Run again with the same folder it does what is missing, new, changed, or failed by accident.
    """
    given = {
        "out": str(out),
        "target_quads": target_quads,
        "triangles": triangles,
        "seed": seed,
        "config": None if config is None else str(config),
        "store": None if store is None else str(store),
        "compare": compare,
        "meshes": meshes,
        "pictures": pictures,
        "limit": limit,
        "runner": runner,
        "workers": workers,
        "dask_address": dask_address,
        "shard_size": shard_size,
        "deployment": deployment,
        "detail": detail,
    }

    def command() -> int:
        options = chosen(config, target_quads=target_quads, seed=seed)
        if runner is RunnerKind.DASK:
            dask(dask_address)
        if watch is None:
            collect(models, options, triangles)
        with connected() as api:
            typer.echo(f"dashboard: {api.removesuffix('/api')}")
            if watch is not None:
                _watch(models, given, options, watch)
            return overall(_once(models, given))

    signal.signal(signal.SIGTERM, _ended)
    try:
        leave(command, debug=False)
    except (KeyboardInterrupt, TerminationSignal):
        typer.echo("ended; the same command goes on from here", err=True)
        raise typer.Exit(130) from None


if __name__ == "__main__":
    from flows.batch import main as own  # under its own name, by which other processes import its tasks

    run_command(own)
