"""The task factory: a Prefect task around a stage, cached by the artifact store."""

from collections.abc import Mapping, Sequence
from typing import Any

from prefect import Task
from prefect.client.schemas.objects import State, TaskRun
from prefect.context import TaskRunContext

from drl_meshgen.errors import MeshgenError
from drl_meshgen.store import ArtifactRef, Stage, Store, load, stored
from tasks.storage import RecordStorage

Refs = Mapping[str, str]
"""Artifact references as JSON by stage name.

Text, because Prefect finds out what depends on what by the identity of results and of what is directly in them: a stage
name inside a mapping would tie every run of a stage to all others in the dashboard's graph.
"""


def _references(stage: Stage[Any, Any], refs: Refs) -> dict[str, ArtifactRef]:
    return {name: ArtifactRef.from_json(refs[name]) for name in stage.inputs}


def _retry(_task: Task[..., Any], _run: TaskRun, state: State[Any]) -> bool:
    """Retry where the machine failed (disk, network); a stage's own verdict is the same every time."""
    return isinstance(state.data, OSError)


def stage_task(name: str, stages: Sequence[Stage[Any, Any]]) -> Task[..., str]:
    """Return the Prefect task of the stage called `name`.

    It is called with `surface` (name of the model, for display), `refs` (what the tasks of its inputs returned),
    `options` (the stage's options) and `store` (folder of the artifact store), and returns an `ArtifactRef` as JSON.
    """
    by_name = {stage.name: stage for stage in stages}
    stage = by_name[name]

    def key(_context: TaskRunContext, parameters: dict[str, Any]) -> str | None:
        try:
            recipe = stage.recipe(_references(stage, parameters["refs"]), parameters["options"])
        except MeshgenError:  # an unreadable input has no key; the task itself says so
            return None
        return str(Store(parameters["store"]).record_path(stage.name, recipe.key).absolute())

    def run(surface: str, refs: Refs, options: Any, store: str) -> str:  # noqa: ARG001 - names the task run
        place, known = Store(store), _references(stage, refs)
        return stored(stage, known, options, place, lambda name: load(by_name[name], known[name], place)).to_json()

    task = Task(
        run,
        name=name,
        description=stage.run.__doc__,
        task_run_name=f"{name} {{surface}}",
        tags={name},
        version=str(stage.version),
        cache_key_fn=key,
        result_serializer="json",
        persist_result=True,
        retries=2,
        retry_delay_seconds=1,
        retry_condition_fn=_retry,
    )
    task.result_storage = RecordStorage()  # the constructor takes only blocks registered with a server
    return task
