"""What every flow that meshes does with one surface: the stages as tasks, and what came of them."""

from dataclasses import dataclass, field, replace
from pathlib import Path

from drl_meshgen.commands.layout_file import steered
from drl_meshgen.errors import BELOW_GATE, FINE, MeshgenError
from drl_meshgen.pipeline import COMPARED_STAGES, STAGES, MeshOptions, ModelOptions, coarsened
from drl_meshgen.quality import gate
from drl_meshgen.report import OURS
from drl_meshgen.report.places import worst_quads
from drl_meshgen.store import Execution, Store, reopen
from flows.chain import Detail, Outcome, refused, run_chain
from flows.dashboard import Methods
from flows.pictures import place_picture
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


@dataclass(frozen=True)
class Surfaced:
    """What came of one surface, and what is known of its mesh."""

    outcome: Outcome
    methods: Methods = field(default_factory=dict)
    """Figures of our mesh and of the rivals, where any ran; empty where there is no mesh."""
    done: Execution | None = None
    """Results of the stages, read from the store when they are asked for; None where there is no mesh."""
    options: MeshOptions | None = None
    """Options it was meshed with, limits of the layout turned into others; None where there are none."""


def meshed(outcome: Outcome) -> bool:
    """Tell whether there is a mesh, good enough or not."""
    return outcome.exit_code in (FINE, BELOW_GATE)


def mesh_surface(
    source: str,
    name: str,
    options: MeshOptions,
    store: Store,
    *,
    triangles: int = ModelOptions.triangles,
    layout: Path | None = None,
    compare: bool = False,
    limit: float | None = None,
    detail: Detail = Detail.STAGES,
) -> Surfaced:
    """Run all stages on a model name or file, as tasks or not (`detail`); needs a running flow.

    `name` is what the surface is called, `triangles` the size of a generated model, `layout` a file of an edited
    layout; with `compare` other meshers run too; `limit` is how long the stages may take together (seconds). What
    goes wrong is told by the outcome.
    """
    stages = COMPARED_STAGES if compare else STAGES
    try:
        given = coarsened(options, source, triangles) if layout is None else steered(options, layout, source, triangles)
    except MeshgenError as error:
        return Surfaced(refused(name, error))
    own = given.by_stage(source, triangles, compare=compare)
    complete = {stage.name: own.get(stage.name, stage.options()) for stage in stages}
    tasks = {stage.name: TASKS[stage.name] for stage in stages}
    outcome = run_chain(tasks, name, complete, str(store.root), limit=limit, detail=detail)
    if not meshed(outcome):
        return Surfaced(outcome, options=given)
    done = reopen(stages, outcome.refs, store)
    return Surfaced(_judged(outcome, done), _methods(done), done, given)


def _judged(outcome: Outcome, done: Execution) -> Outcome:
    """Return the outcome with exit code, sentence and worst quads of a mesh below the quality gate, where it is."""
    missed = gate(done["quality"])
    if not missed:
        return outcome
    sentence = f"{outcome.surface}: below the quality gate: {'; '.join(missed)}"
    picture = place_picture(worst_quads(done["smoothing"].mesh.mesh, done["quality"].shape))
    return replace(outcome, failure=sentence, exit_code=BELOW_GATE, picture=picture)


def _methods(done: Execution) -> Methods:
    """Return the figures of our mesh and of the rivals, where any ran."""
    ours = {OURS: done["quality"].metrics}
    if "comparison" not in done.refs:
        return ours
    return ours | {str(row["method"]): row for row in done["comparison"].rows.to_dict("records")}
