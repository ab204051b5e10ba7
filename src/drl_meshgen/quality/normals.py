"""Normal of a triangulated surface at its points, faces, edges and vertices alike."""

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh import TriMesh

#: Barycentric coordinates below this put a point on the opposite edge.
ON_EDGE = 1e-9


def pseudo_normals(
    surface: TriMesh, triangle: Int[np.ndarray, " n"], points: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Return the angle-weighted pseudo-normal (not of unit length) at `points` of `surface` that lie in `triangle`.

    Inside a triangle that is its normal, on an edge the sum of both neighbours' normals, at a vertex the sum of all
    around it weighted by their angles. It does not depend on which of the triangles that share the point was found,
    and has a positive product with the offset of every outer point whose closest point it is (Baerentzen and Aanaes,
    Signed distance computation using the angle weighted pseudonormal, 2005).
    """
    corners = surface.corners[triangle]
    normal = surface.normals[triangle]
    bary = np.empty((len(points), 3))
    for k in range(3):
        a, b = corners[:, (k + 1) % 3], corners[:, (k + 2) % 3]
        bary[:, k] = np.einsum("ni,ni->n", np.cross(a - points, b - points), normal)
    bary /= np.maximum(2 * surface.areas[triangle], np.finfo(float).tiny)[:, None]
    near_zero = bary < ON_EDGE
    out = normal.copy()
    on_edge = near_zero.sum(axis=1) == 1
    side = (np.argmax(near_zero[on_edge], axis=1) + 1) % 3  # the side opposite corner k runs from corner k + 1
    across = surface.topology.neighbours[triangle[on_edge], side]
    out[on_edge] += np.where((across >= 0)[:, None], surface.normals[across], 0.0)
    at_vertex = near_zero.sum(axis=1) > 1
    vertex = surface.triangles[triangle[at_vertex], np.argmax(bary[at_vertex], axis=1)]
    out[at_vertex] = surface.angle_normals[vertex]
    return out
