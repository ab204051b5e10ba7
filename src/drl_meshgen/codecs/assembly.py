"""File of the assembly stage: `nodes.vtu`, blocks over welded nodes.

Each node is drawn at its place in the chart of its `piece`, so quads that join two pieces look torn.
"""

from pathlib import Path

import numpy as np

from drl_meshgen.assembly import Assembly
from drl_meshgen.codecs.files import Codec, read_grid, write_blocks


def write(result: Assembly, folder: Path) -> None:
    """Write blocks and nodes."""
    write_blocks(folder / "nodes.vtu", result.chart, result.grids, {"piece": result.piece})


def read(folder: Path) -> Assembly:
    """Read blocks and nodes."""
    grid = read_grid(folder / "nodes.vtu")
    return Assembly(grid.grids(), grid.point["piece"], np.ascontiguousarray(grid.points[:, :2]))


ASSEMBLY = Codec(write, read, __name__)
