"""Strips: the second way to open a junction.

All loops but the outer one are joined by strips along a minimum spanning tree of their distances. A strip is a
four-sided patch between a stretch (mouth) of one loop, a stretch of another and two sides, which are paths of mesh
edges. What the strips leave is one ring between the outer loop and the super-loop, the closed walk along the other
loops and the sides. The corners of the strips, `4 (k - 2)` for k loops, become nodes of valence 5.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree

from drl_meshgen.decompose.cells import Cell, opened, ring_between, sides_along, submesh
from drl_meshgen.decompose.spine import Spine
from drl_meshgen.lift.harmonic import corner_weights, dirichlet, stiffness
from drl_meshgen.mesh import TriMesh

#: Widths of a strip that are tried, as shares of the shorter of its loops.
WIDTHS = (0.25, 0.15, 0.09)

#: All mouths on a loop take at most this share of it.
MOST_OF_LOOP = 0.7

#: Feet are averaged over what lies this much further from the other loop than the nearest place (share of a loop).
FOOT_BLUR = 0.1

#: The middle of a strip keeps to the plane of its ends and the normals there within about this share of its length.
LINE_TOLERANCE = 0.1

#: The sides of a strip keep their distance from its middle within about this share of its width.
SIDE_TOLERANCE = 0.2

#: Share by which what comes later is made longer, so that on symmetric meshes the order decides and not rounding.
TIE = 1e-6


@dataclass(frozen=True, eq=False)
class Strip:
    """A four-sided patch with its harmonic map `plane` to the unit square.

    `sides` are the graph edges of mouth, side, mouth, side, anti-clockwise from the corner at (0, 0).
    """

    mesh: TriMesh
    sides: tuple[int, int, int, int]
    plane: Float[np.ndarray, "v 2"]

    def nodes(self, counts: Int[np.ndarray, " e"]) -> Float[np.ndarray, "w1 l1 2"]:
        """Space nodes equally in the unit square by `counts` of the graph edges; the first index runs along mouths."""
        across, along = (np.arange(counts[e] + 1) / counts[e] for e in self.sides[:2])
        return np.stack(np.meshgrid(across, along, indexing="ij"), axis=-1)


@dataclass(frozen=True, eq=False)
class StripGraph:
    """Corners of the strips as nodes; sides, mouths and arcs between mouths as edges of `graph`.

    Only sides are flagged in `graph.edge_flags`. `quads[s]` are the edges around strip `s` (as `Strip.sides`),
    `rims[l]` those around loop `l` with the junction on the left, empty for the outer loop.
    """

    graph: Spine
    quads: tuple[tuple[int, int, int, int], ...]
    rims: tuple[tuple[int, ...], ...]


def strip_graph(
    mesh: TriMesh,
    loops: tuple[Int[np.ndarray, " n"], ...],
    distances: Float[np.ndarray, "v k"],
    outer: int,
    width: float,
) -> StripGraph | None:
    """Lay strips of `width` (see `WIDTHS`) between all loops but `outer`; None where they do not fit.

    `loops` run with the mesh on their left, `distances` are those to each loop (see `loop_distances`).
    """
    pairs = _tree(loops, distances, outer)
    along = [arc_length(mesh, loop) for loop in loops]
    degree = np.bincount(np.array(pairs).ravel(), minlength=len(loops))
    places: list[list[tuple[float, int, int]]] = [[] for _ in loops]  # (share of the loop, end of its mouth, strip)
    for s, (a, b) in enumerate(pairs):
        shorter = min(along[a][-1], along[b][-1])
        for here, there in ((a, b), (b, a)):
            half = min(width * shorter / along[here][-1], MOST_OF_LOOP / degree[here]) / 2
            foot = _foot(along[here], distances[loops[here], there], FOOT_BLUR * shorter)
            places[here] += [(foot - half, 0, s), (foot + half, 1, s)]
    mouths = [[np.empty(0, np.int64)] * 2 for _ in pairs]
    rims = []
    for l, loop in enumerate(loops):
        rim = _rim(loop, along[l], places[l])
        if rim is None:
            return None
        for s, path in rim:
            if s >= 0:
                mouths[s][0 if l == pairs[s][0] else 1] = path
        rims.append(rim)
    edges = _Edges(mesh, loops)
    paths: list[np.ndarray] = []
    quads = [[-1, 2 * s, -1, 2 * s + 1] for s in range(len(pairs))]
    for a, b in mouths:
        sides = edges.sides(a, b)
        if sides is None:
            return None
        paths += sides
    around: list[tuple[int, ...]] = []
    for l, rim in enumerate(rims):
        around.append(tuple(range(len(paths), len(paths) + len(rim))))
        for s, path in rim:
            if s >= 0:
                quads[s][0 if l == pairs[s][0] else 2] = len(paths)
            paths.append(path)
    return StripGraph(
        _graph(mesh, paths, 2 * len(pairs)), tuple((q[0], q[1], q[2], q[3]) for q in quads), tuple(around)
    )


def open_strips(
    mesh: TriMesh, strips: StripGraph, loops: tuple[Int[np.ndarray, " n"], ...], outer: int
) -> tuple[Cell, tuple[Strip, ...]] | None:
    """Open `mesh` along the sides: the ring of loop `outer` and the strips; None when anything else is left."""
    whole, origin, n, label = opened(mesh, strips.graph.edge_flags)
    if n != 1 + len(strips.quads):
        return None
    cell: Cell | None = None
    found: list[Strip | None] = [None] * len(strips.quads)
    patch = {frozenset(strips.graph.ends[q[0]] + strips.graph.ends[q[2]]): s for s, q in enumerate(strips.quads)}
    index = {v: k for k, v in enumerate(strips.graph.nodes.tolist())}
    for c in range(n):
        piece, ids = submesh(whole, np.nonzero(label == c)[0])
        there = origin[ids]
        if np.isin(there, loops[outer]).any():
            ring = ring_between(piece, there, loops[outer])
            cell = None if ring is None else Cell(ring, *sides_along(ring, strips.graph))
        elif piece.topology.euler == 1 and len(piece.topology.loops) == 1:
            s = patch.get(frozenset(index[v] for v in there.tolist() if v in index), -1)
            if s >= 0:
                found[s] = _strip(piece, there, strips, s)
    strip = tuple(one for one in found if one is not None)
    return None if cell is None or len(strip) < len(found) else (cell, strip)


def _tree(loops: tuple[np.ndarray, ...], distances: np.ndarray, outer: int) -> list[tuple[int, int]]:
    """Pairs of loops that strips join: a minimum spanning tree of the distances between all loops but `outer`."""
    inner = [l for l in range(len(loops)) if l != outer]
    gap = np.array([[distances[loops[a], b].min() + distances[loops[b], a].min() for b in inner] for a in inner])
    gap = np.triu((gap - gap.min()) / max(float(np.ptp(gap)), np.finfo(float).tiny) + 1.0, 1)
    gap[gap > 0] *= np.linspace(1, 1 + TIE, int((gap > 0).sum()))
    tree = minimum_spanning_tree(gap).tocoo()
    return sorted(
        (inner[min(a, b)], inner[max(a, b)]) for a, b in zip(tree.row.tolist(), tree.col.tolist(), strict=True)
    )


def arc_length(mesh: TriMesh, loop: np.ndarray) -> Float[np.ndarray, " n1"]:
    """Return the position of each vertex of a loop, and the loop's length at the end (model units)."""
    p = mesh.vertices[loop]
    return np.r_[0.0, np.cumsum(np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1))]


