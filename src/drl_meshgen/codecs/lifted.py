"""File of the inverse map: `mesh.vtu`, the blocks on the surface with the point array `triangle`."""

from pathlib import Path

from drl_meshgen.codecs.files import Codec, read_grid, write_blocks
from drl_meshgen.lift.inverse import LiftedMesh
from drl_meshgen.mesh import BlockMesh


def write(result: LiftedMesh, folder: Path) -> None:
    """Write the mesh and the surface triangle of each node."""
    write_blocks(folder / "mesh.vtu", result.mesh.points, result.mesh.grids, {"triangle": result.triangle})


def read(folder: Path) -> LiftedMesh:
    """Read the mesh and the surface triangle of each node."""
    grid = read_grid(folder / "mesh.vtu")
    return LiftedMesh(BlockMesh(grid.points, grid.grids()), grid.point["triangle"])


LIFTED = Codec(write, read, __name__)
