"""Files of the quality stage.

`quality.parquet`: one row, one column per metric. `quads.vtu`: every quad by itself (nodes are not shared) with its
normal and figures. `defects.parquet`: one sentence per row.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from drl_meshgen.codecs.files import Codec, read_grid, read_rows, write_grid, write_rows
from drl_meshgen.export import read_table, write_table
from drl_meshgen.quality import QuadShape, Quality

SHOWN = ("min_angle", "max_angle", "orthogonality", "jacobian_ratio", "scaled_jacobian", "warp", "valid")


def write(result: Quality, folder: Path) -> None:
    """Write all figures."""
    write_table(folder / "quality.parquet", pd.DataFrame([result.metrics]))
    corners = result.shape.corners
    figures = {name: getattr(result.shape, name) for name in SHOWN}
    write_grid(
        folder / "quads.vtu",
        corners.reshape(-1, 3),
        np.arange(4 * len(corners)).reshape(-1, 4),
        cell={"normal": result.shape.normals, **figures},
    )
    write_rows(folder / "defects.parquet", defect=result.defects)


def read(folder: Path) -> Quality:
    """Read all figures."""
    grid = read_grid(folder / "quads.vtu")
    metrics = {str(name): float(value) for name, value in read_table(folder / "quality.parquet").iloc[0].items()}
    defects = tuple(row.defect for row in read_rows(folder / "defects.parquet"))
    return Quality(metrics, QuadShape(grid.points.reshape(-1, 4, 3), grid.cell["normal"]), defects)


QUALITY = Codec(write, read, __name__)
