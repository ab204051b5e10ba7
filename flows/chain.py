"""A chain of stage tasks for one surface: what every flow is made of."""

import time
import traceback
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from prefect import Task, get_run_logger
from prefect.utilities.timeout import timeout

from drl_meshgen.errors import FINE, INTERNAL, InputError, MeshgenError, disk_sentence
from drl_meshgen.store import ArtifactRef
from flows.pictures import place_picture
from tasks.stage import DELAY, RETRIES, machine_failed

TIMED_OUT = "TimedOut"
"""Name that Prefect gives the state of a task whose time was over."""


class Detail(Enum):
    """What is a task run of its own in the dashboard."""

    STAGES = "stages"
    """Every stage of every surface, as a task."""
    MODELS = "models"
    """Nothing below what calls `run_chain`: a server spends 30 ms on each task run, which thousands of models feel."""


class TimeOverError(TimeoutError):
    """The time of a surface is over."""


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
    *,
    limit: float | None = None,
    detail: Detail = Detail.STAGES,
) -> Outcome:
    """Run the tasks of all stages for one surface, in order, up to the first that fails. Needs a running flow.

    `tasks` and `options` map stage names to tasks and to options; `store` is the folder of the artifact store, `limit`
    how long all may take (seconds). Artifacts and outcome are the same whatever the `detail`.
    """
    refs: dict[str, str] = {}
    end = None if limit is None else time.monotonic() + limit
    run = _as_task if detail is Detail.STAGES else _as_function
    for name, task in tasks.items():
        seconds = None if end is None else max(end - time.monotonic(), 0.001)
        try:
            ended = run(task, seconds, surface, dict(refs), options[name], store)
        except TimeOverError:
            sentence = f"{surface}: stage {name} was not done when {limit:g} seconds were over"
            return Outcome(surface, _artifacts(refs), sentence, INTERNAL, trouble=Trouble.TOO_LONG)
        if isinstance(ended, BaseException):
            return _failed(surface, refs, name, ended)
        refs[name] = ended
    return Outcome(surface, _artifacts(refs))


def _as_task(task: Task[..., str], seconds: float | None, *given: object) -> str | BaseException:
    """Return what a task run returns or ends with; raises `TimeOverError` where it takes more than so many seconds."""
    own = copy(task)  # `with_options` would refuse its storage
    own.timeout_seconds = seconds
    state = own(*given, return_state=True)
    if state.name == TIMED_OUT:
        raise TimeOverError
    return state.result(raise_on_failure=False)


def _as_function(task: Task[..., str], seconds: float | None, *given: object) -> str | BaseException:
    """Do the same without a task run, with the same second tries where the machine failed."""
    left = RETRIES
    while True:
        try:
            with timeout(seconds, TimeOverError):
                return task.fn(*given)
        except TimeOverError:
            raise
        except Exception as error:  # noqa: BLE001 - the outcome tells of it
            if not (left and machine_failed(error)):
                return error
        left -= 1
        time.sleep(DELAY)


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
