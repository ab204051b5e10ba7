"""Harmonic charts of regions: cylinder coordinates of rings, disk coordinates of caps.

Weights are those of the cotangent Laplacian, floored to stay positive, so that Tutte's theorem applies: charts do not
fold.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix, csc_array, csc_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import SuperLU, splu

from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.cutgraph import corners_left_of

#: Smallest and largest weight of an edge, per triangle at it.
WEIGHT_RANGE = (0.02, 20.0)


@dataclass(frozen=True, eq=False)
class RingChart:
    """Coordinates `(theta, h)` of a ring: `h` is 0 on the first loop and 1 on the second, `theta` has period 1.

    `theta_corner (f, 3)` is continuous inside each triangle; `theta (v,)` is its value mod nothing at each vertex (one
    branch). `(theta, h)` is right-handed seen from the normals. `modulus` is height over circumference of the
    conformally equivalent cylinder.
    """

    theta: Float[np.ndarray, " v"]
    theta_corner: Float[np.ndarray, "f 3"]
    h: Float[np.ndarray, " v"]
    modulus: float


def corner_weights(mesh: TriMesh) -> Float[np.ndarray, "f 3"]:
    """Half cotangent at each corner, averaged over the corners opposite the same edge and clipped to `WEIGHT_RANGE`.

    Only the sum of the two matters. It is positive where the edge is Delaunay, so an obtuse corner alone clips nothing.
    """
    p = mesh.corners
    half = np.empty(mesh.triangles.shape)
    double = np.maximum(2 * mesh.areas, np.finfo(float).tiny)
    for k in range(3):
        half[:, k] = ((p[:, (k + 1) % 3] - p[:, k]) * (p[:, (k + 2) % 3] - p[:, k])).sum(1) / double / 2
    opposite = mesh.topology.face_edges[:, [1, 2, 0]]
    mean = np.bincount(opposite.ravel(), half.ravel()) / mesh.topology.edge_count
    return np.clip(mean, *WEIGHT_RANGE)[opposite]


def stiffness(mesh: TriMesh, weights: Float[np.ndarray, "f 3"]) -> csc_matrix:
    """Symmetric Laplacian `(v, v)` with `weights` of the corners opposite each side."""
    t, n = mesh.triangles, len(mesh.vertices)
    i = np.r_[t[:, 1], t[:, 2], t[:, 0]]
    j = np.r_[t[:, 2], t[:, 0], t[:, 1]]
    w = weights.T.ravel()
    off = coo_matrix((np.r_[w, w], (np.r_[i, j], np.r_[j, i])), (n, n)).tocsc()
    diagonal = np.asarray(off.sum(0)).ravel()
    return coo_matrix((diagonal, (np.arange(n),) * 2), (n, n)).tocsc() - off


def factorised(matrix: csc_matrix) -> SuperLU:
    """Factor a symmetric positive definite matrix."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def jump_load(
    mesh: TriMesh, weights: Float[np.ndarray, "f 3"], offset: Float[np.ndarray, "f 3"]
) -> Float[np.ndarray, " v"]:
    """Right-hand side for `theta (v,)` such that the function `theta[triangles] + offset` is harmonic."""
    n = len(mesh.vertices)
    load = np.zeros(n)
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        pull = weights[:, k] * (offset[:, a] - offset[:, b])
        load += np.bincount(mesh.triangles[:, b], pull, n) - np.bincount(mesh.triangles[:, a], pull, n)
    return load


def dirichlet(matrix: csc_matrix, known: Int[np.ndarray, " k"], values: Float[np.ndarray, "k c"]) -> np.ndarray:
    """Harmonic extension `(v, c)` of `values` at vertices `known`."""
    n = len(matrix.indptr) - 1
    free = np.setdiff1d(np.arange(n), known)
    out = np.empty((n, values.shape[1]))
    out[known] = values
    if len(free):
        block = csc_array(matrix)[free]
        out[free] = factorised(block[:, free].tocsc()).solve(-(block[:, known] @ values))
    return out


def ring_chart(mesh: TriMesh, first: Int[np.ndarray, " a"], second: Int[np.ndarray, " b"]) -> RingChart:
    """Chart of the ring `mesh` between its loops `first` (h = 0) and `second` (h = 1).

    `theta` is the harmonic function with natural boundary conditions and period 1, the conjugate of `h` up to
    discretisation, so rows and columns of the chart are close to orthogonal on the surface.
    """
    weights = corner_weights(mesh)
    matrix = stiffness(mesh, weights)
    known = np.r_[first, second]
    h = dirichlet(matrix, known, np.r_[np.zeros(len(first)), np.ones(len(second))][:, None])[:, 0]
    offset = _jump(mesh, first, second)
    load = jump_load(mesh, weights, offset)
    theta = np.zeros(len(h))
    theta[1:] = factorised(matrix[1:, 1:].tocsc()).solve(load[1:])
    corner = theta[mesh.triangles] + offset
    energy = sum(
        float((weights[:, k] * (corner[:, (k + 1) % 3] - corner[:, (k + 2) % 3]) ** 2).sum()) for k in range(3)
    )
    return RingChart(theta, corner, h, float(np.sqrt(energy / float(h @ (matrix @ h)))))


def _jump(mesh: TriMesh, first: np.ndarray, second: np.ndarray) -> Float[np.ndarray, "f 3"]:
    """Offset 1 for the corners on the left of a path from the first loop to the second, 0 elsewhere."""
    edges, n = mesh.topology.edges, len(mesh.vertices)
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), (n, n)).tocsr()
    hops, before, _ = dijkstra(graph, directed=False, indices=first, min_only=True, return_predecessors=True)
    path = [int(second[np.argmin(hops[second])])]
    while before[path[-1]] >= 0:
        path.append(int(before[path[-1]]))
    path.reverse()
    return corners_left_of(mesh.topology, np.array(path), closed=False).astype(float)


def disk_chart(mesh: TriMesh, loop: Int[np.ndarray, " b"], angle: Float[np.ndarray, " b"]) -> Float[np.ndarray, "v 2"]:
    """Harmonic map of a disk to the unit disk with the boundary `loop` at `angle` (radians, increasing)."""
    matrix = stiffness(mesh, corner_weights(mesh))
    return dirichlet(matrix, loop, np.c_[np.cos(angle), np.sin(angle)])
