"""Flow `mesh`: block-structured quad meshes of one or many surfaces, cached, visible in the dashboard."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from prefect import State, flow, get_run_logger
from prefect.runtime import flow_run
from prefect.states import Completed, Failed

from drl_meshgen.commands.layout_file import steered
from drl_meshgen.commands.meshing import verdict
from drl_meshgen.commands.output import can_draw, folder_names
from drl_meshgen.commands.settings import chosen
from drl_meshgen.errors import MeshgenError
from drl_meshgen.pipeline import COMPARED_STAGES, STAGES, ModelOptions, coarsened
from drl_meshgen.quality import Quality, gate
from drl_meshgen.report import OURS, slug
from drl_meshgen.store import ArtifactRef, Execution, Store, reopen
from flows import dashboard
from flows.chain import BELOW_GATE, FINE, Outcome, exit_code, refused, run_chain
from flows.server import ServerError, connected
from tasks import (
    assembly,
    cleanup,
    comparison,
    decompose,
    lift,
    model,
    partition,
    quality,
    ricci,
    seams,
    sizing,
    smoothing,
    subdomain,
)
from tasks.report import report as report_task

TASKS = {
    "model": model.model,
    "cleanup": cleanup.cleanup,
    "seams": seams.seams,
    "ricci": ricci.ricci,
    "sizing": sizing.sizing,
    "partition": partition.partition,
    "decompose": decompose.decompose,
    "subdomain": subdomain.subdomain,
    "assembly": assembly.assembly,
    "lift": lift.lift,
    "smoothing": smoothing.smoothing,
    "quality": quality.quality,
    "comparison": comparison.comparison,
}


def _run_name() -> str:
    names = folder_names(flow_run.parameters["surfaces"])
    return "mesh " + (" ".join(names) if len(names) <= 4 else f"{names[0]} and {len(names) - 1} more")


def _row(outcome: Outcome, metrics: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row of the dashboard's table; JSON has no NaN."""
    figures = {name: round(value, 4) if math.isfinite(value) else None for name, value in metrics.items()}
    return {"surface": outcome.surface, "remark": outcome.failure, **figures}


def _judged(outcome: Outcome, quality: Quality) -> Outcome:
    """Return the outcome with the exit code and the sentence of a mesh below the quality gate, where it is."""
    missed = gate(quality)
    if not missed:
        return outcome
    sentence = f"{outcome.surface}: below the quality gate: {'; '.join(missed)}"
    return replace(outcome, failure=sentence, exit_code=BELOW_GATE)


def _meshed(outcome: Outcome) -> bool:
    return outcome.exit_code in (FINE, BELOW_GATE)


def _report(outcomes: Sequence[Outcome], store: Store) -> ArtifactRef | None:
    """Make the report of all meshed surfaces; None where there is none or the machine cannot draw."""
    refs = {o.surface: {stage: ref.to_json() for stage, ref in o.refs.items()} for o in outcomes if _meshed(o)}
    if not refs:
        return None
    if not can_draw():
        get_run_logger().warning("no report, because the library EGL is not installed (libegl1)")
        return None
    return ArtifactRef.from_json(report_task(refs, str(store.root)))


def _methods(done: Execution) -> dashboard.Methods:
    """Return the figures of our mesh and of the rivals, where any ran."""
    ours = {OURS: done["quality"].metrics}
    if "comparison" not in done.refs:
        return ours
    return ours | {str(row["method"]): row for row in done["comparison"].rows.to_dict("records")}


def _pictures(surface: str, methods: dashboard.Methods, folder: Path) -> dict[str, Path]:
    """Return the pictures of our blocks and of the first rival that has one, by caption."""
    ours, *rivals = methods
    place = folder / slug(surface)
    beside = {name: place / f"{slug(f'mesh {name}')}.png" for name in rivals}
    there = [(name, path) for name, path in beside.items() if path.exists()]
    return {ours: place / "blocks.png", **dict(there[:1])}


def _publish(outcomes: Sequence[Outcome], methods: Sequence[dashboard.Methods], pictures: Path | None) -> None:
    """Show every surface and the table of all in the dashboard; `pictures` has a folder per surface."""
    for outcome, known in zip(outcomes, methods, strict=True):
        shown = _pictures(outcome.surface, known, pictures) if known and pictures is not None else {}
        dashboard.show_surface(outcome, known, shown)
    dashboard.show_table([_row(o, known.get(OURS, {})) for o, known in zip(outcomes, methods, strict=True)])


