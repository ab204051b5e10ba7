"""Sheets that share edges or vertices, taken apart so that every edge has one or two triangles.

A side `3 f + s` runs from corner `s` to corner `s + 1` of triangle `f`. Positions are in units where the
bounding-box diagonal is 1.
"""

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh.topology import Topology, graph_components

Triangles = Int[np.ndarray, "m 3"]
Points = Float[np.ndarray, "n 3"]
Pairs = Int[np.ndarray, "p 2"]

_AGREEMENT = 1.5  # what equal orientation is worth beside straightness, which lies between -1 and 1
_FOLDED = -0.95  # straightness of a fold of 18 degrees: closer triangles lie on each other


def manifold_pairs(topology: Topology) -> Pairs:
    """Sides joined at edges of two triangles."""
    order = np.argsort(topology.face_edges.ravel(), kind="stable")
    order = order[topology.edge_count[topology.face_edges.ravel()[order]] == 2]
    return order.reshape(-1, 2)


def crowded_pairs(points: Points, triangles: Triangles, topology: Topology) -> Pairs:
    """Sides to be joined at edges of three or more triangles, so that whole sheets run on.

    The patches that the crowded edges bound are matched, not single triangles: for each pair of patches the mean,
    over the edges they share, of straightness (1: in one plane, -1: folded on each other) and of agreeing
    orientation; the best matched first. Sides that find no partner stay free.
    """
    sides = np.nonzero(topology.edge_count[topology.face_edges.ravel()] > 2)[0]
    if len(sides) == 0:
        return np.zeros((0, 2), np.int64)
    edge = topology.face_edges.ravel()[sides]
    order = np.argsort(edge, kind="stable")
    sides, edge = sides[order], edge[order]
    first, second = _all_pairs(edge)
    a, b = sides[first], sides[second]
    inwards, forward = _directions(points, triangles, topology, sides)
    straight = -np.einsum("ni,ni->n", inwards[first], inwards[second])
    score = straight + _AGREEMENT * (forward[first] != forward[second])
    patch, area = _patches(points, triangles, topology)
    p, q = np.sort(np.c_[patch[a // 3], patch[b // 3]], axis=1).T
    length = np.linalg.norm(np.diff(points[topology.edges[edge[first]]], axis=1)[:, 0], axis=1)
    group = np.unique(p * (patch.max() + 1) + q, return_inverse=True)[1]
    weight = np.maximum(length, np.finfo(float).tiny)
    mean = (np.bincount(group, weight * score) / np.bincount(group, weight))[group]
    order = np.lexsort((b, a, -score.round(9), group, -np.minimum(area[p], area[q]), p != q, -mean.round(6)))
    used = np.zeros(3 * len(triangles), bool)
    pairs = []
    for k in order[straight[order] > _FOLDED].tolist():
        if not used[a[k]] and not used[b[k]]:
            used[a[k]] = used[b[k]] = True
            pairs.append((a[k], b[k]))
    return np.array(pairs, np.int64).reshape(-1, 2)


def _all_pairs(group: Int[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of positions within runs of equal, sorted `group`."""
    end = np.searchsorted(group, group, side="right")
    later = end - np.arange(len(group)) - 1
    first = np.repeat(np.arange(len(group)), later)
    start = np.repeat(np.cumsum(later) - later, later)
    return first, first + 1 + np.arange(len(first)) - start


def _directions(points: Points, triangles: Triangles, topology: Topology, sides: np.ndarray) -> tuple:
    """Per side: the unit vector from the edge into the triangle, and whether it runs along the sorted edge."""
    f, s = sides // 3, sides % 3
    tail, head, apex = (triangles[f, (s + k) % 3] for k in range(3))
    low, high = topology.edges[topology.face_edges[f, s]].T
    along = points[high] - points[low]
    along /= np.maximum(np.linalg.norm(along, axis=1), np.finfo(float).tiny)[:, None]
    inwards = points[apex] - points[low]
    inwards -= np.einsum("ni,ni->n", inwards, along)[:, None] * along
    inwards /= np.maximum(np.linalg.norm(inwards, axis=1), np.finfo(float).tiny)[:, None]
    return inwards, tail < head


def _patches(points: Points, triangles: Triangles, topology: Topology) -> tuple[np.ndarray, np.ndarray]:
    """Patch of each triangle, joined through edges of two triangles, and area of each patch."""
    faces = manifold_pairs(topology) // 3
    patch = graph_components(faces, len(triangles))
    p = points[triangles]
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1) / 2
    return patch, np.bincount(patch, weights=area)


def split_fans(n_points: int, triangles: Triangles, pairs: Pairs) -> tuple[Triangles, Int[np.ndarray, " n2"], int]:
    """Give each fan of triangles around a vertex, connected through the given pairs of sides, its own vertex.

    Returns the triangles, the source of each vertex (old vertices first) and the number of copies.
    """
    corner, side, other = triangles.ravel(), pairs[:, 0], pairs[:, 1]
    links = []
    for end in (side, _following(side)):
        match = np.where(corner[other] == corner[end], other, _following(other))
        links.append(np.c_[end, match])
    link = np.vstack(links)
    fan = graph_components(link, len(corner))
    n_fans = int(fan.max(initial=-1)) + 1
    if n_fans == len(np.unique(corner)):
        return triangles, np.arange(n_points), 0
    vertex_of_fan = np.empty(n_fans, np.int64)
    vertex_of_fan[fan] = corner
    _, first_corner = np.unique(fan, return_index=True)
    order = np.argsort(first_corner)
    _, first_fan = np.unique(vertex_of_fan[order], return_index=True)
    is_copy = np.ones(n_fans, bool)
    is_copy[first_fan] = False
    new_id = np.empty(n_fans, np.int64)
    new_id[order] = np.where(is_copy, n_points + np.cumsum(is_copy) - 1, vertex_of_fan[order])
    source = np.r_[np.arange(n_points), vertex_of_fan[order][is_copy]]
    return new_id[fan].reshape(-1, 3), source, int(is_copy.sum())


def _following(side: np.ndarray) -> np.ndarray:
    """Return the next side of the same triangle."""
    return side - side % 3 + (side + 1) % 3


def manifold(
    points: Points, triangles: Triangles
) -> tuple[Triangles, Int[np.ndarray, " n2"], dict[str, int], Int[np.ndarray, " t"]]:
    """Take sheets apart until every edge has one or two triangles and every vertex one fan.

    Where sheets are wound around an edge so that they stay together at both its ends, the triangles there are left
    out. Returns the triangles, the source of each vertex (old vertices first), how many edges, vertices and
    triangles were changed, and the vertices at which triangles were left out.
    """
    topology = Topology(len(points), triangles)
    crowded = int((topology.edge_count > 2).sum())
    tangled, dropped = [], 0
    while True:
        pairs = np.vstack([manifold_pairs(topology), crowded_pairs(points, triangles, topology)])
        parted, source, copies = split_fans(len(points), triangles, pairs)
        after = Topology(len(source), parted)
        bad = (after.edge_count[after.face_edges] > 2).any(axis=1)
        if not bad.any():
            counts = {"edges": crowded, "vertices": copies, "triangles": dropped}
            return parted, source, counts, np.unique(np.concatenate([np.zeros(0, np.int64), *tangled]))
        tangled.append(source[after.edges[after.edge_count > 2].ravel()])
        dropped += int(bad.sum())
        triangles = triangles[~bad]
        topology = Topology(len(points), triangles)
