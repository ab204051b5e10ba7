"""Read surfaces from user files; everything that is wrong with a file is said in one sentence."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.errors import InputError
from drl_meshgen.models.apart import read_apart
from drl_meshgen.models.gmsh_files import SUFFIXES, read_with_gmsh
from drl_meshgen.models.ply import parse_ply
from drl_meshgen.models.surface import RawSurface

READABLE = (".stl", ".ply", ".obj", ".off", ".vtp", ".vtu", *SUFFIXES)
CONVERTIBLE = (".iges", ".igs", ".brep")
EXPORT_AGAIN = "export it again"
AT = "at_"
"""What the VTK reader puts before the names of point arrays."""
_VTK_READER = Path(__file__).with_name("vtk_reader.py")
_PATIENCE, _PER_MEGABYTE = 15.0, 1.0  # seconds; sound files take a tenth of it, on damaged ones VTK may never end
_VTK_DEFECTS = {
    3: "faces refer to points that are not in the file",
    4: "has faces with fewer than three corners",
}


def read_surface(path: Path) -> RawSurface:
    """Read STL, PLY, OBJ, OFF, VTP, VTU, MSH or STEP; polygons are triangulated, positions kept as stored.

    Numbers kept per point in PLY, VTP and VTU files become `point_data`.

    Raises `InputError` for a missing, unreadable, empty or truncated file, an unknown suffix, a file without
    triangles, or coordinates that are not finite.
    """
    name, suffix = path.name or str(path), path.suffix.lower()
    if suffix in CONVERTIBLE:
        raise InputError(name, f"{suffix[1:].upper()} files are not read yet", "convert it to STEP or STL")
    if suffix not in READABLE:
        known = ", ".join(s[1:].upper() for s in READABLE)
        raise InputError(name, f"neither a model's name nor a file type that is read ({known})")
    try:
        if path.exists() and not path.is_file():  # opening a pipe would wait for ever, a device may never end
            raise InputError(name, "cannot be read (not a plain file)", "name the file of the surface")
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(name, "no such file") from None
    except OSError as error:
        raise InputError(name, f"cannot be read ({error.strerror})") from None
    if not data.strip():
        raise InputError(name, "the file is empty", EXPORT_AGAIN)
    if suffix in SUFFIXES:
        raw = read_with_gmsh(path, data)
    elif suffix == ".off":
        raw = RawSurface(path.stem, *_parse_off(name, data))
    else:
        if suffix == ".stl":
            _check_stl_length(name, data)
        more = _ply_arrays(name, data) if suffix == ".ply" else {}
        raw = _read_with_vtk(path, more)
    _check_arrays(name, raw.points, raw.triangles)
    return raw


def _check_arrays(name: str, points: np.ndarray, triangles: np.ndarray) -> None:
    if len(triangles) == 0:
        raise InputError(name, "holds no triangles", "export the surface, not only its points or curves")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise InputError(name, "triangles refer to points that are not in the file", EXPORT_AGAIN)
    bad = np.nonzero(~np.isfinite(points).all(axis=1))[0]
    if len(bad):
        raise InputError(name, f"{len(bad)} points have NaN or infinite coordinates, the first is point {bad[0]}")


def _check_stl_length(name: str, data: bytes) -> None:
    if len(data) >= 84:
        count = int.from_bytes(data[80:84], "little")
        if len(data) == 84 + 50 * count:
            return
    text = data.lstrip()[:5].lower() == b"solid" and b"facet" in data[:4096].lower()
    if not text:
        raise InputError(name, "the STL data is truncated or not STL", EXPORT_AGAIN)
    if b"endsolid" not in data[-4096:].lower():
        raise InputError(name, "the file ends in the middle of the solid", EXPORT_AGAIN)


def _ply_arrays(name: str, data: bytes) -> dict[str, np.ndarray]:
    """Per-vertex numbers of a PLY file that can hold what its header promises."""
    ply = parse_ply(data)
    if ply is None:
        raise InputError(name, "the PLY header is damaged", EXPORT_AGAIN)
    if not ply.complete:
        raise InputError(name, "the file is shorter than its header promises", EXPORT_AGAIN)
    try:
        return ply.vertex_arrays()
    except ValueError:
        raise InputError(name, "damaged or truncated PLY file", EXPORT_AGAIN) from None


def vtk_arrays(path: Path) -> dict[str, np.ndarray]:
    """Return what `vtk_reader.py` says of a file that VTK reads; raises `InputError` where it is damaged."""
    name, kind = path.name, path.suffix[1:].upper()
    limit = _PATIENCE + _PER_MEGABYTE * path.stat().st_size / 1e6
    try:
        code, read = read_apart(_VTK_READER, path, limit)
    except TimeoutError:
        raise InputError(name, f"was not read within {limit:.0f} s, it seems damaged", EXPORT_AGAIN) from None
    if code:
        raise InputError(name, _VTK_DEFECTS.get(code, f"damaged or truncated {kind} file"), EXPORT_AGAIN)
    return read


def _read_with_vtk(path: Path, more: Mapping[str, np.ndarray]) -> RawSurface:
    """Return the triangles of a file that VTK reads, with its scalars of points and `more` of them."""
    read = vtk_arrays(path)
    points = read["points"]
    arrays = {key.removeprefix(AT): values for key, values in read.items() if key.startswith(AT)} | dict(more)
    scalars = {k: a for k, a in arrays.items() if a.shape == (len(points),) and a.dtype.kind in "iuf"}
    return RawSurface(path.stem, points, read["triangles"], scalars)


def _parse_off(name: str, data: bytes) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """Parse the ASCII form; polygons become fans."""
    lines = [line.split("#")[0] for line in data.decode("ascii", "replace").splitlines()]
    words = " ".join(lines).split()
    if words and words[0].upper().endswith("OFF"):
        words = words[1:]
    try:
        n_points, n_faces = int(words[0]), int(words[1])
        points = np.array(words[3 : 3 + 3 * n_points], float).reshape(n_points, 3)
        at, triangles = 3 + 3 * n_points, []
        rows = [line.split() for line in lines if line.strip()]
        for row in rows[-n_faces:] if n_faces else []:
            corners = [int(w) for w in row[1 : 1 + int(row[0])]]
            triangles += [(corners[0], b, c) for b, c in pairwise(corners[1:])]
        if at + 4 * n_faces > len(words):
            raise InputError(name, "the file is shorter than its header promises", EXPORT_AGAIN)
    except (ValueError, IndexError):
        raise InputError(name, "damaged or truncated OFF file", EXPORT_AGAIN) from None
    return points, np.array(triangles, np.int64).reshape(-1, 3)