def _foot(along: np.ndarray, distance: np.ndarray, blur: float) -> float:
    """Middle of what faces the other loop, as a share of this loop."""
    weight = np.exp(-(distance - distance.min()) / blur) * (np.diff(along) + np.roll(np.diff(along), 1))
    mean = (weight * np.exp(2j * np.pi * along[:-1] / along[-1])).sum()
    return float(np.angle(mean) / (2 * np.pi)) % 1.0


def _ordered(places: list[tuple[float, int, int]]) -> list[tuple[float, int, int]]:
    """Sort the ends of mouths around a loop, from the beginning of a mouth on."""
    order = sorted((share % 1.0, end, s) for share, end, s in places)
    return order if order[0][1] == 0 else order[1:] + order[:1]


def _rim(
    loop: np.ndarray, along: np.ndarray, places: list[tuple[float, int, int]]
) -> list[tuple[int, Int[np.ndarray, " k"]]] | None:
    """Stretches of a loop between ends of mouths as (strip or -1, vertices); None when mouths meet."""
    if not places:
        return []
    order = _ordered(places)
    if any(here[1] == there[1] or (here[1] == 0 and here[2] != there[2]) for here, there in pairwise(order)):
        return None
    share = along[:-1] / along[-1]
    at = [int(np.argmin(np.abs((share - place + TIE + 0.5) % 1.0 - 0.5))) for place, _, _ in order]
    n = len(loop)
    steps = [(b - a) % n for a, b in zip(at, at[1:] + at[:1], strict=True)]
    if min(steps) < 2 or sum(steps) != n:
        return None
    stretch = [loop[np.arange(a, a + k + 1) % n] for a, k in zip(at, steps, strict=True)]
    return [(s if end == 0 else -1, path) for (_, end, s), path in zip(order, stretch, strict=True)]


