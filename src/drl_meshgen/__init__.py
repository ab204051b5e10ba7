"""Fully automatic block-structured quad meshing of triangulated surfaces.

`mesh_surface(surface, options)` meshes a `TriMesh`, a model name or a file and returns a `BlockMesh`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from drl_meshgen.errors import InputError, MeshgenError, StageError
    from drl_meshgen.mesh import BlockMesh, QuadMesh, TriMesh
    from drl_meshgen.models import load
    from drl_meshgen.pipeline import MeshOptions, mesh_surface, run
    from drl_meshgen.quality import measure

__version__ = "0.1.0"

__all__ = [
    "BlockMesh",
    "InputError",
    "MeshOptions",
    "MeshgenError",
    "QuadMesh",
    "StageError",
    "TriMesh",
    "load",
    "measure",
    "mesh_surface",
    "run",
]

_HOME = {
    "BlockMesh": "mesh",
    "InputError": "errors",
    "MeshOptions": "pipeline",
    "MeshgenError": "errors",
    "QuadMesh": "mesh",
    "StageError": "errors",
    "TriMesh": "mesh",
    "load": "models",
    "measure": "quality",
    "mesh_surface": "pipeline",
    "run": "pipeline",
}


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that `drl-meshgen --help` need not wait for SciPy."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
