"""Meshes and their topology: frozen arrays, derived data cached on first use."""

from drl_meshgen.mesh.curves import FeatureCurve
from drl_meshgen.mesh.quadmesh import BlockMesh, QuadMesh
from drl_meshgen.mesh.trimesh import TriMesh

__all__ = ["BlockMesh", "FeatureCurve", "QuadMesh", "TriMesh"]
