"""Generated surfaces on disk: the same bytes each time, never half a file."""

import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np

from drl_meshgen.mesh import TriMesh

DEFAULT_CACHE = Path()  # stands for `default_folder()`, looked up when it is needed
SOURCES = ("implicit.py", "sampling.py", "giraffe.py", "hand.py", "hand_relief.py")
REMESHER = "meshlab.py"


def default_folder() -> Path:
    """`DRL_MESHGEN_CACHE` if set, else `drl-meshgen` in the user's cache folder."""
    chosen = os.environ.get("DRL_MESHGEN_CACHE")
    if chosen:
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "drl-meshgen"


@cache
def _source_digest() -> str:
    digest = hashlib.sha256()
    for source in SOURCES:
        digest.update(resources.files("drl_meshgen.models").joinpath(source).read_bytes())
    digest.update(resources.files("drl_meshgen.cleanup").joinpath(REMESHER).read_bytes())
    return digest.hexdigest()


def cached_surface(name: str, triangles: int, build: Callable[[], TriMesh], folder: Path) -> TriMesh:
    """Return the surface kept under the digest of (name, size, generating code), building it if it is not there.

    A file that cannot be read or whose content does not match its checksum is built again.
    """
    folder = default_folder() if folder == DEFAULT_CACHE else folder
    key = hashlib.sha256(f"{name} {triangles} {_source_digest()}".encode()).hexdigest()[:32]
    path = folder / f"{name}-{triangles}-{key}.npz"
    found = _read(path)
    if found is not None:
        return found
    mesh = build()
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=folder, suffix=".part", delete=False) as file:
        np.savez(file, vertices=mesh.vertices, triangles=mesh.triangles, checksum=_checksum(mesh))
        file.flush()
        os.fsync(file.fileno())
    Path(file.name).replace(path)
    return mesh


def _checksum(mesh: TriMesh) -> str:
    return hashlib.sha256(mesh.vertices.tobytes() + mesh.triangles.tobytes()).hexdigest()


def _read(path: Path) -> TriMesh | None:
    import zipfile

    try:
        with np.load(path) as stored:
            mesh = TriMesh(stored["vertices"], stored["triangles"])
            return mesh if str(stored["checksum"]) == _checksum(mesh) else None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
