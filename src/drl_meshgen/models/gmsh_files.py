"""The door to Gmsh as a reader of STEP and MSH files: a process of its own, because a bad file can take it down."""

from pathlib import Path

from drl_meshgen.errors import InputError
from drl_meshgen.models.apart import read_apart
from drl_meshgen.models.surface import RawSurface

SUFFIXES = (".step", ".stp", ".msh")
_READER = Path(__file__).with_name("gmsh_reader.py")
_LIMIT = 300.0  # seconds
_LAST_WORDS = {".msh": b"$EndElements"}
_STEP_ENDS = b"END-ISO-10303-21"


def read_with_gmsh(path: Path, data: bytes) -> RawSurface:
    """Return the triangles of a MSH file (quads are cut) or a fine tessellation of the faces of a STEP file.

    Faces of a STEP file that share an edge, or lie against each other along one, share its vertices. `data` is what
    the file holds.

    Raises `InputError` for a damaged or truncated file, for one without surfaces, and where Gmsh takes too long.
    """
    name, kind = path.name, "MSH" if path.suffix.lower() == ".msh" else "STEP"
    if _LAST_WORDS.get(path.suffix.lower(), _STEP_ENDS) not in data[-65536:]:
        raise InputError(name, f"the file ends too early or is not {kind}", "export it again")
    try:
        code, read = read_apart(_READER, path, _LIMIT)
    except TimeoutError:
        defect = f"Gmsh needs more than {_LIMIT:g} s to read it"
        raise InputError(name, defect, "tessellate it in the program that made it, and export STL") from None
    if code:
        raise InputError(name, f"damaged {kind} file, or not {kind}", "export it again")
    if not len(read["triangles"]):
        found = "volume elements but no surface" if int(read["volumes"]) else "no surface"
        raise InputError(name, f"holds {found}", "export the faces of the surface")
    return RawSurface(path.stem, read["points"], read["triangles"])
