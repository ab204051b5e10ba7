"""The artifact store: computes what is missing or damaged, and only that."""

import fcntl
import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from drl_meshgen.errors import MeshgenError
from drl_meshgen.store.canonical import digest
from drl_meshgen.store.objects import Objects, settle
from drl_meshgen.store.ref import ArtifactRef, Recipe, checked_digest, checked_output, checked_stage

ENVIRONMENT = "DRL_MESHGEN_STORE"
DEFAULT = "artifacts"


class DamagedArtifactError(MeshgenError):
    """An artifact's object is missing or altered; running the stage again restores it."""

    def __init__(self, ref: ArtifactRef, output: str) -> None:
        self.ref, self.output = ref, output
        super().__init__(f"stored {output} of stage {ref.stage} is missing or damaged; run again to restore it")


@contextmanager
def exclusive(path: Path) -> Iterator[None]:
    """Hold a lock file; others (threads and processes) wait. The kernel lets go of it when the holder dies."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield


class Store:
    """Records and objects below one folder.

    ```
    objects/ab/<sha256>          content of output files, read-only
    records/<stage>/<key>.json   which outputs a recipe gave
    locks/<key>                  one computation at a time per key
    tmp/                         unfinished work, never read
    ```

    A record and everything it names is checked whenever it is read: damage of any kind is a miss.
    """

    def __init__(self, root: str | Path | None = None) -> None:
        """Use the store in `root`; None takes the environment variable DRL_MESHGEN_STORE, else `artifacts`."""
        self.root = Path(root or os.environ.get(ENVIRONMENT) or DEFAULT)
        self.objects = Objects(self.root / "objects")

    def record_path(self, stage: str, key: str) -> Path:
        """Return the place of a record."""
        return self.root / "records" / checked_stage(stage) / f"{checked_digest(key)}.json"

    def find(self, stage: str, key: str) -> ArtifactRef | None:
        """Return the artifact of a key, or None where it was never computed or record or objects are damaged."""
        record = self._record(stage, key)
        if record is None:
            return None
        ref = ArtifactRef(stage, key, record["outputs"])
        return ref if all(self.objects.intact(sha) for sha in ref.outputs.values()) else None

    def seconds(self, ref: ArtifactRef) -> float:
        """Return how long the computation of an artifact took when it was made; NaN where its record is gone."""
        record = self._record(ref.stage, ref.key)
        return float("nan") if record is None else float(record["seconds"])

    def parts(self, ref: ArtifactRef) -> dict[str, float]:
        """Return the seconds of the parts that `compute` told of; empty where it told of none or its record is gone."""
        record = self._record(ref.stage, ref.key)
        return {} if record is None else {name: float(seconds) for name, seconds in record["parts"].items()}

    def run(self, recipe: Recipe, compute: Callable[[Path], Mapping[str, float] | None]) -> ArtifactRef:
        """Return the artifact of a recipe; `compute(folder)` writes its files where the store has no sound ones.

        What it returns are seconds that parts of it took, by name: kept beside the artifact, where time belongs.

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
                ref = ArtifactRef(recipe.stage, recipe.key, {name: self.objects.put(files[name]) for name in files})
                self._write_record(recipe, ref, {"seconds": seconds, "parts": dict(parts or {})}, work / "record.json")
        return ref

    @contextmanager
    def folder(self, ref: ArtifactRef) -> Iterator[Path]:
        """Yield a temporary folder with the artifact's files under their names, each checked; it is removed afterwards.

        Raises `DamagedArtifactError` where a file is missing or altered.
        """
        (self.root / "tmp").mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="read-", dir=self.root / "tmp") as place:
            for name, sha in ref.outputs.items():
                if not self.objects.give(sha, Path(place, name)):
                    raise DamagedArtifactError(ref, name)
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

    def _record(self, stage: str, key: str) -> dict[str, Any] | None:
        """Read a record; None where it is absent, unreadable, altered, or not the record of this key."""
        try:
            data = json.loads(self.record_path(stage, key).read_bytes())
            recipe, outputs, seconds = data["recipe"], data["outputs"], data["seconds"]
            parts = dict(data["parts"])
            ArtifactRef(stage, key, outputs)
        except (FileNotFoundError, ValueError, KeyError, TypeError, AttributeError):
            return None
        sound = digest(recipe) == key and data.get("digest") == digest({"recipe": recipe, "outputs": outputs})
        record = {"recipe": recipe, "outputs": outputs, "seconds": seconds, "parts": parts}
        return record if sound and outputs else None

    def _write_record(self, recipe: Recipe, ref: ArtifactRef, time_taken: Mapping[str, Any], draft: Path) -> None:
        hashed = {"recipe": recipe.to_json(), "outputs": dict(ref.outputs)}
        draft.write_text(json.dumps({**hashed, "digest": digest(hashed), **time_taken}, indent=1, sort_keys=True))
        settle(draft, self.record_path(ref.stage, ref.key))

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
