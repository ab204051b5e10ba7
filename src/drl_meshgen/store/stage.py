"""A stage of the pipeline, and how a chain of stages is run in this process."""

import platform
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import wraps
from pathlib import Path
from typing import Any, Generic, TypeVar

from drl_meshgen.errors import InputError
from drl_meshgen.store.canonical import canonical, digest
from drl_meshgen.store.ref import ArtifactRef, Recipe
from drl_meshgen.store.source import function_source, installed_version, libraries, source_digest
from drl_meshgen.store.store import Store

O = TypeVar("O")
R = TypeVar("R")


def itself(options: object) -> object:
    """Return the options unchanged: the default `Stage.identity`."""
    return options


def no_parts(_result: object) -> dict[str, float]:
    """Return nothing: the default `Stage.parts`."""
    return {}


@dataclass(frozen=True)
class Stage(Generic[O, R]):
    """A pure function `(inputs, options) -> result` with everything needed to cache it.

    The same description drives the in-process run (`execute`), the store's key and the Prefect task.
    """

    name: str
    """Lower case word, unique in a pipeline; becomes the folder of its records."""
    version: int
    """Raised by hand where the result changes for a reason the source does not show."""
    modules: tuple[str, ...]
    """Modules and packages of drl_meshgen that `run`, `write` and `read` call; what they import follows."""
    inputs: tuple[str, ...]
    """Names of the stages whose results `run` receives."""
    options: type[O]
    """Frozen dataclass of options; must be constructible without arguments unless every run passes options."""
    run: Callable[[Mapping[str, Any], O], R]
    """`run(inputs, options)`; `inputs` maps each name of `inputs` to the result of that stage."""
    write: Callable[[R, Path], None]
    """Write the result as files into an empty folder; the same result must give the same bytes."""
    read: Callable[[Path], R]
    """Read back what `write` wrote; must return all data before it ends, the folder goes away."""
    identity: Callable[[O], object] = itself
    """What of the options the result depends on; a stage that reads a file puts its content's hash for its path."""
    parts: Callable[[R], Mapping[str, float]] = no_parts
    """Wall-clock seconds that a fresh result says its parts took, by name; what `write` leaves must not hold them."""

    def recipe(self, refs: Mapping[str, ArtifactRef], options: O) -> Recipe:
        """Return what the result depends on, given (at least) the artifacts of the stages in `inputs`.

        Raises `InputError` where a file that belongs to the identity cannot be read.
        """
        upstream = {name: refs[name] for name in self.inputs}
        try:
            identity = self.identity(options)
        except OSError as error:
            raise InputError(Path(error.filename or self.name).name, (error.strerror or str(error)).lower()) from error
        return Recipe.of(self.name, self.version, self.source, upstream, identity)

    @property
    def source(self) -> str:
        """Digest of the code: `modules` with what they import, and the text of the stage's own functions.

        So the module that lists the stages need not be among `modules` (it imports everything).
        """
        functions = [function_source(function) for function in (self.run, self.write, self.read)]
        return digest([source_digest(self.modules), *functions])

    def made(self, options: O) -> dict[str, object]:
        """Return what is recorded beside a result of this code now: versions, and the options as they were given.

        Nothing of it enters the key. Options differ from the identity in the key where a file stands for its content.
        """
        return {
            "code": installed_version("drl-meshgen"),
            "python": platform.python_version(),
            "platform": f"{sys.platform} {platform.machine()}",
            "libraries": libraries(self.modules),
            "options": canonical(options),
        }


@dataclass(frozen=True)
class Timing:
    """How long one stage took."""

    stage: str
    seconds: float
    """Wall-clock time spent on it in this run; for a cached stage the time to find and check the stored result."""
    computed: float
    """Wall-clock time of the computation itself, whenever it was made (with a store: including the writing)."""
    cached: bool
    """True where the result was found in the store."""
    parts: Mapping[str, float] = field(default_factory=dict)
    """Wall-clock seconds of named parts of the computation, where the stage tells of any (see `Stage.parts`)."""


@dataclass(frozen=True)
class Progress:
    """What the progress callback of `execute` is told: twice per stage, before and after."""

    stage: str
    index: int
    """Place of the stage in this run, from 0."""
    total: int
    timing: Timing | None
    """None where the stage is about to start."""


@dataclass(frozen=True)
class Execution:
    """Outcome of `execute`; `execution[stage]` is a result, read from the store on first use where it was cached."""

    refs: Mapping[str, ArtifactRef]
    """Stored artifact of each stage; empty for a run in memory."""
    timings: tuple[Timing, ...]
    """One per stage, in the order they ran."""
    _fetch: Callable[[str], Any] = field(repr=False)

    def __getitem__(self, stage: str) -> Any:
        """Return the result of a stage; raises KeyError where it was not part of the run."""
        return self._fetch(stage)


