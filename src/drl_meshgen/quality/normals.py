"""Normal of a triangulated surface at its points, faces, edges and vertices alike."""

import numpy as np
from jaxtyping import Bool, Float, Int

from drl_meshgen.mesh import TriMesh

#: Barycentric coordinates below this put a point on the opposite edge.
ON_EDGE = 1e-6


def _barycentric(
    surface: TriMesh, triangle: Int[np.ndarray, " n"], points: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    corners, normal = surface.corners[triangle], surface.normals[triangle]
    bary = np.empty((len(points), 3))
    for k in range(3):
        a, b = corners[:, (k + 1) % 3], corners[:, (k + 2) % 3]
        bary[:, k] = np.einsum("ni,ni->n", np.cross(a - points, b - points), normal)
    return bary / np.maximum(2 * surface.areas[triangle], np.finfo(float).tiny)[:, None]


def _shared(
    surface: TriMesh, triangle: Int[np.ndarray, " n"], points: Float[np.ndarray, "n 3"]
) -> tuple[Bool[np.ndarray, " n"], np.ndarray, Bool[np.ndarray, " n"], np.ndarray]:
    """Points on an edge with the triangle across (-1 at the boundary), and points at a vertex with that vertex."""
    bary = _barycentric(surface, triangle, points)
    near_zero = bary < ON_EDGE
    on_edge, at_vertex = near_zero.sum(axis=1) == 1, near_zero.sum(axis=1) > 1
    side = (np.argmax(near_zero[on_edge], axis=1) + 1) % 3  # the side opposite corner k runs from corner k + 1
    across = surface.topology.neighbours[triangle[on_edge], side]
    vertex = surface.triangles[triangle[at_vertex], np.argmax(bary[at_vertex], axis=1)]
    return on_edge, across, at_vertex, vertex


def pseudo_normals(
    surface: TriMesh, triangle: Int[np.ndarray, " n"], points: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Return the angle-weighted pseudo-normal (not of unit length) at `points` of `surface` that lie in `triangle`.

    Inside a triangle that is its normal, on an edge the sum of both neighbours' normals, at a vertex the sum of all
    around it weighted by their angles. It does not depend on which of the triangles that share the point was found,
    and has a positive product with the offset of every outer point whose closest point it is (Baerentzen and Aanaes,
    Signed distance computation using the angle weighted pseudonormal, 2005).
    """
    on_edge, across, at_vertex, vertex = _shared(surface, triangle, points)
    out = surface.normals[triangle].copy()
    out[on_edge] += np.where((across >= 0)[:, None], surface.normals[across], 0.0)
    out[at_vertex] = surface.angle_normals[vertex]
    return out


def least_agreeing_normals(
    surface: TriMesh,
    triangle: Int[np.ndarray, " n"],
    points: Float[np.ndarray, "n 3"],
    direction: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n 3"]:
    """Return, of the triangles that share each of `points`, the normal with the least product with `direction`.

    Which of them a search for the closest triangle finds is a matter of rounding; what holds for this normal holds for
    every searcher. `triangle` is one of them.
    """
    on_edge, across, at_vertex, vertex = _shared(surface, triangle, points)
    query = [np.arange(len(points)), np.nonzero(on_edge)[0][across >= 0]]
    candidate = [triangle, across[across >= 0]]
    start, around = surface.vertex_triangles
    many = start[vertex + 1] - start[vertex]
    query.append(np.repeat(np.nonzero(at_vertex)[0], many))
    step = np.arange(many.sum()) - np.repeat(np.cumsum(many) - many, many)
    candidate.append(around[np.repeat(start[vertex], many) + step])
    of, tri = np.concatenate(query), np.concatenate(candidate)
    product = np.einsum("ni,ni->n", surface.normals[tri], direction[of])
    order = np.lexsort((tri, product, of))
    first = order[np.diff(of[order], prepend=-1) > 0]
    return surface.normals[tri[first]]
