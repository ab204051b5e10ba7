"""The files of one finished mesh."""

from pathlib import Path

from drl_meshgen.export.layout import block_edges, block_table
from drl_meshgen.export.tables import write_table
from drl_meshgen.export.vtk_files import write_layout, write_mesh
from drl_meshgen.mesh import BlockMesh


def write_block_mesh(folder: Path | str, mesh: BlockMesh) -> None:
    """Write `mesh.vtu`, `layout.vtu`, `blocks.parquet` and `edges.parquet` into `folder`."""
    folder = Path(folder)
    write_mesh(folder / "mesh.vtu", mesh)
    write_layout(folder / "layout.vtu", mesh)
    write_table(folder / "blocks.parquet", block_table(mesh))
    write_table(folder / "edges.parquet", block_edges(mesh))