class _Edges:
    """Paths of mesh edges that keep apart from the loops and from each other."""

    def __init__(self, mesh: TriMesh, loops: tuple[np.ndarray, ...]) -> None:
        self.mesh = mesh
        self.taken = np.zeros(len(mesh.vertices), bool)
        self.taken[np.concatenate(loops)] = True

    def sides(self, a: Int[np.ndarray, " k"], b: Int[np.ndarray, " l"]) -> list[Int[np.ndarray, " n"]] | None:
        """Join mouths: paths from the end of `a` to the beginning of `b` and from the end of `b` to that of `a`.

        Both keep half a mouth away from the line between the middles of the mouths, which they do not cross.
        """
        feet = [int(mouth[len(mouth) // 2]) for mouth in (a, b)]
        line = self._path(feet[0], feet[1], self._off_plane(*feet))
        if line is None:
            return None
        half = [self._length(mouth) / 2 for mouth in (a, b)]
        away = self._distance(line)
        cost = ((away - sum(half) / 2) / (SIDE_TOLERANCE * sum(half))) ** 2
        self.taken[line] = True
        found = []
        for start, stop in ((int(a[-1]), int(b[0])), (int(b[-1]), int(a[0]))):
            path = self._path(start, stop, cost)
            if path is None:
                return None
            self.taken[path] = True
            found.append(path)
        return found

    def _path(self, start: int, stop: int, cost: Float[np.ndarray, " v"]) -> Int[np.ndarray, " k"] | None:
        """Return the shortest path over vertices that are not taken, with lengths times `1 + cost`."""
        allowed = ~self.taken
        allowed[[start, stop]] = True
        _, before = dijkstra(self._graph(1 + cost, allowed), directed=False, indices=start, return_predecessors=True)
        path = [stop]
        while before[path[-1]] >= 0:
            path.append(int(before[path[-1]]))
        return np.array(path[::-1], np.int64) if path[-1] == start and len(path) > 2 else None

    def _distance(self, line: Int[np.ndarray, " k"]) -> Float[np.ndarray, " v"]:
        graph = self._graph(np.ones(len(self.taken)), np.ones(len(self.taken), bool))
        return np.asarray(dijkstra(graph, directed=False, indices=line, min_only=True))

    def _graph(self, factor: Float[np.ndarray, " v"], allowed: np.ndarray) -> csr_matrix:
        edges, n = self.mesh.topology.edges, len(factor)
        usable = allowed[edges].all(1)
        a, b = edges[usable].T
        length = (self.mesh.edge_lengths * np.linspace(1, 1 + TIE, len(edges)))[usable]
        return csr_matrix((length * (factor[a] + factor[b]) / 2, (a, b)), (n, n))

    def _length(self, path: Int[np.ndarray, " k"]) -> float:
        return float(np.linalg.norm(np.diff(self.mesh.vertices[path], axis=0), axis=1).sum())

    def _off_plane(self, start: int, stop: int) -> Float[np.ndarray, " v"]:
        """Return a cost that grows away from the plane through two vertices and the mean of their normals."""
        p = self.mesh.vertices
        chord = p[stop] - p[start]
        across = np.cross(chord, self.mesh.vertex_normals[[start, stop]].sum(0))
        scale = max(float(np.linalg.norm(across) * np.linalg.norm(chord)), np.finfo(float).tiny)
        return ((p - p[start]) @ across / scale / LINE_TOLERANCE) ** 2


def _graph(mesh: TriMesh, paths: list[np.ndarray], sides: int) -> Spine:
    """Graph of all paths; the edges of the first `sides` are flagged."""
    nodes = sorted({int(path[k]) for path in paths for k in (0, -1)})
    index = {v: k for k, v in enumerate(nodes)}
    edges, n = mesh.topology.edges, len(mesh.vertices)
    steps = np.sort(np.concatenate([np.c_[path[:-1], path[1:]] for path in paths[:sides]]), axis=1)
    flags = np.zeros(len(edges), bool)
    flags[np.searchsorted(edges[:, 0] * n + edges[:, 1], steps[:, 0] * n + steps[:, 1])] = True
    ends = tuple((index[int(path[0])], index[int(path[-1])]) for path in paths)
    return Spine(np.array(nodes, np.int64), tuple(paths), ends, flags)


def _strip(mesh: TriMesh, origin: np.ndarray, strips: StripGraph, s: int) -> Strip | None:
    """Map a disk to the unit square, its sides by arc length."""
    place = {int(v): k for k, v in enumerate(origin)}
    known, values = [], []
    steps = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    corner = np.zeros(2)
    for edge, step in zip(strips.quads[s], steps, strict=True):
        path = np.array([place.get(int(v), -1) for v in strips.graph.paths[edge]])
        if (path < 0).any():
            return None
        length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(mesh.vertices[path], axis=0), axis=1))]
        known.append(path[:-1])
        values.append(corner + step * (length[:-1] / length[-1])[:, None])
        corner = corner + step
    rim = np.concatenate(known)
    if len(rim) != mesh.topology.on_boundary.sum():
        return None
    plane = dirichlet(stiffness(mesh, corner_weights(mesh)), rim, np.concatenate(values))
    return Strip(mesh, strips.quads[s], plane)
