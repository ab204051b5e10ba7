"""Isotropic remeshing of whole surfaces, component by component, that keeps the topology or leaves it alone."""

import numpy as np
from jaxtyping import Float

from drl_meshgen.cleanup import repair
from drl_meshgen.cleanup.meshlab import remesh_isotropic
from drl_meshgen.cleanup.sheets import manifold
from drl_meshgen.mesh import TriMesh

_FLAT = 1e-7
_FINER = (1.0, 0.7, 0.5, 0.35)  # of the edge length asked for: thin limbs survive finer edges only


def remeshed(surface: TriMesh, scale: float, shift: Float[np.ndarray, " 3"], edge: float | None) -> tuple[TriMesh, int]:
    """Remesh each component towards the length `edge` (in units of `scale`), or its number of triangles.

    Where the result has another topology, finer edges are tried, and the component is left as it is where that
    does not help. Returns the mesh and how many components were left.
    """
    vertices, triangles, kept = [], [], 0
    n, label = surface.topology.components
    for c in range(n):
        part = _compact((surface.vertices - shift) / scale, surface.triangles[label == c])
        new = _component(part, edge or float(np.sqrt(4 / np.sqrt(3) * part.area / len(part.triangles))))
        kept += new is None
        new = new or part
        triangles.append(new.triangles + sum(map(len, vertices)))
        vertices.append(new.vertices)
    return TriMesh(np.vstack(vertices) * scale + shift, np.vstack(triangles)), kept


def _compact(points: np.ndarray, triangles: np.ndarray) -> TriMesh:
    used, local = np.unique(triangles, return_inverse=True)
    return TriMesh(points[used], local.reshape(-1, 3))


def _component(part: TriMesh, edge: float) -> TriMesh | None:
    for factor in _FINER:
        points, triangles = remesh_isotropic(part.vertices, part.triangles, factor * edge)
        triangles = repair.drop_duplicates(repair.drop_collapsed(triangles))
        triangles, _ = repair.mend_flat(points, triangles, _FLAT)
        triangles, source, *_ = manifold(points, triangles)
        speck, *_ = repair.specks(points[source], triangles, 0.01)
        triangles, _, one_sided = repair.orient(len(source), triangles[~speck])
        new = _compact(points[source], triangles)
        if not one_sided.any() and _kind(new) == _kind(part):
            return new
    return None


def _kind(mesh: TriMesh) -> tuple[int, int, int]:
    """Return what remeshing must not change: numbers of components and boundary loops, and the Euler characteristic."""
    return mesh.topology.components[0], mesh.topology.euler, len(mesh.topology.loops)
