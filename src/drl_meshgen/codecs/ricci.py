"""Files of the Ricci stage.

`surface.vtu`: point arrays `u`, `curvature`, `target`, `distortion` on the surface. `flat.parquet`: one row per
triangle of the flat triangulation (corners, lengths and glue of its three slots). `history.parquet`: one row per Newton
step.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from drl_meshgen.codecs.files import Codec, read_facts, read_grid, write_facts, write_grid
from drl_meshgen.export import read_table, write_table
from drl_meshgen.ricci import FlatTriangulation, Outcome, RicciResult

FIELDS = ("u", "curvature", "target", "distortion")
SLOTS = ("corner0", "corner1", "corner2"), ("length0", "length1", "length2"), ("glue0", "glue1", "glue2")


def write(result: RicciResult, folder: Path) -> None:
    """Write the metric, the flat triangulation and the history."""
    fields = {name: getattr(result, name) for name in FIELDS}
    write_grid(folder / "surface.vtu", result.surface.vertices, result.surface.triangles, fields)
    flat = result.triangulation
    arrays = (flat.faces, flat.lengths, flat.glue.reshape(-1, 3))
    columns = {name: a[:, k] for names, a in zip(SLOTS, arrays, strict=True) for k, name in enumerate(names)}
    write_table(folder / "flat.parquet", pd.DataFrame(columns))
    write_table(folder / "history.parquet", result.history)
    write_facts(folder, outcome=result.outcome.name)


def read(folder: Path) -> RicciResult:
    """Read the metric, the flat triangulation and the history."""
    grid = read_grid(folder / "surface.vtu")
    table = read_table(folder / "flat.parquet")
    faces, lengths, glue = (np.ascontiguousarray(table[list(names)].to_numpy()) for names in SLOTS)
    return RicciResult(
        **{name: grid.point[name] for name in FIELDS},
        triangulation=FlatTriangulation(faces, lengths, glue.ravel()),
        history=read_table(folder / "history.parquet"),
        outcome=Outcome[read_facts(folder).outcome],
        surface=grid.surface,
    )


RICCI = Codec(write, read, __name__)
