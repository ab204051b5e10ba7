"""Cutting a surface along isocontours of a vertex function."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

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


def cut(surface: CutSurface, inside: np.ndarray, level: float, contour: int) -> CutSurface:
    """Split every triangle that has corners both in and out of `inside (v,)` (bool) where depth passes `level`.

    The crossing of edge `ij` is `v_i + (level - f_i) / (f_j - f_i) (v_j - v_i)` (eq. 9), kept clear of the ends.
    """
    edges = surface.mesh.topology.edges
    crossed = inside[edges[:, 0]] != inside[edges[:, 1]]
    a, b = edges[crossed].T
    share = crossing(surface.depth[a], surface.depth[b], level)
    split = split_crossed(surface.mesh, crossed, share)
    return CutSurface(
        split.mesh,
        np.r_[surface.depth, np.full(len(share), level)],
        surface.parent[split.parent],
        np.r_[surface.contour, np.full(len(share), contour)],
    )


def crossing(
    start: Float[np.ndarray, " n"], end: Float[np.ndarray, " n"], level: float | Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Share of the way from `start` to `end` at which linear functions pass `level`; the middle where they are flat."""
    flat = start == end
    return np.where(flat, 0.5, (level - start) / np.where(flat, 1.0, end - start))


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
