"""Files of the cleanup stage: `surface.vtu` with point arrays, and `audit.parquet`, one row per step."""

from pathlib import Path

from drl_meshgen.cleanup import CleanupResult
from drl_meshgen.codecs.files import Codec, read_grid, write_grid
from drl_meshgen.export import read_table, write_table


def write(result: CleanupResult, folder: Path) -> None:
    """Write the cleaned surface and the audit."""
    write_grid(folder / "surface.vtu", result.surface.vertices, result.surface.triangles, result.point_data)
    write_table(folder / "audit.parquet", result.audit)


def read(folder: Path) -> CleanupResult:
    """Read the cleaned surface and the audit."""
    grid = read_grid(folder / "surface.vtu")
    return CleanupResult(grid.surface, read_table(folder / "audit.parquet"), grid.point)


CLEANUP = Codec(write, read, __name__)
