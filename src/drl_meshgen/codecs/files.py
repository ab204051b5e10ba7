"""What all codecs are made of: grids as VTU files, ragged lists and single values as Parquet tables.

Arrays come back bit by bit, and the same result always gives the same bytes.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from drl_meshgen.export import read_table, write_table
from drl_meshgen.export.xml import write_xml
from drl_meshgen.mesh import BlockMesh, TriMesh

if TYPE_CHECKING:
    import pyvista as pv

R = TypeVar("R")

_POLY_LINE, _TRIANGLE, _QUAD = 4, 5, 9


@dataclass(frozen=True)
class Codec(Generic[R]):
    """How the result of one stage becomes files and is read back."""

    write: Callable[[R, Path], None]
    """Write a result into an empty folder."""
    read: Callable[[Path], R]
    """Read it back; nothing of the folder is needed afterwards."""
    module: str
    """Where both are defined, for the cache key of the stage."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Points with cells of one kind, and arrays on both."""

    points: Float[np.ndarray, "n 3"]
    cells: Int[np.ndarray, "m k"]
    point: Mapping[str, np.ndarray]
    cell: Mapping[str, np.ndarray]

    @property
    def surface(self) -> TriMesh:
        """The triangles as a mesh."""
        return TriMesh(self.points, self.cells)

    def grids(self) -> tuple[Int[np.ndarray, "ni1 nj1"], ...]:
        """Node grids of the blocks that the cell arrays `block`, `i` and `j` describe (see `write_blocks`)."""
        start = np.searchsorted(self.cell["block"], np.arange(int(self.cell["block"].max(initial=-1)) + 2))
        return tuple(_node_grid(self.cells[a:b], self.cell["i"][a:b], self.cell["j"][a:b]) for a, b in pairwise(start))


def _node_grid(quads: np.ndarray, i: np.ndarray, j: np.ndarray) -> Int[np.ndarray, "ni1 nj1"]:
    grid = np.empty((i.max() + 2, j.max() + 2), np.int64)
    for corner, (di, dj) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
        grid[i + di, j + dj] = quads[:, corner]
    return grid


def _save(path: Path, grid: "pv.UnstructuredGrid", point: Mapping[str, np.ndarray], cell: Mapping[str, Any]) -> None:
    for name, values in point.items():
        grid.point_data[name] = _plain(values)
    for name, values in cell.items():
        grid.cell_data[name] = _plain(values)
    write_xml(path, grid)


def _plain(values: np.ndarray) -> np.ndarray:
    """VTK has no flags: they become 0 and 1."""
    return np.ascontiguousarray(values, np.int8 if values.dtype == bool else None)


