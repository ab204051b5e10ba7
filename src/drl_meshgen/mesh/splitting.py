"""Splitting the triangles that a curve across edges runs through."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from drl_meshgen.mesh.trimesh import TriMesh

#: Crossing points keep this share of their edge from its ends, so that no sliver is born.
CLEARANCE = 0.12


@dataclass(frozen=True, eq=False)
class Split:
    """A mesh whose crossed edges carry a new vertex each, in the order of the edges, after the old ones.

    `parent (f,)` is the old triangle of each triangle, `chords (c, 2)` the new vertices joined across a triangle.
    """

    mesh: TriMesh
    parent: Int[np.ndarray, " f"]
    chords: Int[np.ndarray, "c 2"]


def split_crossed(mesh: TriMesh, crossed: Bool[np.ndarray, " e"], share: Float[np.ndarray, " c"]) -> Split:
    """Split the triangles that a curve runs through: each has two or none of the `crossed` edges.

    The curve crosses edge `ij` (of `topology.edges`) at `v_i + share (v_j - v_i)`, kept clear of the ends.
    """
    vertices, triangles, topology = mesh.vertices, mesh.triangles, mesh.topology
    a, b = topology.edges[crossed].T
    new_id = np.full(len(crossed), -1)
    new_id[crossed] = len(vertices) + np.arange(len(a))
    t = np.clip(share, CLEARANCE, 1 - CLEARANCE)[:, None]
    points = np.vstack([vertices, vertices[a] + t * (vertices[b] - vertices[a])])

    mixed = crossed[topology.face_edges].any(axis=1)
    tri, side = triangles[mixed], topology.face_edges[mixed]
    lone = (np.argmin(crossed[side], axis=1) + 2) % 3
    row = np.arange(len(tri))
    apex, left, right = (tri[row, (lone + k) % 3] for k in range(3))
    p, q = new_id[side[row, lone]], new_id[side[row, (lone + 2) % 3]]
    short = np.linalg.norm(points[p] - points[right], axis=1) < np.linalg.norm(points[q] - points[left], axis=1)
    pieces = np.stack(
        [
            np.c_[apex, p, q],
            np.where(short[:, None], np.c_[p, left, right], np.c_[p, left, q]),
            np.where(short[:, None], np.c_[p, right, q], np.c_[q, left, right]),
        ],
        axis=1,
    )
    return Split(
        TriMesh(points, np.vstack([triangles[~mixed], pieces.reshape(-1, 3)])),
        np.r_[np.nonzero(~mixed)[0], np.repeat(np.nonzero(mixed)[0], 3)],
        np.c_[p, q],
    )


def crossing(
    start: Float[np.ndarray, " n"], end: Float[np.ndarray, " n"], level: float | Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Share of the way from `start` to `end` at which linear functions pass `level`; the middle where they are flat."""
    flat = start == end
    return np.where(flat, 0.5, (level - start) / np.where(flat, 1.0, end - start))
