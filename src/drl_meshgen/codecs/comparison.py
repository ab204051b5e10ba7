"""Files of the comparison stage.

`rivals.parquet`: one row per rival with its outcome and every metric. `<rival>.vtu`: the mesh of each rival that made
one, quads and leftover triangles. No times: those are kept in the record of the store.
"""

from pathlib import Path

from drl_meshgen.baselines import Comparison, Method
from drl_meshgen.codecs.files import Codec, read_faces, write_faces
from drl_meshgen.export import read_table, write_table
from drl_meshgen.mesh import QuadMesh


def write(result: Comparison, folder: Path) -> None:
    """Write the table and the meshes."""
    write_table(folder / "rivals.parquet", result.rows)
    for name, mesh in result.meshes.items():
        write_faces(folder / _file(name), mesh.points, mesh.quads, result.triangles[name])


def read(folder: Path) -> Comparison:
    """Read the table and the meshes."""
    rows = read_table(folder / "rivals.parquet")
    names = [str(name) for name in rows["method"] if (folder / _file(str(name))).is_file()]
    read_back = {name: read_faces(folder / _file(name)) for name in names}
    meshes = {name: QuadMesh(points, quads) for name, (points, quads, _) in read_back.items()}
    return Comparison(rows, meshes, {name: triangles for name, (_, _, triangles) in read_back.items()})


def _file(name: str) -> str:
    return f"{Method(name).key}.vtu"


COMPARISON = Codec(write, read, __name__)