def write_grid(
    path: Path,
    points: Float[np.ndarray, "n d"],
    cells: Int[np.ndarray, "m k"],
    point: Mapping[str, np.ndarray] | None = None,
    cell: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Write triangles or quads with arrays on points and cells; points of the plane get `z = 0`."""
    import pyvista as pv

    kind = {3: _TRIANGLE, 4: _QUAD}[cells.shape[1]]
    place = np.zeros((len(points), 3))
    place[:, : points.shape[1]] = points
    _save(path, pv.UnstructuredGrid({kind: np.asarray(cells, np.int64)}, place), point or {}, cell or {})


def write_blocks(
    path: Path,
    points: Float[np.ndarray, "n d"],
    grids: Sequence[Int[np.ndarray, "ni1 nj1"]],
    point: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Write structured blocks as quads with cell arrays `block`, `i`, `j`."""
    mesh = BlockMesh(np.zeros((len(points), 3)), tuple(grids))
    write_grid(path, points, mesh.mesh.quads, point, {"block": mesh.block, "i": mesh.i, "j": mesh.j})


def read_grid(path: Path) -> Grid:
    """Read what `write_grid` or `write_blocks` wrote."""
    points, cells, starts, point, cell = _arrays(path)
    width = 4 if 4 in np.diff(starts[:2]) else 3
    return Grid(points, cells.reshape(-1, width), point, cell)


def write_faces(
    path: Path, points: Float[np.ndarray, "n 3"], quads: Int[np.ndarray, "m 4"], triangles: Int[np.ndarray, "t 3"]
) -> None:
    """Write a mesh of quads and triangles, quads first."""
    import pyvista as pv

    faces = {_QUAD: quads, _TRIANGLE: triangles}
    cells = [np.c_[np.full(len(kind), kind.shape[1]), kind].ravel() for kind in faces.values()]
    types = np.repeat(list(faces), [len(kind) for kind in faces.values()])
    _save(path, pv.UnstructuredGrid(np.concatenate(cells), types, np.array(points)), {}, {})


def read_faces(path: Path) -> tuple[np.ndarray, Int[np.ndarray, "m 4"], Int[np.ndarray, "t 3"]]:
    """Read what `write_faces` wrote: points, quads, triangles."""
    points, cells, starts, _, _ = _arrays(path)
    split = 4 * np.count_nonzero(np.diff(starts) == 4)
    return points, cells[:split].reshape(-1, 4), cells[split:].reshape(-1, 3)


def write_lines(
    path: Path,
    points: Float[np.ndarray, "n 3"],
    lines: Sequence[Int[np.ndarray, " k"]],
    point: Mapping[str, np.ndarray],
    cell: Mapping[str, np.ndarray],
) -> None:
    """Write polylines over points, not all of which need to be used."""
    import pyvista as pv

    cells = np.concatenate([np.r_[len(line), line] for line in lines])
    _save(path, pv.UnstructuredGrid(cells, np.full(len(lines), _POLY_LINE), np.array(points)), point, cell)


def read_lines(path: Path) -> tuple[np.ndarray, list[np.ndarray], Mapping[str, np.ndarray], Mapping[str, np.ndarray]]:
    """Read what `write_lines` wrote: points, lines, point arrays, cell arrays."""
    points, cells, starts, point, cell = _arrays(path)
    return points, np.split(cells, starts[1:-1]), point, cell


def _arrays(
    path: Path,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Read points, connectivity, where each cell starts in it, point arrays and cell arrays of a VTU file.

    All are copies, so that no file stays in use. By VTK itself: importing PyVista takes longer than most results do.
    """
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput()
    cells = grid.GetCells()
    points = np.array(vtk_to_numpy(grid.GetPoints().GetData()))
    connectivity = np.array(vtk_to_numpy(cells.GetConnectivityArray()), np.int64)
    starts = np.array(vtk_to_numpy(cells.GetOffsetsArray()), np.int64)
    point, cell = (
        {data.GetArrayName(k): np.array(vtk_to_numpy(data.GetArray(k))) for k in range(data.GetNumberOfArrays())}
        for data in (grid.GetPointData(), grid.GetCellData())
    )
    return points, connectivity, starts, point, cell


def write_rows(path: Path, **columns: Iterable[Any]) -> None:
    """Write a table of plain values and ragged lists (arrays or tuples of numbers)."""
    write_table(path, pd.DataFrame({name: [_cell(value) for value in values] for name, values in columns.items()}))


def _cell(value: Any) -> Any:
    return np.asarray(value).tolist() if isinstance(value, (np.ndarray, tuple, list)) else value


def read_rows(path: Path) -> list[Any]:
    """Read a table as named tuples; see `integers` and `reals` for its lists."""
    return list(read_table(path).itertuples(index=False))


def integers(values: Iterable[int]) -> Int[np.ndarray, " n"]:
    """Return a list of a table as an array of indices or counts."""
    return np.asarray(values, np.int64)


def reals(values: Iterable[float]) -> Float[np.ndarray, " n"]:
    """Return a list of a table as an array of numbers."""
    return np.asarray(values, np.float64)


def write_facts(folder: Path, **facts: str | float) -> None:
    """Write single values that belong to the whole result as `facts.parquet`."""
    write_rows(folder / "facts.parquet", **{name: [value] for name, value in facts.items()})


def read_facts(folder: Path) -> Any:
    """Read what `write_facts` wrote, as a named tuple."""
    return read_rows(folder / "facts.parquet")[0]


def sewn_to(seams: Sequence[tuple[int, int]], n: int) -> Int[np.ndarray, " n"]:
    """Return for each of `n` curves the other side of its seam, -1 where it is not on one."""
    other = np.full(n, -1)
    for first, second in seams:
        other[first], other[second] = second, first
    return other


def seams_of(other: Iterable[int]) -> tuple[tuple[int, int], ...]:
    """Return the pairs that `sewn_to` was made of."""
    return tuple((first, int(second)) for first, second in enumerate(other) if second > first)
