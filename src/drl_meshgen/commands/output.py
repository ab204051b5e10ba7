"""Folders of results: their names, their files, and that they appear whole or not at all."""

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pandas as pd

from drl_meshgen.commands.settings import to_toml
from drl_meshgen.export import write_block_mesh, write_surface_ply, write_table
from drl_meshgen.models import MODELS
from drl_meshgen.pipeline import MeshOptions
from drl_meshgen.store import Execution


def folder_names(sources: Sequence[str]) -> tuple[str, ...]:
    """Return a folder name per input: the model's name, or the file's name without its suffix.

    Where a name is taken by an earlier input (upper and lower case count as the same), `-2`, `-3` ... is appended.
    """
    names: list[str] = []
    taken: set[str] = set()
    for source in sources:
        stem = source if source in MODELS else Path(source).stem.strip(". ") or "surface"
        name, n = stem, 1
        while name.lower() in taken:
            n += 1
            name = f"{stem}-{n}"
        taken.add(name.lower())
        names.append(name)
    return tuple(names)


@contextmanager
def complete(folder: Path) -> Iterator[Path]:
    """Give an empty folder beside `folder` to write to; its files become those of `folder` at the end.

    On failure nothing is left behind. Files of other names that `folder` already has stay.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=".partial-", dir=folder.parent))
    try:
        yield part
        part.chmod(0o755)
        if not folder.exists():
            part.rename(folder)
            return
        for file in sorted(path for path in part.rglob("*") if path.is_file()):
            target = folder / file.relative_to(part)
            target.parent.mkdir(parents=True, exist_ok=True)
            file.replace(target)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def write_results(folder: Path, done: Execution, options: MeshOptions) -> None:
    """Write mesh, layout, tables, the cleaned surface, and the options that `--config` takes."""
    write_block_mesh(folder, done["smoothing"].mesh)
    write_surface_ply(folder / "surface.ply", done["cleanup"].surface)
    write_table(folder / "quality.parquet", pd.DataFrame([done["quality"].metrics]))
    (folder / "options.toml").write_text(to_toml(options), "utf-8")