@flow(name="mesh", flow_run_name=_run_name, description=__doc__)
def mesh(
    surfaces: list[str],
    *,
    target_quads: int | None = None,
    triangles: int = ModelOptions.triangles,
    seed: int | None = None,
    config: str | None = None,
    layout: str | None = None,
    store: str | None = None,
    report: str | None = None,
    compare: bool = True,
) -> State[list[Outcome]]:
    """Mesh surfaces (model names or files) one after another; a failed one does not stop the others.

    `target_quads` is the wanted number of quads, `triangles` the size of generated models, `seed` that of whatever is
    random, `config` a file of settings, `layout` one of an edited layout, `store` the folder of the artifact store,
    `report` the folder that gets the report; with `compare` other meshers run on the same surfaces. The state tells
    which surfaces failed; its data are the outcomes.
    """
    place = Store(store)
    options = chosen(None if config is None else Path(config), target_quads=target_quads, seed=seed)
    stages = COMPARED_STAGES if compare else STAGES
    tasks = {stage.name: TASKS[stage.name] for stage in stages}
    outcomes: list[Outcome] = []
    methods: list[dashboard.Methods] = []
    for source, name in zip(surfaces, folder_names(surfaces), strict=True):
        try:
            if layout is None:
                own = coarsened(options, source, triangles)
            else:
                own = steered(options, Path(layout), source, triangles)
        except MeshgenError as error:
            outcomes.append(refused(name, error))
            methods.append({})
            continue
        given = own.by_stage(source, triangles, compare=compare)
        complete = {stage.name: given.get(stage.name, stage.options()) for stage in stages}
        outcome = run_chain(tasks, name, complete, str(place.root))
        known: dashboard.Methods = {}
        if _meshed(outcome):
            done = reopen(stages, outcome.refs, place)
            outcome, known = _judged(outcome, done["quality"]), _methods(done)
        outcomes.append(outcome)
        methods.append(known)
    made = _report(outcomes, place)
    if made is None:
        _publish(outcomes, methods, None)
    else:
        with place.folder(made) as folder:
            _publish(outcomes, methods, folder / "pictures")
        if report is not None:
            place.export(made, Path(report))
    failures = [outcome.failure for outcome in outcomes if not _meshed(outcome)]
    if failures:
        return Failed(message="; ".join(failures), data=outcomes)
    return Completed(data=outcomes)


def main(
    surfaces: Annotated[
        list[str], typer.Argument(help="Model names (hemisphere, giraffe, hand, random:SEED) or files.")
    ],
    *,
    target_quads: Annotated[int | None, typer.Option(min=4, help="Wanted number of quads.")] = None,
    triangles: Annotated[int, typer.Option(help="Size of generated models.")] = ModelOptions.triangles,
    seed: Annotated[int | None, typer.Option(help="Seed of whatever is random.")] = None,
    config: Annotated[Path | None, typer.Option(help="Options of all stages, one table each (TOML).")] = None,
    layout: Annotated[Path | None, typer.Option(help="Counts of an edited layout (TOML).")] = None,
    store: Annotated[
        Path | None, typer.Option(help="Artifact store (default: DRL_MESHGEN_STORE or artifacts).")
    ] = None,
    report: Annotated[Path, typer.Option(help="Folder that gets the report.")] = Path("reports/generated/mesh"),
    compare: Annotated[bool, typer.Option(help="Run other meshers on the same surfaces.")] = True,
) -> None:
    """Run the mesh flow against a Prefect server; a local one is started if need be."""
    try:
        with connected() as api:
            place = None if store is None else str(store)
            state = mesh(
                surfaces,
                target_quads=target_quads,
                triangles=triangles,
                seed=seed,
                config=None if config is None else str(config),
                layout=None if layout is None else str(layout),
                store=place,
                report=str(report),
                compare=compare,
                return_state=True,
            )
    except ServerError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(error.exit_code) from None
    outcomes = state.data.result
    for outcome in outcomes:
        if _meshed(outcome):
            done = reopen(COMPARED_STAGES, outcome.refs, Store(store))
            seconds = sum(timing.computed for timing in done.timings if timing.stage != "comparison")
            typer.echo(verdict(outcome.surface, done["quality"].metrics, seconds))
        if outcome.failure:
            typer.echo(outcome.failure, err=True)
    typer.echo(f"dashboard: {api.removesuffix('/api')}")
    if any(_meshed(outcome) for outcome in outcomes) and can_draw():
        typer.echo(f"report: {report / 'index.html'}")
    raise typer.Exit(exit_code(outcomes))


if __name__ == "__main__":
    typer.run(main)
