"""Files of the smoothing stage, which are those a user takes away, and how the nodes moved.

`mesh.vtu`, `layout.vtu`, `blocks.parquet`, `edges.parquet` as `drl_meshgen.export` writes them. `nodes.parquet`: the
surface triangle of each node. `history.parquet`: one row per step of the optimiser.
"""

from pathlib import Path

from drl_meshgen.codecs.files import Codec, integers, read_facts, read_grid, write_facts, write_rows
from drl_meshgen.export import read_table, write_block_mesh, write_table
from drl_meshgen.mesh import BlockMesh
from drl_meshgen.smoothing import SmoothingOutcome, SmoothingResult
from drl_meshgen.smoothing.final import FinalMesh


def write(result: FinalMesh, folder: Path) -> None:
    """Write the mesh, its layout and how the nodes moved."""
    write_block_mesh(folder, result.mesh)
    write_rows(folder / "nodes.parquet", triangle=result.smoothing.triangle.tolist())
    write_table(folder / "history.parquet", result.smoothing.history)
    write_facts(folder, outcome=result.smoothing.outcome.name)


def read(folder: Path) -> FinalMesh:
    """Read the mesh and how the nodes moved."""
    grid = read_grid(folder / "mesh.vtu")
    triangle = integers(read_table(folder / "nodes.parquet")["triangle"])
    history, outcome = read_table(folder / "history.parquet"), SmoothingOutcome[read_facts(folder).outcome]
    result = SmoothingResult(grid.points, triangle, outcome, history)
    return FinalMesh(BlockMesh(grid.points, grid.grids()), result)


FINAL = Codec(write, read, __name__)
