"""The task factory: a Prefect task around a stage, cached by the artifact store."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from prefect import Task
from prefect.client.schemas.objects import State, TaskRun
from prefect.context import TaskRunContext

from drl_meshgen.errors import MeshgenError
from drl_meshgen.store import ArtifactRef, Recipe, Stage, Store, load, stored
from tasks.progress import shown
from tasks.storage import RecordStorage

Refs = Mapping[str, str]
"""Artifact references as JSON by stage name.

Text, because Prefect finds out what depends on what by the identity of results and of what is directly in them: a stage
name inside a mapping would tie every run of a stage to all others in the dashboard's graph.
"""


def _references(stage: Stage[Any, Any], refs: Refs) -> dict[str, ArtifactRef]:
    return {name: ArtifactRef.from_json(refs[name]) for name in stage.inputs}


RETRIES = 2
"""How often a task is tried again where the machine failed (count)."""
DELAY = 1.0
"""Time before that (seconds)."""


def machine_failed(error: object) -> bool:
    """Tell whether disk or network failed: a stage's own verdict would be the same again, and time is over once."""
    return isinstance(error, OSError) and not isinstance(error, TimeoutError)


def _retry(_task: Task[..., Any], _run: TaskRun, state: State[Any]) -> bool:
    return machine_failed(state.data)


def stored_task(
    run: Callable[..., str],
    recipe: Callable[[dict[str, Any]], Recipe],
    *,
    name: str,
    run_name: str,
    version: int,
    description: str | None = None,
) -> Task[..., str]:
    """Return a Prefect task that the artifact store caches: the one place that sets keys and retries.

    It has no tags: for the concurrency limit that a tag may have, Prefect asks the server before every run of a tagged
    task, cached or not, which at times took more than a second each.

    `run` returns an `ArtifactRef` as JSON and has a parameter `store`; `recipe` tells from the parameters what the
    result depends on.
    """

    def key(_context: TaskRunContext, parameters: dict[str, Any]) -> str | None:
        try:
            known = recipe(parameters)
        except MeshgenError:  # an unreadable input has no key; the task itself says so
            return None
        return str(Store(parameters["store"]).record_path(known.stage, known.key).absolute())

    task = Task(
        run,
        name=name,
        description=description,
        task_run_name=run_name,
        version=str(version),
        cache_key_fn=key,
        result_serializer="json",
        persist_result=True,
        retries=RETRIES,
        retry_delay_seconds=DELAY,
        retry_condition_fn=_retry,
    )
    task.result_storage = RecordStorage()  # the constructor takes only blocks registered with a server
    return task


def stage_task(name: str, stages: Sequence[Stage[Any, Any]]) -> Task[..., str]:
    """Return the Prefect task of the stage called `name`.

    It is called with `surface` (name of the model, for display), `refs` (what the tasks of its inputs returned),
    `options` (the stage's options) and `store` (folder of the artifact store), and returns an `ArtifactRef` as JSON.
    """
    by_name = {stage.name: stage for stage in stages}
    stage = by_name[name]

    def recipe(parameters: dict[str, Any]) -> Recipe:
        return stage.recipe(_references(stage, parameters["refs"]), parameters["options"])

    def run(surface: str, refs: Refs, options: Any, store: str) -> str:
        place, known = Store(store), _references(stage, refs)
        with shown(f"{name} {surface}"):
            return stored(stage, known, options, place, lambda name: load(by_name[name], known[name], place)).to_json()

    return stored_task(
        run, recipe, name=name, run_name=f"{name} {{surface}}", version=stage.version, description=stage.run.__doc__
    )
