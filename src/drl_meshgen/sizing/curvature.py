"""Curvature of a triangulated surface."""

import numpy as np
from jaxtyping import Float
from scipy.sparse import diags

from drl_meshgen.lift.harmonic import corner_weights, factorised, stiffness
from drl_meshgen.mesh import TriMesh


def largest_curvature(surface: TriMesh, blur: float) -> Float[np.ndarray, " v"]:
    """Larger absolute principal curvature at each vertex (1 / model unit), blurred over about the length `blur`.

    Per triangle, the shape operator that takes its edges to the differences of the vertex normals in the least-squares
    sense (Rusinkiewicz, *Estimating curvatures and their derivatives on triangle meshes*, 3DPVT 2004). Its square is
    averaged, so that small sharp features count; the blur is one implicit step of the heat flow.
    """
    p, normal = surface.corners, surface.vertex_normals[surface.triangles]
    edge = np.roll(p, -1, axis=1) - p
    turn = np.roll(normal, -1, axis=1) - normal
    first = edge[:, 0] / np.maximum(np.linalg.norm(edge[:, 0], axis=1), np.finfo(float).tiny)[:, None]
    frame = np.stack([first, np.cross(surface.normals, first)], axis=1)
    e, t = np.einsum("fki,fai->fka", edge, frame), np.einsum("fki,fai->fka", turn, frame)
    # unknowns (a, b, c) of the symmetric operator [[a, b], [b, c]], two equations per side
    zero = np.zeros(e.shape[:2])
    rows = np.concatenate([np.stack([e[..., 0], e[..., 1], zero], -1), np.stack([zero, e[..., 0], e[..., 1]], -1)], 1)
    wanted = np.concatenate([t[..., 0], t[..., 1]], axis=1)
    normal_matrix = np.einsum("fka,fkb->fab", rows, rows)
    ridge = 1e-9 * np.trace(normal_matrix, axis1=1, axis2=2) + np.finfo(float).tiny
    right = np.einsum("fka,fk->fa", rows, wanted)
    a, b, c = np.linalg.solve(normal_matrix + ridge[:, None, None] * np.eye(3), right[..., None])[..., 0].T
    squared = (np.abs(a + c) / 2 + np.hypot((a - c) / 2, b)) ** 2
    load = np.bincount(surface.triangles.ravel(), np.repeat(surface.areas * squared / 3, 3), len(surface.vertices))
    mass = np.bincount(surface.triangles.ravel(), np.repeat(surface.areas / 3, 3), len(surface.vertices))
    matrix = diags(mass) + blur**2 * stiffness(surface, corner_weights(surface))
    return np.sqrt(np.maximum(factorised(matrix.tocsc()).solve(load), 0))
