"""Flow `benchmark`: a fixed set of surfaces meshed again, in tables that are the same but for times, and what moved."""

import tempfile
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import pandas as pd
import typer
from prefect import State, flow
from prefect.artifacts import create_markdown_artifact, create_table_artifact
from prefect.exceptions import FailedRun
from prefect.runtime import flow_run
from prefect.states import Completed, Failed

from drl_meshgen.benchmarks.moved import Movement, moved
from drl_meshgen.benchmarks.runs import (
    earlier,
    moved_page,
    other_setting,
    run_folder,
    summary,
    surfaces_in,
    versions,
    write_run,
)
from drl_meshgen.commands.arguments import leave
from drl_meshgen.commands.output import folder_names
from drl_meshgen.commands.settings import chosen
from drl_meshgen.errors import FINE
from drl_meshgen.pipeline import STAGES, ModelOptions
from drl_meshgen.report import OURS
from drl_meshgen.store import Store
from drl_meshgen.store.canonical import canonical, digest
from flows import dashboard, run_command
from flows.server import connected
from flows.surface import Surfaced, mesh_surface
from tasks.progress import counted

SURFACES = ("hemisphere", "giraffe", "hand", "random:1", "random:2", "random:3")
"""What is meshed unless told otherwise; seeds and counts belong to the name and the parameters."""
OUT = "reports/generated/benchmark"
WORSE = 6
"""Exit code where something got worse and that was asked to matter."""


def _named(name: str | None) -> str:
    """Return the name of the run: the one given, else the moment it was due, so that names sort by time."""
    return name or f"{flow_run.scheduled_start_time:%Y-%m-%dT%H%M%S}"


def _run_name() -> str:
    return f"benchmark {_named(flow_run.parameters.get('name'))}"


@flow(name="benchmark", flow_run_name=_run_name, description=__doc__)
def benchmark(
    name: str | None = None,
    *,
    surfaces: list[str] | None = None,
    models: str | None = None,
    target_quads: int = 2000,
    triangles: int = ModelOptions.triangles,
    seed: int = 0,
    config: str | None = None,
    against: str | None = None,
    tolerance: float = 0.01,
    fail_on_worse: bool = False,
    fresh: bool = False,
    store: str | None = None,
    out: str = OUT,
) -> State[pd.DataFrame]:
    """Mesh the surfaces, write the tables to `out/name` and, where asked, hold them to those of an earlier run.

    `name` is by default the moment the run was due; `surfaces` are model names or files (default: `SURFACES`), and
    `models` a folder whose files are meshed as well; `target_quads`, `triangles`, `seed` and `config` are those of
    the flow `mesh`. `against` is the name of an earlier run, or `last`; figures may differ by `tolerance` (share).
    With `fail_on_worse` the run fails where something got worse. `fresh` computes everything anew, in a store that is
    thrown away; else `store` is the folder of the artifact store, and times are those of when an artifact was made.
    """
    called = _named(name)
    folder = run_folder(Path(out), called)
    former = None if against is None else earlier(Path(out), against, called)
    sources = [*(SURFACES if surfaces is None else surfaces), *(surfaces_in(Path(models)) if models else [])]
    options = chosen(None if config is None else Path(config), target_quads=target_quads, seed=seed)
    done: list[Surfaced] = []
    with ExitStack() as stack, counted("surfaces", "surfaces done", len(sources)) as advance:
        place = Store(stack.enter_context(tempfile.TemporaryDirectory()) if fresh else store)
        for source, one in zip(sources, folder_names(sources), strict=True):
            made = mesh_surface(source, one, options, place, triangles=triangles)
            # no page shall link to what is thrown away
            done.append(replace(made, outcome=replace(made.outcome, refs={})) if fresh else made)
            advance()
    quality = pd.DataFrame([_row(one) for one in done])
    movements = None if former is None else (former[0], moved(former[1], quality, tolerance))
    setting = {
        "target_quads": target_quads,
        "triangles": triangles,
        "seed": seed,
        "options": digest(canonical(options)),
        "versions": versions(STAGES),
    }
    write_run(folder, quality, _seconds(done), setting, movements)
    differing = "" if former is None else other_setting(Path(out) / former[0], setting)
    told = _publish(done, movements, differing)
    worse = movements is not None and Movement.WORSE.value in movements[1]["movement"].tolist()
    if fail_on_worse and worse:
        return Failed(message=told)
    return Completed(message=told, data=quality)


