"""Flow `mesh`: block-structured quad meshes of one or many surfaces, cached, visible in the dashboard."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from prefect import State, flow, get_run_logger
from prefect.runtime import flow_run
from prefect.states import Completed, Failed

from drl_meshgen.commands.arguments import leave
from drl_meshgen.commands.meshing import verdict
from drl_meshgen.commands.output import can_draw, folder_names
from drl_meshgen.commands.settings import chosen
from drl_meshgen.errors import FINE, INTERNAL, MeshgenError, disk_sentence, overall
from drl_meshgen.pipeline import COMPARED_STAGES, ModelOptions
from drl_meshgen.report import OURS, slug
from drl_meshgen.store import ArtifactRef, Store, reopen
from flows import dashboard, run_command
from flows.chain import Outcome
from flows.server import connected
from flows.surface import Surfaced, mesh_surface, meshed
from tasks.progress import counted
from tasks.report import report as report_task


def _run_name() -> str:
    names = folder_names(flow_run.parameters["surfaces"])
    return "mesh " + (" ".join(names) if len(names) <= 4 else f"{names[0]} and {len(names) - 1} more")


def _report(outcomes: Sequence[Outcome], store: Store, folder: str | None) -> tuple[ArtifactRef | None, str]:
    """Make the report of all meshed surfaces and copy it to a folder.

    Returns it, None where there is no surface or the machine cannot draw, and in one sentence what went wrong.
    """
    refs = {o.surface: {stage: ref.to_json() for stage, ref in o.refs.items()} for o in outcomes if meshed(o)}
    if not refs:
        return None, ""
    if not can_draw():
        get_run_logger().warning("no report, because the library EGL is not installed (libegl1)")
        return None, ""
    try:
        made = ArtifactRef.from_json(report_task(refs, str(store.root)))
        if folder is not None:
            store.export(made, Path(folder))
    except OSError as error:  # the meshes are there
        return None, f"no report: {disk_sentence(error)}"
    except Exception as error:  # noqa: BLE001 - the same
        return None, f"no report: internal error: {type(error).__name__}: {error}"
    return made, ""


def pictures(surface: str, methods: dashboard.Methods, folder: Path) -> list[tuple[str, Path]]:
    """Return caption and file of our blocks, their quality, our mesh and that of the first rival that has one.

    `folder` holds the pictures of a report.
    """
    place = folder / slug(surface)
    rivals = [(name, place / f"{slug(f'mesh {name}')}.png") for name in methods if name != OURS]
    own = [("blocks", place / "blocks.png"), ("quality", place / "quality.png")]
    beside = [(OURS, place / f"{slug(f'mesh {OURS}')}.png"), *[one for one in rivals if one[1].exists()][:1]]
    return own + (beside if len(beside) > 1 else [])


def _publish(surfaces: Sequence[Surfaced], report: ArtifactRef | None, folder: str, store: Store) -> None:
    """Show the run in the dashboard, with pictures out of the report where there is one; `folder` has a copy of it."""
    title = _run_name()
    if report is None:
        dashboard.show_run(title, [dashboard.Shown(one.outcome, one.methods) for one in surfaces])
        return
    with store.folder(report) as place:
        drawn = place / "pictures"
        shown = [
            dashboard.Shown(
                one.outcome, one.methods, pictures(one.outcome.surface, one.methods, drawn) if one.methods else ()
            )
            for one in surfaces
        ]
        dashboard.show_run(title, shown, report, folder)


class RunFailedError(MeshgenError):
    """Some surfaces have no mesh, or the run no report: what Prefect, which wants errors for that, gets of it."""

    def __init__(self, told: str, outcomes: list[Outcome], report: str) -> None:
        """Keep the outcomes of all surfaces, and what kept the report from being made; empty where nothing did."""
        self.outcomes, self.report = outcomes, report
        super().__init__(told)


def outcomes_of(state: State[list[Outcome]]) -> list[Outcome]:
    """Return the outcomes of all surfaces from the state of a run; raises what ended the run itself."""
    ended = state.result(raise_on_failure=False)
    if isinstance(ended, RunFailedError):
        return ended.outcomes
    if isinstance(ended, BaseException):
        raise ended
    return ended


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
    what failed, and `outcomes_of` what came of all surfaces.
    """
    place = Store(store)
    options = chosen(None if config is None else Path(config), target_quads=target_quads, seed=seed)
    done = []
    with counted("surfaces", "surfaces done", len(surfaces)) as advance:
        for source, name in zip(surfaces, folder_names(surfaces), strict=True):
            given = None if layout is None else Path(layout)
            one = mesh_surface(source, name, options, place, triangles=triangles, layout=given, compare=compare)
            done.append(one)
            advance()
    outcomes = [one.outcome for one in done]
    made, lacking = _report(outcomes, place, report)
    _publish(done, made, report or "", place)
    failures = [*(outcome.failure for outcome in outcomes if not meshed(outcome)), *([lacking] if lacking else [])]
    if failures:
        told = "; ".join(failures)
        return Failed(message=told, data=RunFailedError(told, outcomes, lacking))
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

    def command() -> int:
        chosen(config, target_quads=target_quads, seed=seed)  # what is wrong with them is said before anything runs
        with connected() as api:
            state = mesh(
                surfaces,
                target_quads=target_quads,
                triangles=triangles,
                seed=seed,
                config=None if config is None else str(config),
                layout=None if layout is None else str(layout),
                store=None if store is None else str(store),
                report=str(report),
                compare=compare,
                return_state=True,
            )
        return _told(state, Store(store), api, report)

    leave(command, debug=False)


def _told(state: State[list[Outcome]], store: Store, api: str, report: Path) -> int:
    """Print what came of a run and return its exit code."""
    outcomes = outcomes_of(state)
    for outcome in outcomes:
        if meshed(outcome):
            done = reopen(COMPARED_STAGES, outcome.refs, store)
            seconds = sum(timing.computed for timing in done.timings if timing.stage != "comparison")
            typer.echo(verdict(outcome.surface, done["quality"].metrics, seconds))
        if outcome.failure:
            typer.echo(outcome.failure, err=True)
    ended = state.result(raise_on_failure=False)
    lacking = ended.report if isinstance(ended, RunFailedError) else ""
    if lacking:
        typer.echo(lacking, err=True)
    typer.echo(f"dashboard: {api.removesuffix('/api')}")
    if not lacking and any(meshed(outcome) for outcome in outcomes) and can_draw():
        typer.echo(f"report: {report / 'index.html'}")
    code = overall(outcome.exit_code for outcome in outcomes)
    return INTERNAL if lacking and code == FINE else code


if __name__ == "__main__":
    run_command(main)
