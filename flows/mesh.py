"""Flow `mesh`: block-structured quad meshes of one or many surfaces, cached, visible in the dashboard."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from prefect import State, flow
from prefect.runtime import flow_run
from prefect.states import Completed, Failed

from drl_meshgen.pipeline import STAGES, MeshOptions, ModelOptions
from drl_meshgen.store import Store, load
from flows import dashboard
from flows.chain import Outcome, exit_code, run_chain
from flows.server import ServerError, connected
from tasks import assembly, cleanup, decompose, lift, model, partition, quality, ricci, smoothing, subdomain

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
BY_NAME = {stage.name: stage for stage in STAGES}


def _run_name() -> str:
    names = [Path(source).name for source in flow_run.parameters["surfaces"]]
    return "mesh " + (" ".join(names) if len(names) <= 4 else f"{names[0]} and {len(names) - 1} more")


def _metrics(outcome: Outcome, store: Store) -> Mapping[str, float]:
    ref = outcome.refs.get("quality")
    return {} if ref is None else load(BY_NAME["quality"], ref, store).metrics


def _row(outcome: Outcome, metrics: Mapping[str, float]) -> dict[str, Any]:
    """Return a row of the dashboard's table; JSON has no NaN."""
    figures = {name: round(value, 4) if math.isfinite(value) else None for name, value in metrics.items()}
    return {"surface": outcome.surface, "failure": outcome.failure, **figures}


@flow(name="mesh", flow_run_name=_run_name, description=__doc__)
def mesh(
    surfaces: list[str],
    target_quads: int | None = None,
    triangles: int = ModelOptions.triangles,
    store: str | None = None,
) -> State[list[Outcome]]:
    """Mesh surfaces (model names or files) one after another; a failed one does not stop the others.

    `target_quads` is the wanted number of quads, `triangles` the size of generated models, `store` the folder of the
    artifact store. The state tells which surfaces failed; its data are the outcomes.
    """
    place = Store(store)
    options = MeshOptions().sized(target_quads)
    outcomes, rows = [], []
    for source in surfaces:
        given = options.by_stage(source, triangles)
        complete = {stage.name: given.get(stage.name, stage.options()) for stage in STAGES}
        outcome = run_chain(TASKS, Path(source).name, complete, str(place.root))
        metrics = _metrics(outcome, place)
        dashboard.show_surface(outcome, metrics)
        outcomes.append(outcome)
        rows.append(_row(outcome, metrics))
    dashboard.show_table(rows)
    failures = [outcome.failure for outcome in outcomes if outcome.failure]
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
) -> None:
    """Run the mesh flow against a Prefect server; a local one is started if need be."""
    try:
        with connected() as api:
            state = mesh(surfaces, target_quads, triangles, None if store is None else str(store), return_state=True)
            typer.echo(f"dashboard: {api.removesuffix('/api')}")
    except ServerError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(error.exit_code) from None
    outcomes = state.data.result
    for outcome in outcomes:
        if outcome.failure:
            typer.echo(outcome.failure, err=True)
    raise typer.Exit(exit_code(outcomes))


if __name__ == "__main__":
    typer.run(main)
