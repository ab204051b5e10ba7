"""Computes an artifact again from what is recorded of it, and compares bit by bit."""

import json
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drl_meshgen.errors import InputError
from drl_meshgen.store.canonical import canonical, file_digest
from drl_meshgen.store.catalogue import SHORT, Catalogue, upstream_stage
from drl_meshgen.store.record import Record
from drl_meshgen.store.ref import ArtifactRef, Recipe
from drl_meshgen.store.restore import restored
from drl_meshgen.store.stage import Stage, load
from drl_meshgen.store.store import Store


@dataclass(frozen=True)
class Reproduction:
    """What came of the second computation."""

    same: tuple[str, ...]
    """Outputs with the same bytes."""
    different: tuple[str, ...]
    """A sentence per output that differs, is missing or is new."""
    code_changed: bool
    """The code of the stage, or a library that it depends on, is not the one of the record."""


def reproduce(
    stages: Sequence[Stage[Any, Any]], catalogue: Catalogue, record: Record, store: Store, source: Path | None = None
) -> Reproduction:
    """Compute an artifact again in a temporary folder, from its recorded inputs and options.

    `source` is where the file that a first stage read lies now; None: where it lay then. Nothing in the store changes.
    Raises `InputError` where inputs are gone, where the file is another one, and where the record's stage or options
    are unknown to this version.
    """
    name = record.ref.key[:SHORT]
    by_name = {stage.name: stage for stage in stages}
    if record.ref.stage not in by_name:
        raise InputError(name, f"{record.ref.stage} is no stage of the pipeline", "run the flow that made it again")
    stage = by_name[record.ref.stage]
    options = _options(stage, record, source)
    refs = inputs_of(catalogue, record, store)
    present = stage.recipe(refs, options)
    if present.options != record.recipe.options:
        raise InputError(name, "the file it was made from has another content now", "name the former one with --input")
    inputs = {upstream: load(by_name[upstream], refs[upstream], store) for upstream in stage.inputs}
    return judged(record, present, store, lambda folder: stage.write(stage.run(inputs, options), folder))


def judged(record: Record, present: Recipe, store: Store, write: Callable[[Path], object]) -> Reproduction:
    """Let `write` write an artifact to a temporary folder and compare it with the record.

    `present` is the recipe that the artifact has now.
    """
    with tempfile.TemporaryDirectory() as place:
        write(Path(place))
        same, different = _compared(Path(place), record, store)
    changed = (present.source, present.version) != (record.recipe.source, record.recipe.version)
    return Reproduction(same, different, changed)


def _options(stage: Stage[Any, Any], record: Record, source: Path | None) -> Any:
    text = record.made.get("options", record.recipe.options)
    try:
        options = restored(stage.options, json.loads(text))
    except (ValueError, KeyError, TypeError):
        options = None
    if options is None or canonical(options) != text:
        raise InputError(record.ref.key[:SHORT], "its options are not recorded in a form this version reads")
    if source is None:
        return options
    if record.recipe.inputs:
        raise InputError(record.ref.key[:SHORT], "it was not made from a file", "leave out --input")
    return replace(options, source=str(source))


def inputs_of(catalogue: Catalogue, record: Record, store: Store) -> dict[str, ArtifactRef]:
    """Return a sound artifact for every input of a record; raises `InputError` where one is gone."""
    refs = {}
    for name, origins in catalogue.origins(record).items():
        sound = (store.find(one.ref.stage, one.ref.key) for one in origins)
        ref = next((ref for ref in sound if ref is not None), None)
        if ref is None:
            raise InputError(record.ref.key[:SHORT], f"its input {upstream_stage(name)} is not in the store any more")
        refs[name] = ref
    return refs


def _compared(folder: Path, record: Record, store: Store) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return which outputs of a record have the same bytes in a folder, and a sentence for each other one."""
    files = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if path.is_file()}
    same, different = [], []
    for name in sorted({*files, *record.ref.outputs}):
        if name not in files:
            different.append(f"{name} was not written")
        elif name not in record.ref.outputs:
            different.append(f"{name} is new")
        elif file_digest(files[name]) == record.ref.outputs[name]:
            same.append(name)
        else:
            different.append(f"{name} {_first_difference(files[name], record.ref.outputs[name], store)}")
    return tuple(same), tuple(different)


def _first_difference(file: Path, sha: str, store: Store) -> str:
    if not store.objects.intact(sha):
        return "differs from its digest; the stored file is damaged"
    former, present = store.objects.path(sha).read_bytes(), file.read_bytes()
    both = min(len(former), len(present))
    at = next((place for place in range(both) if former[place] != present[place]), both)
    return f"differs from byte {at} on, {len(former)} bytes then, {len(present)} now"
