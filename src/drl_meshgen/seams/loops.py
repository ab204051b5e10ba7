"""Short non-separating loops along edges, by trees and cotrees (Erickson and Whittlesey 2005, greedy bases)."""

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree

from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.curves import closed_length
from drl_meshgen.mesh.topology import Topology, graph_components

Loop = Int[np.ndarray, " n"]


class LoopFinder:
    """Loops of one connected mesh that keep off its boundary."""

    def __init__(self, mesh: TriMesh) -> None:
        topology = mesh.topology
        self.mesh = mesh
        on_boundary = topology.on_boundary
        self.inner = ~on_boundary[topology.edges].any(axis=1)
        self.graph = weighted(topology.edges[self.inner], mesh.edge_lengths[self.inner], len(mesh.vertices))
        self.reachable = topology.used & ~on_boundary
        self.dual = _capped_dual(topology)

    def sources(self, count: int) -> list[int]:
        """Vertices far from one another, the first far from the middle; none on the boundary."""
        p = self.mesh.vertices
        away = np.where(self.reachable, np.linalg.norm(p - p[self.reachable].mean(axis=0), axis=1), -1.0)
        chosen: list[int] = []
        while len(chosen) < count and away.max() > 0:
            chosen.append(int(np.argmax(away)))
            distance = dijkstra(self.graph, directed=False, indices=chosen[-1])
            away = np.where(np.isfinite(distance), np.minimum(away, distance) if chosen[1:] else distance, 0.0)
        return chosen

    def through(self, source: int) -> list[Loop]:
        """Return the loops that the shortest paths from `source` close, without their common part.

        On a surface of genus g they are 2 g, and none of them separates it.
        """
        edges = self.mesh.topology.edges
        distance, before = dijkstra(self.graph, directed=False, indices=source, return_predecessors=True)
        a, b = edges.T
        in_tree = self.inner & ((before[a] == b) | (before[b] == a))
        length = distance[a] + distance[b] + self.mesh.edge_lengths
        rank = np.empty(len(edges), np.int64)
        rank[np.lexsort((np.arange(len(edges)), -np.where(self.inner, length, np.inf)))] = np.arange(len(edges))
        free = ~in_tree
        left = free & self.inner & np.isfinite(length)
        left[_spanning(self.dual[free], rank[free], np.nonzero(free)[0])] = False
        found = [self._closed(before, int(i), int(j)) for i, j in edges[left]]
        return [loop for loop in found if len(loop) > 2]

    def has(self, loop: Loop) -> bool:
        """Whether all sides of a loop are edges of the mesh and none of its vertices is on the boundary."""
        topology = self.mesh.topology
        pairs = np.c_[loop, np.roll(loop, -1)]
        ids = np.minimum(edge_ids(topology, pairs), len(topology.edges) - 1)
        return bool(self.reachable[loop].all() and (topology.edges[ids] == np.sort(pairs, axis=1)).all())

    @staticmethod
    def _closed(before: np.ndarray, i: int, j: int) -> Loop:
        one, two = [i], [j]
        for path in (one, two):
            while before[path[-1]] >= 0:
                path.append(int(before[path[-1]]))
        while len(one) > 1 and len(two) > 1 and one[-2] == two[-2]:
            one.pop()
            two.pop()
        return np.array(one + two[-2::-1] if one[-1] == two[-1] else [], np.int64)


def thinnest_loop(mesh: TriMesh, known: list[Loop], sources: int) -> tuple[Loop | None, list[Loop]]:
    """Find a short loop that does not separate the mesh, and the other loops found on the way, shortest first.

    The search starts from the `known` loops that are still there, or else from `sources` places; then the best loop is
    shortened from its own vertices. None where there is no loop off the boundary.
    """
    finder = LoopFinder(mesh)
    loops = [loop for loop in known if finder.has(loop)]
    best = next((loop for loop in loops if not separates(mesh, loop)), None)
    if best is None:
        loops = _by_length(mesh, [loop for source in finder.sources(sources) for loop in finder.through(source)])
        best = next((loop for loop in loops if not separates(mesh, loop)), None)
    if best is None:
        return None, loops
    for _ in range(3):
        length = closed_length(mesh.vertices[best])
        found = [loop for k in (0, len(best) // 2) for loop in finder.through(int(best[k]))]
        loops = _by_length(mesh, loops + found)
        best = next(loop for loop in loops if not separates(mesh, loop))
        if closed_length(mesh.vertices[best]) > 0.99 * length:
            break
    return best, loops


def _by_length(mesh: TriMesh, loops: list[Loop]) -> list[Loop]:
    return sorted(loops, key=lambda loop: (closed_length(mesh.vertices[loop]), len(loop), int(loop.min())))


def separates(mesh: TriMesh, loop: Loop) -> bool:
    """Whether the loop of edges divides the (connected) mesh."""
    topology = mesh.topology
    flags = np.zeros(len(topology.edges), bool)
    flags[edge_ids(topology, np.c_[loop, np.roll(loop, -1)])] = True
    pair = topology.edge_faces[(topology.edge_count == 2) & ~flags]
    return count_parts(pair, len(mesh.triangles)) > 1


def edge_ids(topology: Topology, pairs: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, " n"]:
    """Ids of the edges between the vertices of each pair."""
    n = topology.n_vertices
    return np.searchsorted(topology.edges @ (n, 1), np.sort(pairs, axis=1) @ (n, 1))


def count_parts(pairs: Int[np.ndarray, "e 2"], n: int) -> int:
    """Count the connected components of a graph of `n` nodes."""
    return int(graph_components(pairs, n).max(initial=-1)) + 1


def weighted(pairs: Int[np.ndarray, "e 2"], weight: Float[np.ndarray, " e"], n: int) -> csr_matrix:
    """Graph of `n` nodes with weighted edges."""
    return csr_matrix((weight, (pairs[:, 0], pairs[:, 1])), (n, n))


def _capped_dual(topology: Topology) -> Int[np.ndarray, "e 2"]:
    """Faces at each edge; the far side of a boundary edge is one more node for each boundary loop."""
    cap = np.full(topology.n_vertices, -1)
    for n, loop in enumerate(topology.loops):
        cap[loop] = len(topology.faces) + n
    pair = topology.edge_faces.copy()
    outer = pair[:, 1] < 0
    pair[outer, 1] = cap[topology.edges[outer, 0]]
    return pair


def _spanning(
    pairs: Int[np.ndarray, "e 2"], rank: Int[np.ndarray, " e"], ids: Int[np.ndarray, " e"]
) -> Int[np.ndarray, " t"]:
    """Ids of the edges of the spanning tree of lowest ranks."""
    n = int(pairs.max()) + 1
    order = np.argsort(rank)
    code = np.sort(pairs[order], axis=1) @ (n, 1)
    order = order[np.sort(np.unique(code, return_index=True)[1])]
    tree = minimum_spanning_tree(weighted(pairs[order], np.arange(1.0, len(order) + 1), n))
    return ids[order[tree.data.astype(np.int64) - 1]]
