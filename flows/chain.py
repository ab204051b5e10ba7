"""A chain of stage tasks for one surface: what every flow is made of."""

import time
import traceback
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from prefect import Task, get_run_logger

from drl_meshgen.errors import FINE, INTERNAL, InputError, MeshgenError, disk_sentence
from drl_meshgen.store import ArtifactRef
from flows.pictures import place_picture

TIMED_OUT = "TimedOut"
"""Name that Prefect gives the state of a task whose time was over."""


class Trouble(Enum):
    """Why a surface got no verdict; another attempt may end otherwise."""

    INTERNAL = "internal error"
    TOO_LONG = "too long"


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
    trouble: Trouble | None = None
    """What kept the surface from a verdict of its own; None where it has one, also where that is a refusal."""


def run_chain(
    tasks: Mapping[str, Task[..., Any]],
    surface: str,
    options: Mapping[str, Any],
    store: str,
    limit: float | None = None,
) -> Outcome:
    """Run the tasks of all stages for one surface, in order, up to the first that fails. Needs a running flow.

    `tasks` and `options` map stage names to tasks and to options; `store` is the folder of the artifact store, `limit`
    how long all may take (seconds).
    """
    refs: dict[str, str] = {}
    end = None if limit is None else time.monotonic() + limit
    for name, task in tasks.items():
        own = task if end is None else _limited(task, end - time.monotonic())
        state = own(surface, dict(refs), options[name], store, return_state=True)
        if state.name == TIMED_OUT:
            sentence = f"{surface}: stage {name} was not done when {limit:g} seconds were over"
            return Outcome(surface, _artifacts(refs), sentence, INTERNAL, trouble=Trouble.TOO_LONG)
        if not state.is_completed():
            return _failed(surface, refs, name, state.result(raise_on_failure=False))
        refs[name] = state.result()
    return Outcome(surface, _artifacts(refs))


def _limited(task: Task[..., Any], seconds: float) -> Task[..., Any]:
    """Return a task that may take so long; `with_options` would refuse its storage."""
    own = copy(task)
    own.timeout_seconds = max(seconds, 0.001)
    return own


def refused(surface: str, error: MeshgenError, refs: Mapping[str, ArtifactRef] | None = None) -> Outcome:
    """Return the outcome of a surface that ended with an error made for the user."""
    sentence = str(error) if isinstance(error, InputError) else f"{surface}: {error}"
    return Outcome(surface, refs or {}, sentence, error.exit_code, place_picture(error.place))


def _artifacts(refs: Mapping[str, str]) -> dict[str, ArtifactRef]:
    return {name: ArtifactRef.from_json(ref) for name, ref in refs.items()}


def _failed(surface: str, refs: Mapping[str, str], stage: str, error: BaseException) -> Outcome:
    if isinstance(error, MeshgenError):
        return refused(surface, error, _artifacts(refs))
    if isinstance(error, OSError):  # a disk that is full or read-only: no fault of the code
        sentence = f"{surface}: stage {stage}: {disk_sentence(error)}"
        return Outcome(surface, _artifacts(refs), sentence, INTERNAL, trouble=Trouble.INTERNAL)
    get_run_logger().error("".join(traceback.format_exception(error)))
    sentence = f"{surface}: internal error in stage {stage}: {type(error).__name__}: {error}"
    return Outcome(surface, _artifacts(refs), sentence, INTERNAL, trouble=Trouble.INTERNAL)
