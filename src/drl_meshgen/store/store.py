"""The artifact store: computes what is missing or damaged, and only that."""

import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from drl_meshgen.errors import MeshgenError
from drl_meshgen.store.locks import exclusive, present, refused, shared
from drl_meshgen.store.objects import Objects, settle
from drl_meshgen.store.record import LARGEST_RECORD, Record, parsed
from drl_meshgen.store.ref import ArtifactRef, Recipe, checked_digest, checked_output, checked_stage

ENVIRONMENT = "DRL_MESHGEN_STORE"
DEFAULT = "artifacts"
USED_BY = "used-by-"
"""Start of the names of folders in `tmp` whose owner is a process, see `present`."""


class DamagedArtifactError(MeshgenError):
    """An artifact's object is missing or altered; running the stage again restores it."""

    def __init__(self, ref: ArtifactRef, output: str) -> None:
        self.ref, self.output = ref, output
        super().__init__(f"stored {output} of stage {ref.stage} is missing or damaged; run again to restore it")


class Store:
    """Records and objects below one folder.

    ```
    objects/ab/<sha256>          content of output files, read-only
    records/<stage>/<key>.json   which outputs a recipe gave
    locks/<key>                  one computation at a time per key
    locks/store, locks/user-*    nothing is removed while it is looked up, or that a living process has asked for
    tmp/                         unfinished work, never read
    ```

    A record and everything it names is checked whenever it is read: damage of any kind is a miss. The time of a
    record's file is when it was last asked for.
    """

    def __init__(self, root: str | Path | None = None) -> None:
        """Use the store in `root`; None takes the environment variable DRL_MESHGEN_STORE, else `artifacts`."""
        self.root = Path(root or os.environ.get(ENVIRONMENT) or DEFAULT)
        self.objects = Objects(self.root / "objects")

    def record_path(self, stage: str, key: str) -> Path:
        """Return the place of a record."""
        return self.root / "records" / checked_stage(stage) / f"{checked_digest(key)}.json"

    @property
    def guard(self) -> Path:
        """Lock file that is shared while artifacts are looked up or added, and held alone while any are removed."""
        return self.root / "locks" / "store"

    def record(self, stage: str, key: str) -> Record | None:
        """Return a record; None where it is absent, unreadable, altered, or not the record of this key."""
        path = self.record_path(stage, key)
        try:
            if not path.is_file() or path.stat().st_size > LARGEST_RECORD:  # opening a pipe would wait for ever
                return None
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        return parsed(stage, key, content)

    def look_up(self, stage: str, key: str) -> ArtifactRef | None:
        """Return the same as `find`, without a trace that anybody asked."""
        record = self.record(stage, key)
        if record is None:
            return None
        return record.ref if all(self.objects.intact(sha) for sha in record.ref.outputs.values()) else None

    def find(self, stage: str, key: str) -> ArtifactRef | None:
        """Return the artifact of a key, or None where it was never computed or record or objects are damaged.

        What it returns is not removed (`gc`) as long as this process lives.
        """
        if not self.root.is_dir():
            return None
        present(self.root / "locks")
        with shared(self.guard):
            ref = self.look_up(stage, key)
            if ref is not None:
                self._touch(ref)
        return ref

    def seconds(self, ref: ArtifactRef) -> float:
        """Return how long the computation of an artifact took when it was made; NaN where its record is gone."""
        record = self.record(ref.stage, ref.key)
        return float("nan") if record is None else record.seconds

    def parts(self, ref: ArtifactRef) -> dict[str, float]:
        """Return the seconds of the parts that `compute` told of; empty where it told of none or its record is gone."""
        record = self.record(ref.stage, ref.key)
        return {} if record is None else dict(record.parts)

    def run(
        self,
        recipe: Recipe,
        compute: Callable[[Path], Mapping[str, float] | None],
        made: Mapping[str, Any] | None = None,
    ) -> ArtifactRef:
        """Return the artifact of a recipe; `compute(folder)` writes its files where the store has no sound ones.

        What it returns are seconds that parts of it took, by name: kept beside the artifact, where time belongs.
        `made`, JSON data on the circumstances, is kept there too and changes no key.

        Whoever asks for the same key meanwhile, in this or another process, waits and gets the same artifact. If
        `compute` raises, nothing is kept. Raises ValueError where `compute` leaves no file or one with a name that
        cannot be stored.
        """
        found = self.find(recipe.stage, recipe.key)
        if found is not None:
            return found
        with exclusive(self.root / "locks" / recipe.key):
            found = self.find(recipe.stage, recipe.key)
            if found is not None:
                return found
            with self._workspace(recipe.key) as work:
                folder = work / "outputs"
                folder.mkdir()
                start = time.perf_counter()
                parts = compute(folder)
                seconds = time.perf_counter() - start
                files = self._files(recipe.stage, folder)
                with shared(self.guard):
                    outputs = {name: self.objects.put(files[name]) for name in files}
                    ref = ArtifactRef(recipe.stage, recipe.key, outputs)
                    record = Record(ref, recipe, seconds, dict(parts or {}), dict(made or {}))
                    self._keep(record, work / "record.json")
        return ref

    @contextmanager
    def folder(self, ref: ArtifactRef) -> Iterator[Path]:
        """Yield a temporary folder with the artifact's files under their names, each checked; it is removed afterwards.

        Raises `DamagedArtifactError` where a file is missing or altered.
        """
        with self.scratch() as place:
            for name, sha in ref.outputs.items():
                if not self.objects.give(sha, place / name):
                    raise DamagedArtifactError(ref, name)
            yield place

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """Yield an empty folder; it is removed afterwards, by `gc` where that fails.

        It lies in the store's file system, but elsewhere where the store can only be read.
        """
        user = present(self.root / "locks")
        where = None if user is None else self.root / "tmp"
        if where is not None:
            where.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f"{USED_BY}{user}-", dir=where) as place:
            yield Path(place)

    def export(self, ref: ArtifactRef, folder: Path) -> None:
        """Copy the artifact's files to `folder` under their names; each appears whole or not at all.

        Files of other names that are there stay. Raises `DamagedArtifactError` where a file is missing or altered.
        """
        with self.folder(ref) as source:
            for name in ref.outputs:
                target = folder / name
                target.parent.mkdir(parents=True, exist_ok=True)
                part = target.with_name(f".partial-{target.name}")
                shutil.copyfile(source / name, part)
                part.replace(target)

    def _keep(self, record: Record, draft: Path) -> None:
        draft.write_text(record.to_json())
        settle(draft, self.record_path(record.ref.stage, record.ref.key))

    def _touch(self, ref: ArtifactRef) -> None:
        try:
            os.utime(self.record_path(ref.stage, ref.key))
        except FileNotFoundError:  # removed by hand
            pass
        except OSError as error:
            if not refused(error):
                raise

    @contextmanager
    def _workspace(self, key: str) -> Iterator[Path]:
        """Yield an empty folder; what a killed predecessor left in it is removed. Needs the lock of the key."""
        work = self.root / "tmp" / key
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        try:
            yield work
        finally:
            shutil.rmtree(work, ignore_errors=True)

    @staticmethod
    def _files(stage: str, folder: Path) -> dict[str, Path]:
        files = {}
        for path in sorted(folder.rglob("*")):
            name = path.relative_to(folder).as_posix()
            if path.is_symlink() or not (path.is_file() or path.is_dir()):
                raise ValueError(f"stage {stage} left {name}, which is not a plain file")
            if path.is_file():
                files[checked_output(name)] = path
        if not files:
            raise ValueError(f"stage {stage} wrote no file")
        return files
