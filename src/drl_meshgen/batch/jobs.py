"""The models of a batch: found in folders, by patterns, in manifests, or given by name."""

import glob
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from drl_meshgen.batch.manifest import SUFFIXES as MANIFESTS
from drl_meshgen.batch.manifest import read_manifest
from drl_meshgen.commands.output import folder_names
from drl_meshgen.errors import InputError
from drl_meshgen.models import is_generated
from drl_meshgen.models.reading import READABLE
from drl_meshgen.pipeline import MeshOptions, ModelOptions


@dataclass(frozen=True)
class Job:
    """One model of a batch."""

    name: str
    """Unique in the batch; folder of its mesh and file of its row."""
    label: str
    """What the row calls its source: relative to the folder or manifest it was found in, as given otherwise."""
    source: str
    """Name of a generated model or path of a file."""
    options: MeshOptions
    """Options of all stages."""
    triangles: int
    """Size of a generated model (count)."""
    refusal: str = ""
    """Sentence on what is wrong with its line of the manifest; such a job is not run."""


def collect(models: Sequence[str], options: MeshOptions, triangles: int = ModelOptions.triangles) -> tuple[Job, ...]:
    """Return the jobs that model names, files, folders, patterns and manifests stand for, in order.

    A folder stands for all files below it that can be read, hidden ones left out, sorted by path; a pattern (`*`, `?`,
    `**`) likewise for the files it matches; a manifest (`.parquet`, `.csv`) for its rows, whose cells change
    `options` and `triangles`. Names are those of files without their suffix, `-2`, `-3` ... appended where they
    coincide.

    Raises `InputError` for a folder or pattern without a surface, and for a manifest that cannot be used.
    """
    found = [job for model in models for job in _found(model, options, triangles)]
    names = folder_names([job.name for job in found])
    return tuple(replace(job, name=name) for job, name in zip(found, names, strict=True))


def _found(model: str, options: MeshOptions, triangles: int) -> Iterator[Job]:
    path = Path(model)
    if is_generated(model):
        yield Job(_stem(model), model, model, options, triangles)
    elif os.path.isdir(model):  # noqa: PTH112 - unlike Path's, no error where the name is too long
        yield from _files(model, path, path.rglob("*"), options, triangles)
    elif path.suffix.lower() in MANIFESTS:
        for entry in read_manifest(path, options, triangles):
            name = _plain(entry.name) or _stem(entry.model)
            yield Job(name, entry.model, entry.source, entry.options, entry.triangles, entry.refusal)
    elif glob.has_magic(model) and not os.path.lexists(model):
        matches = (Path(match) for match in glob.iglob(model, recursive=True))  # noqa: PTH207 - Path.glob has no roots
        yield from _files(model, Path(), matches, options, triangles)
    else:
        yield Job(_stem(model), model, model, options, triangles)


def _files(given: str, root: Path, paths: Iterable[Path], options: MeshOptions, triangles: int) -> Iterator[Job]:
    surfaces = sorted(
        path
        for path in paths
        if path.suffix.lower() in READABLE and path.is_file() and not _hidden(path.relative_to(root) if root else path)
    )
    if not surfaces:
        raise InputError(given, "holds no surface", f"surfaces are files that end in {' '.join(READABLE)}")
    for path in surfaces:
        label = path.relative_to(root).as_posix()
        yield Job(_stem(label), label, str(path), options, triangles)


def _hidden(path: Path) -> bool:
    return any(part.startswith(".") and part not in {".", ".."} for part in path.parts)


def _stem(source: str) -> str:
    return _plain(source if is_generated(source) else Path(source).stem) or "surface"


def _plain(name: str) -> str:
    """Return a name without characters that file systems, addresses or people stumble over, at most 80 long."""
    return "".join(c if c.isalnum() or c in "-_+" else "-" for c in name).strip("-")[:80]
