"""Cutting a surface along isocontours of a vertex function."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.topology import Topology

#: Crossing points keep this share of their edge from its ends, so that no sliver is born.
CLEARANCE = 0.12


@dataclass(frozen=True, eq=False)
class CutSurface:
    """A refined surface that remembers where it came from.

    `parent (f,)` is the original triangle of each triangle, `depth (v,)` the function (equal to the level on a
    contour), `contour (v,)` the contour a vertex was made for, -1 elsewhere.
    """

    mesh: TriMesh
    depth: Float[np.ndarray, " v"]
    parent: Int[np.ndarray, " f"]
    contour: Int[np.ndarray, " v"]

    @staticmethod
    def whole(surface: TriMesh, depth: Float[np.ndarray, " v"]) -> "CutSurface":
        """Return the surface before the first cut."""
        return CutSurface(surface, depth, np.arange(len(surface.triangles)), np.full(len(surface.vertices), -1))


def cut(surface: CutSurface, inside: np.ndarray, level: float, contour: int) -> CutSurface:
    """Split every triangle that has corners both in and out of `inside (v,)` (bool) where depth passes `level`.

    The crossing of edge `ij` is `v_i + (level - f_i) / (f_j - f_i) (v_j - v_i)` (eq. 9), kept clear of the ends.
    """
    vertices, triangles = surface.mesh.vertices, surface.mesh.triangles
    edges = surface.mesh.topology.edges
    crossed = inside[edges[:, 0]] != inside[edges[:, 1]]
    a, b = edges[crossed].T
    fa, fb = surface.depth[a], surface.depth[b]
    gap = np.where(fa == fb, 1.0, fb - fa)
    t = np.clip(np.where(fa == fb, 0.5, (level - fa) / gap), CLEARANCE, 1 - CLEARANCE)
    new_id = np.full(len(edges), -1)
    new_id[crossed] = len(vertices) + np.arange(len(a))

    mixed = inside[triangles].sum(1) % 3 != 0
    tri = triangles[mixed]
    flag = inside[tri]
    lone = np.argmax(flag == (flag.sum(1) == 1)[:, None], axis=1)
    row = np.arange(len(tri))
    side = surface.mesh.topology.face_edges[mixed]
    apex, left, right = (tri[row, (lone + k) % 3] for k in range(3))
    p, q = new_id[side[row, lone]], new_id[side[row, (lone + 2) % 3]]
    points = np.vstack([vertices, vertices[a] + t[:, None] * (vertices[b] - vertices[a])])
    short = np.linalg.norm(points[p] - points[right], axis=1) < np.linalg.norm(points[q] - points[left], axis=1)
    pieces = np.stack(
        [
            np.c_[apex, p, q],
            np.where(short[:, None], np.c_[p, left, right], np.c_[p, left, q]),
            np.where(short[:, None], np.c_[p, right, q], np.c_[q, left, right]),
        ],
        axis=1,
    )
    return CutSurface(
        TriMesh(points, np.vstack([triangles[~mixed], pieces.reshape(-1, 3)])),
        np.r_[surface.depth, np.full(len(a), level)],
        np.r_[surface.parent[~mixed], np.repeat(surface.parent[mixed], 3)],
        np.r_[surface.contour, np.full(len(a), contour)],
    )


def midpoint_refined(mesh: TriMesh) -> TriMesh:
    """Split every triangle in four at its edge midpoints; old vertices keep their ids."""
    topology: Topology = mesh.topology
    middle = mesh.vertices[topology.edges].mean(1)
    m = topology.face_edges + len(mesh.vertices)
    t = mesh.triangles
    fine = np.stack(
        [
            np.c_[t[:, 0], m[:, 0], m[:, 2]],
            np.c_[t[:, 1], m[:, 1], m[:, 0]],
            np.c_[t[:, 2], m[:, 2], m[:, 1]],
            np.c_[m[:, 0], m[:, 1], m[:, 2]],
        ],
        axis=1,
    )
    return TriMesh(np.vstack([mesh.vertices, middle]), fine.reshape(-1, 3))
