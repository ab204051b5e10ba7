"""Triangulated surfaces."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh.topology import Topology, graph_components


def frozen(array: np.ndarray, dtype: type) -> np.ndarray:
    """Return a contiguous read-only copy-on-need of `array` as `dtype`."""
    out = np.ascontiguousarray(array, dtype)
    if out is array and out.flags.writeable:
        out = out.copy()
    out.setflags(write=False)
    return out


@dataclass(frozen=True, eq=False)
class TriMesh:
    """An oriented triangle mesh; anti-clockwise corners seen from the side the normals point to.

    Side `s` of a triangle runs from corner `s` to corner `s + 1` (mod 3); see `Topology`.
    """

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "f 3"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen(self.vertices, np.float64))
        object.__setattr__(self, "triangles", frozen(self.triangles, np.int64))

    @cached_property
    def topology(self) -> Topology:
        """Edges, neighbours, loops."""
        return Topology(len(self.vertices), self.triangles)

    @cached_property
    def corners(self) -> Float[np.ndarray, "f 3 3"]:
        """Corner positions of each triangle."""
        return self.vertices[self.triangles]

    @cached_property
    def _cross(self) -> Float[np.ndarray, "f 3"]:
        p = self.corners
        return np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])

    @cached_property
    def areas(self) -> Float[np.ndarray, " f"]:
        """Triangle areas."""
        return np.linalg.norm(self._cross, axis=1) / 2

    @cached_property
    def vertex_areas(self) -> Float[np.ndarray, " v"]:
        """Third of the area of the triangles around each vertex."""
        total = np.zeros(len(self.vertices))
        for k in range(3):
            total += np.bincount(self.triangles[:, k], self.areas / 3, len(total))
        return total

    @cached_property
    def normals(self) -> Float[np.ndarray, "f 3"]:
        """Unit triangle normals (zero for degenerate triangles)."""
        return self._cross / np.maximum(2 * self.areas, np.finfo(float).tiny)[:, None]

    @cached_property
    def vertex_normals(self) -> Float[np.ndarray, "v 3"]:
        """Unit vertex normals, area weighted."""
        total = np.zeros_like(self.vertices)
        for k in range(3):
            np.add.at(total, self.triangles[:, k], self._cross)
        return total / np.maximum(np.linalg.norm(total, axis=1), np.finfo(float).tiny)[:, None]

    @cached_property
    def angle_normals(self) -> Float[np.ndarray, "v 3"]:
        """Sum of the unit normals around each vertex, weighted by the triangles' angles there (not of unit length)."""
        total = np.zeros_like(self.vertices)
        p = self.corners
        for k in range(3):
            a, b = p[:, (k + 1) % 3] - p[:, k], p[:, (k + 2) % 3] - p[:, k]
            angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("fi,fi->f", a, b))
            np.add.at(total, self.triangles[:, k], angle[:, None] * self.normals)
        return total

    @cached_property
    def vertex_components(self) -> Int[np.ndarray, " v"]:
        """Component of each vertex, numbered by their smallest vertex."""
        return graph_components(self.topology.edges, len(self.vertices))

    @cached_property
    def vertex_triangles(self) -> tuple[Int[np.ndarray, " v1"], Int[np.ndarray, " 3f"]]:
        """Triangles around each vertex: those of vertex `v` are `around[start[v] : start[v + 1]]`, in rising order."""
        flat = self.triangles.ravel()
        around = np.argsort(flat, kind="stable") // 3
        start = np.r_[0, np.cumsum(np.bincount(flat, minlength=len(self.vertices)))]
        return start, around

    @cached_property
    def edge_lengths(self) -> Float[np.ndarray, " e"]:
        """Length of each edge of `topology.edges`."""
        e = self.topology.edges
        return np.linalg.norm(self.vertices[e[:, 1]] - self.vertices[e[:, 0]], axis=1)

    @property
    def area(self) -> float:
        """Total area."""
        return float(self.areas.sum())

    @cached_property
    def diagonal(self) -> float:
        """Diagonal of the bounding box: the length every tolerance is relative to."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))
