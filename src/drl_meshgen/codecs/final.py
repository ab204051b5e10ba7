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
    write_facts(
        folder,
        outcome=result.smoothing.outcome.name,
        feature_share=result.feature_share,
        feature_deviation=result.feature_deviation,
    )


def read(folder: Path) -> FinalMesh:
    """Read the mesh and how the nodes moved."""
    grid = read_grid(folder / "mesh.vtu")
    triangle = integers(read_table(folder / "nodes.parquet")["triangle"])
    history, facts = read_table(folder / "history.parquet"), read_facts(folder)
    result = SmoothingResult(grid.points, triangle, SmoothingOutcome[facts.outcome], history)
    return FinalMesh(BlockMesh(grid.points, grid.grids()), result, facts.feature_share, facts.feature_deviation)


FINAL = Codec(write, read, __name__)
