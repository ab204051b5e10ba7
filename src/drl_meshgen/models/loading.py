"""One entry for every source of surfaces."""

from pathlib import Path

from drl_meshgen.errors import InputError
from drl_meshgen.mesh import TriMesh
from drl_meshgen.models.cache import DEFAULT_CACHE, cached_surface
from drl_meshgen.models.giraffe import giraffe
from drl_meshgen.models.hand import hand
from drl_meshgen.models.hemisphere import hemisphere
from drl_meshgen.models.random_surface import is_random, random_surface, seed_of
from drl_meshgen.models.reading import read_surface
from drl_meshgen.models.sampling import sample
from drl_meshgen.models.surface import RawSurface

MODELS = ("hemisphere", "giraffe", "hand")
RANDOM = "random:SEED"
MIN_TRIANGLES, MAX_TRIANGLES = 5_000, 1_000_000


def is_generated(name: str) -> bool:
    """Tell whether a name stands for a surface built by code: one of `MODELS` or `random:SEED`."""
    return name in MODELS or is_random(name)


def generate(name: str, triangles: int) -> TriMesh:
    """Build a model by code: one oriented disk of about `triangles` triangles (within 10 %)."""
    if name == "hemisphere":
        return hemisphere(triangles)
    return sample({"giraffe": giraffe, "hand": hand}[name](), triangles)


def existing_file(source: str | Path) -> Path:
    """Return the path of a surface's file.

    Raises `InputError` where there is none; without a suffix it may be a misspelt model, so the sentence names them.
    """
    path = Path(source)
    try:
        there, plain = path.exists(), path.is_file()
    except OSError as error:  # a name that is too long, a folder that may not be entered
        raise InputError(path.name, f"cannot be read ({error.strerror})") from None
    if there and not plain:  # opening a pipe would wait for ever, a device may never end
        raise InputError(path.name or str(source), "cannot be read (not a plain file)", "name the file of the surface")
    if not there:
        hint = "" if path.suffix else f", and no model of that name ({', '.join((*MODELS, RANDOM))})"
        raise InputError(path.name or str(source), f"no such file{hint}")
    return path


def load(name_or_path: str | Path, triangles: int = 25_000, cache_dir: Path | None = DEFAULT_CACHE) -> RawSurface:
    """Return a model by name or the surface in a file.

    Names are those of `MODELS`, with `triangles` as their size, 5,000 to 1,000,000, and `random:SEED`, a random
    surface (see `random_surface`); for these and for files `triangles` is ignored. Giraffe and hand are kept in
    `cache_dir` (None: always built anew; the default is chosen as `cache.default_folder` says).

    Raises `InputError` for a size out of range and for anything in a file that is not a triangulated surface.
    """
    name = str(name_or_path)
    if is_random(name):
        return random_surface(seed_of(name)).surface
    if name not in MODELS:
        return read_surface(existing_file(name_or_path))
    if not MIN_TRIANGLES <= triangles <= MAX_TRIANGLES:
        raise InputError(name, f"{triangles} triangles asked for", f"use {MIN_TRIANGLES} to {MAX_TRIANGLES}")
    if name == "hemisphere" or cache_dir is None:
        mesh = generate(name, triangles)
    else:
        mesh = cached_surface(name, triangles, lambda: generate(name, triangles), cache_dir)
    return RawSurface(name, mesh.vertices, mesh.triangles)
