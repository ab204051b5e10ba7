"""Topology of meshes that have triangles beside their quads, as far as the metrics need it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Int

from drl_meshgen.mesh.topology import Topology, graph_components


@dataclass(frozen=True, eq=False)
class MixedTopology:
    """Edge incidence of quads and triangles together; faces are numbered quads first."""

    n_vertices: int
    quads: Int[np.ndarray, "m 4"]
    triangles: Int[np.ndarray, "t 3"]

    @cached_property
    def _sides(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        tail = np.concatenate([self.quads.ravel(), self.triangles.ravel()])
        head = np.concatenate([np.roll(f, -1, axis=1).ravel() for f in (self.quads, self.triangles)])
        face = np.repeat(
            np.arange(len(self.quads) + len(self.triangles)), np.r_[[4] * len(self.quads), [3] * len(self.triangles)]
        )
        return tail, head, face

    @cached_property
    def _edges(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        tail, head, _ = self._sides
        return np.unique(
            np.sort(np.c_[tail, head], axis=1), axis=0, return_inverse=True, return_counts=True
        )  # rows, edge of each side, faces at each edge

    @property
    def edge_count(self) -> Int[np.ndarray, " e"]:
        """Number of faces at each edge."""
        return self._edges[2]

    @cached_property
    def boundary_edges(self) -> Int[np.ndarray, "b 2"]:
        """Directed boundary edges."""
        rim = self.edge_count[self._edges[1].ravel()] == 1
        return np.c_[self._sides[0], self._sides[1]][rim]

    @cached_property
    def on_boundary(self) -> Bool[np.ndarray, " n"]:
        """Whether each vertex lies on the boundary."""
        return np.isin(np.arange(self.n_vertices), self.boundary_edges)

    @cached_property
    def valence(self) -> Int[np.ndarray, " n"]:
        """Number of edges at each vertex."""
        return np.bincount(self._edges[0].ravel(), minlength=self.n_vertices)

    @property
    def used(self) -> Bool[np.ndarray, " n"]:
        """Whether each vertex belongs to a face."""
        return self.valence > 0

    @property
    def euler(self) -> int:
        """Vertices - edges + faces."""
        return int(self.used.sum()) - len(self._edges[0]) + len(self.quads) + len(self.triangles)

    @cached_property
    def components(self) -> tuple[int, np.ndarray]:
        """Number of components and component of each face, joined through edges."""
        order = np.argsort(self._edges[1].ravel(), kind="stable")
        edge, face = self._edges[1].ravel()[order], self._sides[2][order]
        same = np.nonzero(edge[1:] == edge[:-1])[0]
        label = graph_components(np.c_[face[same], face[same + 1]], len(self.quads) + len(self.triangles))
        return int(label.max()) + 1, label


Outline = Topology | MixedTopology
"""What is read of either: edge_count, boundary_edges, on_boundary, valence, used, euler, components."""
