"""A chain of stage tasks for one surface: what every flow is made of."""

import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from prefect import Task, get_run_logger

from drl_meshgen.errors import InputError, MeshgenError
from drl_meshgen.store import ArtifactRef
from flows.pictures import place_picture

FINE, INTERNAL, BELOW_GATE, SOME_FAILED = 0, 1, 4, 5
"""Exit codes as the command line has them; errors carry their own."""


@dataclass(frozen=True)
class Outcome:
    """What became of one surface."""

    surface: str
    refs: Mapping[str, ArtifactRef] = field(default_factory=dict)
    """Artifacts of the stages that ended well."""
    failure: str = ""
    """One sentence on what went wrong; empty where the chain came to its end."""
    exit_code: int = FINE
    """What the command line returns for this surface alone."""
    picture: str = field(default="", repr=False, compare=False)
    """Where it went wrong, as a `data:` address; empty where that has no place or could not be drawn."""


def run_chain(tasks: Mapping[str, Task[..., Any]], surface: str, options: Mapping[str, Any], store: str) -> Outcome:
    """Run the tasks of all stages for one surface, in order, up to the first that fails. Needs a running flow.

    `tasks` and `options` map stage names to tasks and to options; `store` is the folder of the artifact store.
    """
    refs: dict[str, str] = {}
    for name, task in tasks.items():
        state = task(surface, dict(refs), options[name], store, return_state=True)
        if not state.is_completed():
            return _failed(surface, refs, name, state.result(raise_on_failure=False))
        refs[name] = state.result()
    return Outcome(surface, _artifacts(refs))


def refused(surface: str, error: MeshgenError, refs: Mapping[str, ArtifactRef] | None = None) -> Outcome:
    """Return the outcome of a surface that ended with an error made for the user."""
    sentence = str(error) if isinstance(error, InputError) else f"{surface}: {error}"
    return Outcome(surface, refs or {}, sentence, error.exit_code, place_picture(error.place))


def exit_code(outcomes: Sequence[Outcome]) -> int:
    """Return the exit code of a run: that of a single surface, `SOME_FAILED` where one of several failed."""
    codes = [outcome.exit_code for outcome in outcomes]
    if len(codes) > 1 and any(code not in (FINE, BELOW_GATE) for code in codes):
        return SOME_FAILED
    return max(codes)


def _artifacts(refs: Mapping[str, str]) -> dict[str, ArtifactRef]:
    return {name: ArtifactRef.from_json(ref) for name, ref in refs.items()}


def _failed(surface: str, refs: Mapping[str, str], stage: str, error: BaseException) -> Outcome:
    if isinstance(error, MeshgenError):
        return refused(surface, error, _artifacts(refs))
    get_run_logger().error("".join(traceback.format_exception(error)))
    sentence = f"{surface}: internal error in stage {stage}: {type(error).__name__}: {error}"
    return Outcome(surface, _artifacts(refs), sentence, INTERNAL)
