"""Curves on a surface, and the surface itself with arrays, for ParaView and the like."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from drl_meshgen.export.atomic import replacing
from drl_meshgen.export.xml import write_xml
from drl_meshgen.mesh import TriMesh


def write_curves(
    path: Path | str, lines: Sequence[Float[np.ndarray, "n 3"]], arrays: Mapping[str, Sequence[str | int | float]]
) -> None:
    """Write polylines as `.vtp` with arrays of text or numbers, one value per line."""
    import pyvista as pv

    sizes = [len(line) for line in lines]
    starts = np.cumsum([0, *sizes])
    cells = [np.r_[n, np.arange(start, start + n)] for n, start in zip(sizes, starts[:-1], strict=True)]
    data = pv.PolyData(np.concatenate(lines), lines=np.concatenate(cells))
    for name, values in arrays.items():
        data.cell_data[name] = np.asarray(values)
    with replacing(path) as part:
        write_xml(part, data)


def write_surface(
    path: Path | str, surface: TriMesh, point: Mapping[str, np.ndarray], cell: Mapping[str, np.ndarray]
) -> None:
    """Write triangles as `.vtu` with arrays on points and cells."""
    import pyvista as pv

    data = pv.UnstructuredGrid({5: np.array(surface.triangles)}, np.array(surface.vertices))
    for arrays, there in ((point, data.point_data), (cell, data.cell_data)):
        for name, values in arrays.items():
            there[name] = values
    with replacing(path) as part:
        write_xml(part, data)
