"""Files people take away: meshes, layouts, surfaces and tables. Same input, same bytes; never half a file."""

from drl_meshgen.export.atomic import replacing
from drl_meshgen.export.curves import write_curves, write_surface
from drl_meshgen.export.folder import write_block_mesh
from drl_meshgen.export.layout import block_edges, block_table
from drl_meshgen.export.tables import read_table, write_table
from drl_meshgen.export.vtk_files import read_mesh, write_layout, write_mesh, write_surface_ply

__all__ = [
    "block_edges",
    "block_table",
    "read_mesh",
    "read_table",
    "replacing",
    "write_block_mesh",
    "write_curves",
    "write_layout",
    "write_mesh",
    "write_surface",
    "write_surface_ply",
    "write_table",
]