def _row(one: Surfaced) -> dict[str, str | float]:
    """Return a row of the quality table: surface, verdict, remark, all metrics."""
    shown = dashboard.Shown(one.outcome, one.methods)
    figures = {key: float(value) for key, value in one.methods.get(OURS, {}).items() if isinstance(value, float)}
    return {"surface": one.outcome.surface, "verdict": shown.verdict, "remark": one.outcome.failure} | figures


def _seconds(done: list[Surfaced]) -> pd.DataFrame:
    """Return a row per surface and stage: how long it took when it was computed."""
    rows = [
        {"surface": one.outcome.surface, "stage": timing.stage, "seconds": timing.computed}
        for one in done
        if one.done is not None
        for timing in one.done.timings
    ]
    return pd.DataFrame(rows, columns=["surface", "stage", "seconds"])


def _publish(done: list[Surfaced], movements: tuple[str, pd.DataFrame] | None, differing: str) -> str:
    """Show the run in the dashboard; `differing` says how the setting of the earlier run differs.

    Returns the outcome in words.
    """
    shown = [dashboard.Shown(one.outcome, one.methods) for one in done]
    failed = sum(one.verdict != "passed" for one in shown)
    told = f"{len(shown)} surfaces, {failed} did not pass"
    page = dashboard.page(_run_name(), shown)
    if movements is not None:
        told += f"; against {movements[0]}: {summary(movements[1])}" + (f" ({differing})" if differing else "")
        create_table_artifact(movements[1].to_dict("records"), key="benchmark-moved", description=told)
        page = f"{page}\n{moved_page(*movements)}"
    create_table_artifact([dashboard.row(one) for one in shown], key="benchmark-quality", description=told)
    create_markdown_artifact(page, key="benchmark", description=told)
    return told


def main(
    name: Annotated[str | None, typer.Argument(help="Name of the run (default: the moment it starts).")] = None,
    *,
    surfaces: Annotated[list[str] | None, typer.Option("--surface", help="Model name or file; repeat.")] = None,
    models: Annotated[Path | None, typer.Option(help="Folder whose surfaces are meshed as well.")] = None,
    target_quads: Annotated[int, typer.Option(min=4, help="Wanted number of quads.")] = 2000,
    triangles: Annotated[int, typer.Option(help="Size of generated models.")] = ModelOptions.triangles,
    seed: Annotated[int, typer.Option(help="Seed of whatever is random.")] = 0,
    config: Annotated[Path | None, typer.Option(help="Options of all stages, one table each (TOML).")] = None,
    against: Annotated[str | None, typer.Option(help="Earlier run to compare with, or 'last'.")] = None,
    tolerance: Annotated[float, typer.Option(min=0, help="What figures may differ by (share).")] = 0.01,
    fail_on_worse: Annotated[bool, typer.Option(help="Exit code 6 where something got worse.")] = False,
    fresh: Annotated[bool, typer.Option(help="Compute everything anew, in a store that is thrown away.")] = False,
    store: Annotated[Path | None, typer.Option(help="Artifact store.")] = None,
    out: Annotated[Path, typer.Option(help="Folder of all runs.")] = Path(OUT),
) -> None:
    """Run the benchmark flow against a Prefect server; a local one is started if need be."""

    def command() -> int:
        chosen(config, target_quads=target_quads, seed=seed)  # what is wrong with them is said before anything runs
        with connected() as api:
            state = benchmark(
                name,
                surfaces=surfaces or None,
                models=None if models is None else str(models),
                target_quads=target_quads,
                triangles=triangles,
                seed=seed,
                config=None if config is None else str(config),
                against=against,
                tolerance=tolerance,
                fail_on_worse=fail_on_worse,
                fresh=fresh,
                store=None if store is None else str(store),
                out=str(out),
                return_state=True,
            )
            result = state.result(raise_on_failure=False)
            if isinstance(result, BaseException) and not isinstance(result, FailedRun):  # which is ours
                raise result
        typer.echo(state.message)
        typer.echo(f"dashboard: {api.removesuffix('/api')}\ntables: {out}")
        return WORSE if state.is_failed() else FINE

    leave(command, debug=False)


if __name__ == "__main__":
    run_command(main)
