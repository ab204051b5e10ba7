"""Files of the seams stage.

`surface.vtu`: the opened surface with the cell array `parent`. `seams.parquet`: kind and vertices of both sides of each
seam. `table.parquet`: one row per seam. `features.parquet`: points, corners and kind of each sharp curve.
"""

from pathlib import Path

from drl_meshgen.codecs.files import Codec, integers, read_grid, read_rows, reals, write_grid, write_rows
from drl_meshgen.export import read_table, write_table
from drl_meshgen.mesh import FeatureCurve
from drl_meshgen.seams import OpenedSurface, Seam, SeamKind


def write(result: OpenedSurface, folder: Path) -> None:
    """Write the opened surface and its seams."""
    write_grid(folder / "surface.vtu", result.mesh.vertices, result.mesh.triangles, cell={"parent": result.parent})
    write_rows(
        folder / "seams.parquet",
        kind=[seam.kind.name for seam in result.seams],
        left=[seam.left for seam in result.seams],
        right=[seam.right for seam in result.seams],
    )
    write_table(folder / "table.parquet", result.table)
    write_rows(
        folder / "features.parquet",
        closed=[curve.closed for curve in result.features],
        points=[curve.points.ravel() for curve in result.features],
        corners=[curve.corners for curve in result.features],
    )


def read(folder: Path) -> OpenedSurface:
    """Read the opened surface and its seams."""
    grid = read_grid(folder / "surface.vtu")
    seams = tuple(
        Seam(integers(row.left), integers(row.right), SeamKind[row.kind]) for row in read_rows(folder / "seams.parquet")
    )
    features = tuple(
        FeatureCurve(reals(row.points).reshape(-1, 3), bool(row.closed), integers(row.corners))
        for row in read_rows(folder / "features.parquet")
    )
    return OpenedSurface(grid.surface, grid.cell["parent"], seams, read_table(folder / "table.parquet"), features)


SEAMS = Codec(write, read, __name__)
