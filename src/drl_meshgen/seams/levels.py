"""Smooth closed curves: level sets of functions with values on a circle, or of plain functions."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.csgraph import dijkstra

from drl_meshgen.lift.harmonic import corner_weights, factorised, jump_load, stiffness
from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.cutgraph import corners_left_of
from drl_meshgen.mesh.splitting import CLEARANCE, crossing
from drl_meshgen.mesh.topology import graph_components
from drl_meshgen.seams.loops import Loop, count_parts, weighted


@dataclass(frozen=True, eq=False)
class EdgeCurve:
    """A closed curve across edges: `crossed (e,)` are those of the topology, `share` where it crosses each of them."""

    crossed: Bool[np.ndarray, " e"]
    share: Float[np.ndarray, " c"]
    length: float


@dataclass(frozen=True, eq=False)
class CircleFunction:
    """A function with values modulo 1, continuous but for whole numbers.

    In the triangle that an edge is taken from, its ends have the values `value (v,)` + `turns (e, 2)`.
    """

    value: Float[np.ndarray, " v"]
    turns: Int[np.ndarray, "e 2"]

    def level(self, mesh: TriMesh, level: float) -> list[EdgeCurve]:
        """Return the closed curves where the function is `level` modulo 1; none where an edge is too long to tell."""
        topology = mesh.topology
        edges = topology.edges
        floor = np.floor(self.value - level)
        whole = floor[edges] + self.turns
        crossed = whole[:, 0] != whole[:, 1]
        if (np.abs(whole[:, 1] - whole[:, 0]) > 1).any():
            return []
        ids = np.nonzero(crossed)[0]
        a, b = edges[ids].T
        ends = self.value[edges[ids]] - level + self.turns[ids]
        share = np.clip(crossing(ends[:, 0], ends[:, 1], whole[ids].max(axis=1)), CLEARANCE, 1 - CLEARANCE)
        points = mesh.vertices[a] + share[:, None] * (mesh.vertices[b] - mesh.vertices[a])
        through = crossed[topology.face_edges]
        number = np.cumsum(crossed) - 1
        mixed = through.any(axis=1)
        chords = number[topology.face_edges[mixed][through[mixed]]].reshape(-1, 2)
        label = graph_components(chords, len(ids))
        n = int(label.max(initial=-1)) + 1
        length = np.bincount(
            label[chords[:, 0]], np.linalg.norm(points[chords[:, 0]] - points[chords[:, 1]], axis=1), n
        )
        curves = []
        for k in range(n):
            own = np.zeros(len(edges), bool)
            own[ids[label == k]] = True
            curves.append(EdgeCurve(own, share[label == k], float(length[k])))
        return curves


def circle_function(mesh: TriMesh, loop: Loop) -> CircleFunction:
    """Harmonic function that grows by 1 on every way through `loop`, on average 0 on it, constant on boundary loops.

    Each of its level sets is a sum of closed curves homologous to `loop`. The constants are such that no flux enters.
    """
    topology = mesh.topology
    offset = corners_left_of(topology, loop, closed=True)
    weights = corner_weights(mesh)
    unknown = np.arange(len(mesh.vertices))
    for boundary in topology.loops:
        unknown[boundary] = boundary[0]
    unknown = np.unique(unknown, return_inverse=True)[1]
    n = len(mesh.vertices)
    merge = coo_matrix((np.ones(n), (np.arange(n), unknown)), (n, int(unknown.max()) + 1)).tocsc()
    matrix: csc_matrix = (merge.T @ stiffness(mesh, weights) @ merge).tocsc()
    load = merge.T @ jump_load(mesh, weights, offset.astype(float))
    value = np.zeros(len(load))
    value[1:] = factorised(matrix[1:, 1:].tocsc()).solve(load[1:])
    value = value[unknown] - value[unknown[loop]].mean()
    first = np.empty(len(topology.edges), np.int64)
    flat = topology.face_edges.ravel()
    first[flat[::-1]] = np.arange(len(flat))[::-1]
    face, side = first // 3, first % 3
    turns = np.c_[offset[face, side], offset[face, (side + 1) % 3]].astype(np.int64)
    swap = mesh.triangles[face, side] != topology.edges[:, 0]
    return CircleFunction(value, np.where(swap[:, None], turns[:, ::-1], turns))


def smooth_loop(mesh: TriMesh, loop: Loop, levels: int, nodes: int) -> EdgeCurve | None:
    """Best closed curve among the level sets of the harmonic function through `loop`.

    That is the shortest one with at least `nodes` nodes that does not separate the mesh and keeps off the boundary; to
    come nearer to it than a quarter of the length counts as up to twice the length. None where no level will do.
    """
    function = circle_function(mesh, loop)
    edges = mesh.topology.edges
    rim = np.nonzero(mesh.topology.on_boundary)[0]
    away = np.full(len(mesh.vertices), np.inf)
    if len(rim):
        graph = weighted(edges, mesh.edge_lengths, len(mesh.vertices))
        away = dijkstra(graph, directed=False, indices=rim, min_only=True)
    found = []
    for k in range(levels):
        for curve in function.level(mesh, k / levels):
            room = float(away[edges[curve.crossed]].min())
            if room > 0 and len(curve.share) >= nodes:
                found.append((curve.length * (1 + max(0.0, 1 - 4 * room / curve.length)), len(found), curve))
    for _, _, curve in sorted(found, key=lambda item: item[:2]):
        if count_parts(edges[~curve.crossed], len(mesh.vertices)) == 1 + int((~mesh.topology.used).sum()):
            return curve
    return None
