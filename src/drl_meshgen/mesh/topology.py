"""Edges, loops and components of polygon meshes with a fixed number of corners."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components


def graph_components(edges: Int[np.ndarray, "e 2"], n: int) -> Int[np.ndarray, " n"]:
    """Component of each of `n` nodes of an undirected graph, numbered by their smallest node."""
    graph = coo_matrix((np.ones(len(edges), np.int8), (edges[:, 0], edges[:, 1])), (n, n))
    return connected_components(graph, directed=False)[1]


@dataclass(frozen=True, eq=False)
class Topology:
    """Edge incidence of `m` faces with `k` corners over `n` vertices.

    Side `s` of a face runs from corner `s` to corner `s + 1` (mod k). Edges are sorted vertex pairs in
    lexicographic order, so every derived array depends on the faces alone.
    """

    n_vertices: int
    faces: Int[np.ndarray, "m k"]

    @cached_property
    def _incidence(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        k = self.faces.shape[1]
        tail, head = self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()
        low, high = np.minimum(tail, head), np.maximum(tail, head)
        code, inverse, count = np.unique(
            low * np.int64(self.n_vertices) + high, return_inverse=True, return_counts=True
        )
        edges = np.c_[code // self.n_vertices, code % self.n_vertices]
        return edges, inverse.reshape(-1, k), count

    @property
    def edges(self) -> Int[np.ndarray, "e 2"]:
        """Sorted vertex pairs."""
        return self._incidence[0]

    @property
    def face_edges(self) -> Int[np.ndarray, "m k"]:
        """Edge id of each side."""
        return self._incidence[1]

    @property
    def edge_count(self) -> Int[np.ndarray, " e"]:
        """Number of faces at each edge: 1 on the boundary, 2 inside, more where non-manifold."""
        return self._incidence[2]

    @cached_property
    def edge_faces(self) -> Int[np.ndarray, "e 2"]:
        """The (at most) two faces of each edge, -1 where there is none. Manifold meshes only."""
        flat = self.face_edges.ravel()
        order = np.argsort(flat, kind="stable")
        start = np.searchsorted(flat[order], np.arange(len(self.edges)))
        face = order // self.faces.shape[1]
        second = np.where(self.edge_count > 1, face[np.minimum(start + 1, len(face) - 1)], -1)
        return np.c_[face[start], second]

    @cached_property
    def neighbours(self) -> Int[np.ndarray, "m k"]:
        """Face across each side, -1 at the boundary. Manifold meshes only."""
        pair = self.edge_faces[self.face_edges]
        own = np.arange(len(self.faces))[:, None]
        return np.where(pair[..., 0] == own, pair[..., 1], pair[..., 0])

    @cached_property
    def boundary_edges(self) -> Int[np.ndarray, "b 2"]:
        """Directed boundary edges (the face on the left), in face order."""
        on_boundary = self.edge_count[self.face_edges] == 1
        return np.c_[self.faces[on_boundary], np.roll(self.faces, -1, axis=1)[on_boundary]]

    @cached_property
    def on_boundary(self) -> np.ndarray:
        """Boolean per vertex."""
        flag = np.zeros(self.n_vertices, bool)
        flag[self.boundary_edges.ravel()] = True
        return flag

    @cached_property
    def loops(self) -> tuple[Int[np.ndarray, " n"], ...]:
        """Boundary loops as vertex sequences with the mesh on the left, longest first, then by smallest vertex.

        Each loop starts at its smallest vertex. Needs every boundary vertex to have one outgoing boundary edge.
        """
        follow = dict(self.boundary_edges.tolist())
        loops = []
        for start in sorted(follow):
            if start not in follow:
                continue
            loop, v = [], start
            while v in follow:
                loop.append(v)
                v = follow.pop(v)
            loops.append(np.array(loop, np.int64))
        return tuple(sorted(loops, key=lambda loop: (-len(loop), int(loop[0]))))

    @cached_property
    def valence(self) -> Int[np.ndarray, " n"]:
        """Number of edges at each vertex."""
        return np.bincount(self.edges.ravel(), minlength=self.n_vertices)

    @cached_property
    def used(self) -> np.ndarray:
        """Boolean per vertex: belongs to a face."""
        flag = np.zeros(self.n_vertices, bool)
        flag[self.faces.ravel()] = True
        return flag

    @cached_property
    def euler(self) -> int:
        """Vertices - edges + faces (vertices without a face are not counted)."""
        return int(self.used.sum()) - len(self.edges) + len(self.faces)

    @cached_property
    def components(self) -> tuple[int, np.ndarray]:
        """Number of components and component of each face, joined through edges."""
        label = graph_components(self.edge_faces[self.edge_count > 1], len(self.faces))
        return int(label.max(initial=-1)) + 1, label

    @cached_property
    def misoriented_edges(self) -> np.ndarray:
        """Ids of two-face edges that both faces run through in the same direction."""
        tail, head = self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()
        sign = np.bincount(self.face_edges.ravel(), weights=np.where(tail < head, 1, -1), minlength=len(self.edges))
        return np.nonzero((self.edge_count == 2) & (sign != 0))[0]
