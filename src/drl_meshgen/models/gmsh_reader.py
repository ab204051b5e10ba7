"""Gmsh reading one file, in a process of its own: `python gmsh_reader.py FILE OUT`.

OUT (`.npz`) gets `points`, `triangles` and `volumes`, the number of volume elements or bodies. A CAD file is
tessellated, a mesh file is taken as it is. Nothing else of the package is imported.
"""

import sys

import gmsh
import numpy as np
from jaxtyping import Float, Int

_CORNERS = {2: 3, 3: 4, 9: 3, 10: 4, 16: 4, 20: 3, 21: 3, 36: 4}  # triangles and quads of Gmsh, all orders, by type
_LONGEST, _SHORTEST = 0.02, 0.002  # edges of a tessellation, of the diagonal of the bounding box
_PER_TURN = 48  # edges around a full circle: 0.2 % of its radius away from it


def _tessellate() -> None:
    """Mesh the faces of a CAD model; the deviation stays below 4e-4 diagonals."""
    low_high = np.array(gmsh.model.getBoundingBox(-1, -1))
    diagonal = float(np.linalg.norm(low_high[3:] - low_high[:3]))
    options = {
        "Mesh.MeshSizeFromCurvature": _PER_TURN,
        "Mesh.MeshSizeMax": _LONGEST * diagonal,
        "Mesh.MeshSizeMin": _SHORTEST * diagonal,
        "Mesh.MeshSizeExtendFromBoundary": 0,
        "Mesh.MeshSizeFromPoints": 0,
        "Mesh.Algorithm": 6,
    }
    for name, value in options.items():
        gmsh.option.setNumber(name, value)
    gmsh.model.mesh.generate(2)


def _surface() -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """Nodes and triangles of all surfaces; quads are cut, of curved elements the corners are taken."""
    tags, points = (np.asarray(a) for a in gmsh.model.mesh.getNodes()[:2])
    faces = []
    for kind, _, nodes in zip(*gmsh.model.mesh.getElements(2), strict=True):
        if kind in _CORNERS:
            per_element = gmsh.model.mesh.getElementProperties(kind)[3]
            corners = np.asarray(nodes, np.int64).reshape(-1, per_element)[:, : _CORNERS[kind]]
            faces += [corners[:, [0, 1, 2]]] + ([corners[:, [0, 2, 3]]] if _CORNERS[kind] == 4 else [])
    triangles = np.concatenate([np.zeros((0, 3), np.int64), *faces])
    place = np.zeros(int(max(tags, default=0)) + 1, np.int64)
    place[tags] = np.arange(len(tags))
    used, local = np.unique(place[triangles], return_inverse=True)
    return points.reshape(-1, 3)[used], local.reshape(-1, 3)


def main() -> None:
    """Read, tessellate where needed, write; raises whatever Gmsh raises."""
    gmsh.initialize()
    for name, value in {"General.Terminal": 0, "General.NumThreads": 1, "Geometry.OCCSewFaces": 1}.items():
        gmsh.option.setNumber(name, value)
    gmsh.open(sys.argv[1])
    volumes = max(len(gmsh.model.getEntities(3)), sum(map(len, gmsh.model.mesh.getElements(3)[1])))
    if not len(gmsh.model.mesh.getNodes()[0]) and gmsh.model.getEntities(2):
        _tessellate()
    points, triangles = _surface()
    gmsh.finalize()
    np.savez(sys.argv[2], points=points, triangles=triangles, volumes=np.array(volumes))


if __name__ == "__main__":
    main()
