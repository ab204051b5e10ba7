"""Mesh files through VTK."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Int

from drl_meshgen.errors import InputError
from drl_meshgen.export.atomic import replacing
from drl_meshgen.export.layout import block_corners
from drl_meshgen.export.xml import write_xml
from drl_meshgen.mesh import BlockMesh, QuadMesh, TriMesh

if TYPE_CHECKING:
    import pyvista as pv

_QUAD, _PIXEL = 9, 8


def _quad_grid(points: np.ndarray, quads: np.ndarray) -> "pv.UnstructuredGrid":
    import pyvista as pv

    return pv.UnstructuredGrid({_QUAD: np.asarray(quads, np.int64)}, np.array(points, np.float64))


def _save(path: Path | str, grid: "pv.UnstructuredGrid | pv.PolyData") -> None:
    with replacing(path) as part:
        write_xml(part, grid)


def write_mesh(path: Path | str, mesh: BlockMesh) -> None:
    """Write all quads with cell arrays `block`, `i`, `j` and point arrays `valence` and `irregular`.

    `irregular` is valence - 4 at interior nodes (negative: fewer quads than four meet), 0 elsewhere. The format is VTU.
    """
    grid = _quad_grid(mesh.points, mesh.mesh.quads)
    t = mesh.mesh.topology
    for name, values in (("block", mesh.block), ("i", mesh.i), ("j", mesh.j)):
        grid.cell_data[name] = values.astype(np.int32)
    grid.point_data["valence"] = t.valence.astype(np.int32)
    grid.point_data["irregular"] = np.where(mesh.mesh.irregular, t.valence - 4, 0).astype(np.int32)
    _save(path, grid)


def write_layout(path: Path | str, mesh: BlockMesh) -> None:
    """Write one quad per block over its corner nodes, with cell arrays `block`, `ni`, `nj` and point array `node`."""
    corners = block_corners(mesh)
    nodes, local = np.unique(corners, return_inverse=True)
    grid = _quad_grid(mesh.points[nodes], local.reshape(-1, 4))
    shape = np.array([g.shape for g in mesh.grids], np.int32).reshape(-1, 2) - 1
    grid.cell_data["block"] = np.arange(len(mesh.grids), dtype=np.int32)
    grid.cell_data["ni"], grid.cell_data["nj"] = shape[:, 0].copy(), shape[:, 1].copy()
    grid.point_data["node"] = nodes
    _save(path, grid)


def write_surface_ply(path: Path | str, surface: TriMesh) -> None:
    """Write a triangulated surface as binary little-endian PLY with coordinates in double precision."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(surface.vertices)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(surface.triangles)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(surface.triangles), np.dtype([("n", "u1"), ("v", "<i4", 3)]))
    faces["n"], faces["v"] = 3, surface.triangles
    with replacing(path) as part:
        part.write_bytes(header.encode() + surface.vertices.astype("<f8").tobytes() + faces.tobytes())


def _loaded(path: Path) -> Any:
    import pyvista as pv

    if not path.is_file():
        raise InputError(str(path), "no such file")
    try:
        data: Any = pv.read(path)
    except (OSError, ValueError, RuntimeError, KeyError) as error:
        raise InputError(str(path), "cannot be read as a mesh") from error
    if isinstance(data, pv.MultiBlock):
        data = data.combine()
    return data if isinstance(data, pv.UnstructuredGrid) else data.cast_to_unstructured_grid()


def read_mesh(path: Path | str) -> tuple[QuadMesh, Int[np.ndarray, " m"] | None]:
    """Read a quad mesh of any format that pyvista reads, and the cell array `block` if there is one.

    Raises `InputError` where the file cannot be read, is empty, or has a cell that is not a quadrilateral.
    """
    path = Path(path)
    grid = _loaded(path)
    types = np.asarray(grid.celltypes)
    if not len(types):
        raise InputError(str(path), "has no cells")
    others = int((~np.isin(types, (_QUAD, _PIXEL))).sum())
    if others:
        raise InputError(str(path), f"{others} of {len(types)} cells are not quadrilaterals")
    quads = np.asarray(grid.cells, np.int64).reshape(-1, 5)[:, 1:]
    quads = np.where((types == _PIXEL)[:, None], quads[:, [0, 1, 3, 2]], quads)
    points = np.asarray(grid.points, np.float64)
    if not np.isfinite(points).all():
        raise InputError(str(path), "has coordinates that are not finite")
    block = np.asarray(grid.cell_data["block"], np.int64) if "block" in grid.cell_data else None
    return QuadMesh(points, quads), block
