"""VTK reading one surface or curve, in a process of its own: `python vtk_reader.py FILE OUT`.

OUT (`.npz`) gets `points`, `triangles`, and the scalars of points as `at_NAME`; polygons and cells are triangulated.
Lines, joined where they meet, become `curve_points`, `curve_nodes` (ids of all curves, one after the other) and
`curve_starts` (where each begins, and the end). The exit code is 2 where VTK complained, 3 where cells refer to points
that are not there, 4 where faces have fewer than three corners. Nothing else of the package is imported.
"""

import resource
import sys
from pathlib import Path
from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkFiltersCore import vtkTriangleFilter

MEMORY, PER_BYTE = 4 << 30, 64
"""Bytes of address space, and more of them per byte of the file: a small one may claim to hold any number of points."""


def _reader(suffix: str) -> Any:
    """Return VTK's reader of a suffix; only what it needs is imported."""
    if suffix == ".ply":
        from vtkmodules.vtkIOPLY import vtkPLYReader

        return vtkPLYReader()
    if suffix in {".vtp", ".vtu"}:
        from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

        return vtkXMLPolyDataReader() if suffix == ".vtp" else vtkXMLUnstructuredGridReader()
    from vtkmodules.vtkIOGeometry import vtkOBJReader, vtkSTLReader

    return vtkOBJReader() if suffix == ".obj" else vtkSTLReader()


def _read(path: Path) -> Any:
    reader, complaints = _reader(path.suffix.lower()), []
    reader.AddObserver("ErrorEvent", lambda *_: complaints.append(1))
    reader.SetFileName(str(path))
    reader.Update()
    if complaints:
        sys.exit(2)
    return reader.GetOutput()


def _check(data: Any) -> None:
    """Leave where cells refer to points that are not there: VTK's filters do not look."""
    if isinstance(data, vtkPolyData):
        kinds = (data.GetVerts(), data.GetLines(), data.GetPolys(), data.GetStrips())
    else:
        kinds = (data.GetCells(),)
    for cells in kinds:
        nodes = vtk_to_numpy(cells.GetConnectivityArray())
        if len(nodes) and (nodes.min() < 0 or nodes.max() >= data.GetNumberOfPoints()):
            sys.exit(3)


def _surface(data: Any) -> Any:
    """Return the triangles of an outer surface."""
    triangulate = vtkTriangleFilter()
    triangulate.SetInputData(data)
    triangulate.PassVertsOff()
    triangulate.PassLinesOff()
    triangulate.Update()
    return triangulate.GetOutput()


def _outer(data: Any) -> Any:
    """Return the outer surface of a grid, with its lines."""
    if isinstance(data, vtkPolyData):
        return data
    from vtkmodules.vtkFiltersGeometry import vtkDataSetSurfaceFilter

    outer = vtkDataSetSurfaceFilter()
    outer.SetInputData(data)
    outer.Update()
    return outer.GetOutput()


def _curves(data: Any) -> dict[str, Any]:
    """Return the lines, joined where they meet."""
    points, nodes, starts = np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(1, np.int64)
    if data.GetNumberOfLines():
        from vtkmodules.vtkFiltersCore import vtkStripper

        lines = vtkPolyData()
        lines.SetPoints(data.GetPoints())
        lines.SetLines(data.GetLines())
        join = vtkStripper()
        join.SetInputData(lines)
        join.JoinContiguousSegmentsOn()
        join.SetMaximumLength(join.GetMaximumLengthMaxValue())
        join.Update()
        joined = join.GetOutput()
        points = vtk_to_numpy(joined.GetPoints().GetData())
        nodes = vtk_to_numpy(joined.GetLines().GetConnectivityArray())
        starts = vtk_to_numpy(joined.GetLines().GetOffsetsArray())
    return {"curve_points": points, "curve_nodes": nodes, "curve_starts": starts}


def main() -> None:
    """Read, triangulate, write; raises whatever VTK raises."""
    path = Path(sys.argv[1])
    most = MEMORY + PER_BYTE * path.stat().st_size
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    data = _read(path)
    _check(data)
    outer = _outer(data)
    surface = _surface(outer)
    n = surface.GetNumberOfPoints()
    points = vtk_to_numpy(surface.GetPoints().GetData()) if n else np.zeros((0, 3))
    cells = vtk_to_numpy(surface.GetPolys().GetConnectivityArray())
    if len(cells) != 3 * surface.GetNumberOfPolys():
        sys.exit(4)
    arrays = _curves(outer)
    at = surface.GetPointData()
    for k in range(at.GetNumberOfArrays()):
        array = at.GetArray(k)
        if array is not None and array.GetName() and array.GetNumberOfComponents() == 1:
            arrays[f"at_{array.GetName()}"] = vtk_to_numpy(array)
    np.savez(sys.argv[2], points=points, triangles=cells.reshape(-1, 3).astype(np.int64), **arrays)


if __name__ == "__main__":
    main()