def ancestors(stages: Sequence[Stage[Any, Any]], targets: Sequence[str] | None = None) -> tuple[Stage[Any, Any], ...]:
    """Return the stages that the targets need (all where None), in an order in which inputs come first.

    Raises ValueError where a name occurs twice, a target is unknown or an input is not an earlier stage.
    """
    known: set[str] = set()
    for stage in stages:
        if stage.name in known:
            raise ValueError(f"stage {stage.name} is listed twice")
        if missing := [name for name in stage.inputs if name not in known]:
            raise ValueError(f"stage {stage.name} needs {', '.join(missing)}, which no earlier stage provides")
        known.add(stage.name)
    if targets is None:
        return tuple(stages)
    if missing := [name for name in targets if name not in known]:
        raise ValueError(f"no stage is called {', '.join(missing)}")
    needed = set(targets)
    for stage in reversed(stages):
        if stage.name in needed:
            needed.update(stage.inputs)
    return tuple(stage for stage in stages if stage.name in needed)


def memoised(stage: Stage[O, R]) -> Stage[O, R]:
    """Return a stage that remembers its last result in memory, and gives it for the same inputs and equal options."""
    last: list[tuple[dict[str, Any], O, R]] = []

    @wraps(stage.run)
    def run(inputs: Mapping[str, Any], options: O) -> R:
        if last and last[0][1] == options and all(last[0][0][name] is inputs[name] for name in stage.inputs):
            return last[0][2]
        result = stage.run(inputs, options)
        last[:] = [(dict(inputs), options, result)]
        return result

    return replace(stage, run=run)


def load(stage: Stage[Any, R], ref: ArtifactRef, store: Store) -> R:
    """Read a stage's result from the store; raises `DamagedArtifactError` where an object is missing or altered."""
    with store.folder(ref) as folder:
        return stage.read(folder)


def stored(
    stage: Stage[O, Any], refs: Mapping[str, ArtifactRef], options: O, store: Store, fetch: Callable[[str], Any]
) -> ArtifactRef:
    """Return the artifact of a stage, computed only where the store has no sound one: read, call, save.

    `refs` holds (at least) the artifacts of `stage.inputs`; `fetch` turns the name of an input into its result and is
    called only on a miss.
    """

    def compute(folder: Path) -> Mapping[str, float]:
        result = stage.run({name: fetch(name) for name in stage.inputs}, options)
        stage.write(result, folder)
        return stage.parts(result)

    return store.run(stage.recipe(refs, options), compute, stage.made(options))


def execute(
    stages: Sequence[Stage[Any, Any]],
    options: Mapping[str, Any] | None = None,
    *,
    targets: Sequence[str] | None = None,
    store: Store | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Execution:
    """Run a chain of stages in this process: in memory, or through a store that skips what it already has.

    `options` maps stage names to options objects; a stage left out gets its default options. `targets` are the stages
    whose results are wanted (default: all); only they and what they need is run. Errors of a stage pass through.
    """
    chosen, given = ancestors(stages, targets), dict(options or {})
    if unknown := sorted(set(given) - {stage.name for stage in stages}):
        raise ValueError(f"options for {', '.join(unknown)}, but no stage is called so")
    by_name = {stage.name: stage for stage in chosen}
    refs: dict[str, ArtifactRef] = {}
    results: dict[str, Any] = {}
    timings: list[Timing] = []

    def fetch(name: str) -> Any:
        if name not in results:
            if store is None or name not in refs:
                raise KeyError(f"stage {name} was not run")
            results[name] = load(by_name[name], refs[name], store)
        return results[name]

    for index, stage in enumerate(chosen):
        if progress is not None:
            progress(Progress(stage.name, index, len(chosen), None))
        start = time.perf_counter()
        own = given.get(stage.name)
        own = stage.options() if own is None else own
        if store is None:
            results[stage.name] = stage.run({name: fetch(name) for name in stage.inputs}, own)
            computed, parts = time.perf_counter() - start, stage.parts(results[stage.name])
        else:
            kept = replace(stage, run=_remembering(stage, results))
            refs[stage.name] = stored(kept, refs, own, store, fetch)
            computed, parts = store.seconds(refs[stage.name]), store.parts(refs[stage.name])
        seconds = time.perf_counter() - start
        timing = Timing(stage.name, seconds, computed, cached=stage.name not in results, parts=parts)
        timings.append(timing)
        if progress is not None:
            progress(Progress(stage.name, index, len(chosen), timing))
    return Execution(refs, tuple(timings), fetch)


def reopen(stages: Sequence[Stage[Any, Any]], refs: Mapping[str, ArtifactRef], store: Store) -> Execution:
    """Return an earlier run from its artifacts; results are read when they are asked for, timings are those of then."""
    by_name = {stage.name: stage for stage in stages}
    results: dict[str, Any] = {}

    def fetch(name: str) -> Any:
        if name not in results:
            results[name] = load(by_name[name], refs[name], store)
        return results[name]

    timings = (Timing(name, 0.0, store.seconds(ref), cached=True, parts=store.parts(ref)) for name, ref in refs.items())
    return Execution(refs, tuple(timings), fetch)


def _remembering(stage: Stage[Any, R], results: dict[str, Any]) -> Callable[[Mapping[str, Any], Any], R]:
    """Wrap a stage's function so that its result also stays in memory for the stages that follow."""

    @wraps(stage.run)
    def run(inputs: Mapping[str, Any], options: Any) -> R:
        result = stage.run(inputs, options)
        results[stage.name] = result
        return result

    return run
