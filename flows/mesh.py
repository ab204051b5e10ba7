"""Flow `mesh`: block-structured quad meshes of one or many surfaces, cached, visible in the dashboard."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer
from prefect import State, flow
from prefect.runtime import flow_run
from prefect.states import Completed, Failed

from drl_meshgen.commands.output import can_draw, folder_names
from drl_meshgen.pipeline import STAGES, MeshOptions, ModelOptions
from drl_meshgen.quality import Quality, gate
from drl_meshgen.report import pictures
from drl_meshgen.report.view import best_view
from drl_meshgen.store import ArtifactRef, Store, reopen
from flows import dashboard
from flows.chain import BELOW_GATE, FINE, Outcome, exit_code, run_chain
from flows.server import ServerError, connected
from tasks import assembly, cleanup, decompose, lift, model, partition, quality, ricci, smoothing, subdomain
from tasks.report import report as report_task

TASKS = {
    "model": model.model,
    "cleanup": cleanup.cleanup,
    "ricci": ricci.ricci,
    "partition": partition.partition,
    "decompose": decompose.decompose,
    "subdomain": subdomain.subdomain,
    "assembly": assembly.assembly,
    "lift": lift.lift,
    "smoothing": smoothing.smoothing,
    "quality": quality.quality,
}


def _run_name() -> str:
    names = folder_names(flow_run.parameters["surfaces"])
    return "mesh " + (" ".join(names) if len(names) <= 4 else f"{names[0]} and {len(names) - 1} more")


def _row(outcome: Outcome, metrics: Mapping[str, float]) -> dict[str, Any]:
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


def _published(outcome: Outcome, store: Store) -> tuple[Outcome, dict[str, Any]]:
    """Show one surface in the dashboard; return its outcome, judged by the quality gate, and its row of the table."""
    if outcome.failure:
        dashboard.show_surface(outcome, {})
        return outcome, _row(outcome, {})
    done = reopen(STAGES, outcome.refs, store)
    metrics = done["quality"].metrics
    outcome = _judged(outcome, done["quality"])
    with TemporaryDirectory() as folder:
        picture = Path(folder, "blocks.png") if can_draw() else None
        if picture is not None:
            pictures.write_png(
                picture, pictures.draw_blocks(done["smoothing"].mesh, best_view(done["cleanup"].surface))
            )
        dashboard.show_surface(outcome, metrics, picture)
    return outcome, _row(outcome, metrics)


def write_report(meshed: Mapping[str, Mapping[str, ArtifactRef]], store: Store) -> ArtifactRef:
    """Make the report of all meshed surfaces. Needs a running flow."""
    texts = {name: {stage: ref.to_json() for stage, ref in refs.items()} for name, refs in meshed.items()}
    return ArtifactRef.from_json(report_task(texts, str(store.root)))


@flow(name="mesh", flow_run_name=_run_name, description=__doc__)
def mesh(
    surfaces: list[str],
    target_quads: int | None = None,
    triangles: int = ModelOptions.triangles,
    store: str | None = None,
    report: str | None = None,
) -> State[list[Outcome]]:
    """Mesh surfaces (model names or files) one after another; a failed one does not stop the others.

    `target_quads` is the wanted number of quads, `triangles` the size of generated models, `store` the folder of the
    artifact store, `report` the folder that gets the report. The state tells which surfaces failed; its data are the
    outcomes.
    """
    place = Store(store)
    options = MeshOptions().sized(target_quads)
    outcomes, rows = [], []
    for source, name in zip(surfaces, folder_names(surfaces), strict=True):
        given = options.by_stage(source, triangles)
        complete = {stage.name: given.get(stage.name, stage.options()) for stage in STAGES}
        outcome, row = _published(run_chain(TASKS, name, complete, str(place.root)), place)
        outcomes.append(outcome)
        rows.append(row)
    dashboard.show_table(rows)
    meshed = {outcome.surface: outcome.refs for outcome in outcomes if outcome.exit_code in (FINE, BELOW_GATE)}
    if report is not None and meshed:
        place.export(write_report(meshed, place), Path(report))
    failures = [outcome.failure for outcome in outcomes if outcome.exit_code not in (FINE, BELOW_GATE)]
    if failures:
        return Failed(message="; ".join(failures), data=outcomes)
    return Completed(data=outcomes)


def main(
    surfaces: Annotated[list[str], typer.Argument(help="Model names (hemisphere, giraffe, hand) or files.")],
    target_quads: Annotated[int | None, typer.Option(min=4, help="Wanted number of quads.")] = None,
    triangles: Annotated[int, typer.Option(help="Size of generated models.")] = ModelOptions.triangles,
    store: Annotated[
        Path | None, typer.Option(help="Artifact store (default: DRL_MESHGEN_STORE or artifacts).")
    ] = None,
    report: Annotated[Path, typer.Option(help="Folder that gets the report.")] = Path("reports/generated/mesh"),
) -> None:
    """Run the mesh flow against a Prefect server; a local one is started if need be."""
    try:
        with connected() as api:
            place = None if store is None else str(store)
            state = mesh(surfaces, target_quads, triangles, place, str(report), return_state=True)
    except ServerError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(error.exit_code) from None
    outcomes = state.data.result
    for outcome in outcomes:
        if outcome.failure:
            typer.echo(outcome.failure, err=True)
    typer.echo(f"dashboard: {api.removesuffix('/api')}")
    if any(outcome.exit_code in (FINE, BELOW_GATE) for outcome in outcomes):
        typer.echo(f"report: {report / 'index.html'}")
    raise typer.Exit(exit_code(outcomes))


if __name__ == "__main__":
    typer.run(main)
