"""Spine of a junction: the pruned cut locus of its loops.

Collapsing the region from all loops at once (free edge with its only triangle, nearest first) leaves a graph of the
region's homotopy type, so its complement is one ring per loop. The collapse is a spanning forest of the dual graph
rooted at the loops; taking the minimum spanning tree for the distance at the crossed edges leaves the spine on the
ridges of the distance.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix, diags
from scipy.sparse.csgraph import minimum_spanning_tree

from drl_meshgen.lift.harmonic import corner_weights, factorised, stiffness
from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.curves import closed_length


@dataclass(frozen=True, eq=False)
class Spine:
    """Graph on mesh vertices. `paths[e]` runs from node `ends[e][0]` to `ends[e][1]` (indices into `nodes`)."""

    nodes: Int[np.ndarray, " n"]
    paths: tuple[Int[np.ndarray, " k"], ...]
    ends: tuple[tuple[int, int], ...]
    edge_flags: np.ndarray

    @property
    def degrees(self) -> Int[np.ndarray, " n"]:
        """Number of path ends at each node; `sum(degree - 2) = 2 (k - 2) + 4 g` for k loops and genus g."""
        return np.bincount(np.array(self.ends, np.int64).ravel(), minlength=len(self.nodes))


def loop_distances(mesh: TriMesh, loops: tuple[Int[np.ndarray, " n"], ...]) -> Float[np.ndarray, "v k"]:
    """Smooth distance to each of `k` loops (model units).

    Varadhan's formula `-s log(w / w_loop)` with `(M + s^2 L) w = source on the loop`, one factorisation for all.
    """
    matrix = stiffness(mesh, corner_weights(mesh))
    mass = mesh.vertex_areas
    scale = float(np.median([closed_length(mesh.vertices[loop]) for loop in loops])) / 12
    source = np.zeros((len(mass), len(loops)))
    for n, loop in enumerate(loops):
        source[loop, n] = 1.0
    w = np.maximum(factorised((diags(mass) + scale**2 * matrix).tocsc()).solve(source), 1e-300)
    level = np.array([np.exp(np.log(w[loop, n]).mean()) for n, loop in enumerate(loops)])
    return -scale * np.log(w / level)


def nearest_distance(
    mesh: TriMesh,
    loops: tuple[Int[np.ndarray, " n"], ...],
    distances: Float[np.ndarray, "v k"],
    exponent: float,
) -> Float[np.ndarray, " v"]:
    """Distance to the nearest loop, each divided by (loop length) ** `exponent`; least on the loops themselves.

    An exponent of 0 gives the cut locus proper; 1 leaves more room to long loops.
    """
    lengths = np.array([closed_length(mesh.vertices[loop]) for loop in loops])
    distance = (distances / (lengths / lengths.max()) ** exponent).min(1)
    distance[np.concatenate(loops)] = distance.min() - 2 * np.ptp(distance)  # what touches a loop is collapsed first
    return distance


def spine(mesh: TriMesh, distance: Float[np.ndarray, " v"]) -> Spine:
    """Collapse `mesh` from all its loops, nearest to them first, and prune what dangles."""
    topology = mesh.topology
    edges, faces = topology.edges, len(mesh.triangles)
    rank = np.empty(len(edges))
    height = distance[edges].mean(1)
    rank[np.lexsort((np.arange(len(edges)), height))] = np.arange(1, len(edges) + 1)
    inner = topology.edge_count == 2
    rank[~inner] = rank[~inner] / (len(edges) + 1)  # loops first
    pair = topology.edge_faces.copy()
    pair[~inner, 1] = faces  # one root stands for the outside of every loop
    low, high = pair.min(1), pair.max(1)
    # several loop edges of one triangle join the same pair: the first counts
    order = np.lexsort((rank, high, low))
    first = np.r_[True, (np.diff(low[order]) != 0) | (np.diff(high[order]) != 0)]
    kept = order[first]
    graph = coo_matrix((rank[kept], (low[kept], high[kept])), (faces + 1, faces + 1)).tocsr()
    tree = minimum_spanning_tree(graph).tocoo()
    crossed = np.zeros(len(edges), bool)
    at = coo_matrix((kept + 1, (low[kept], high[kept])), (faces + 1, faces + 1)).tocsr()
    crossed[np.asarray(at[np.minimum(tree.row, tree.col), np.maximum(tree.row, tree.col)]).ravel() - 1] = True
    return _graph(edges, _pruned(edges, ~crossed, len(mesh.vertices)))


def _pruned(edges: np.ndarray, keep: np.ndarray, n: int) -> np.ndarray:
    left = np.nonzero(keep)[0]
    while True:
        one, two = edges[left].T
        degree = np.bincount(one, minlength=n) + np.bincount(two, minlength=n)
        tied = (degree[one] > 1) & (degree[two] > 1)
        if tied.all():
            pruned = np.zeros(len(keep), bool)
            pruned[left] = True
            return pruned
        left = left[tied]


def _graph(edges: np.ndarray, keep: np.ndarray) -> Spine:
    around: dict[int, list[int]] = {}
    for a, b in edges[keep].tolist():
        around.setdefault(a, []).append(b)
        around.setdefault(b, []).append(a)
    nodes = sorted(v for v, near in around.items() if len(near) > 2)
    index = {v: i for i, v in enumerate(nodes)}
    paths, ends, seen = [], [], set()
    for start in nodes:
        for ahead in sorted(around[start]):
            if (start, ahead) in seen:
                continue
            path = [start, ahead]
            while path[-1] not in index:
                one, two = around[path[-1]]
                path.append(two if one == path[-2] else one)
            seen |= {(path[0], path[1]), (path[-1], path[-2])}
            paths.append(np.array(path, np.int64))
            ends.append((index[path[0]], index[path[-1]]))
    return Spine(np.array(nodes, np.int64), tuple(paths), tuple(ends), keep)
