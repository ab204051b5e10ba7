"""Repairs of triangle lists. Each takes and returns plain arrays and says how many items it changed.

Positions are in units where the bounding-box diagonal is 1. Nothing moves a point; vertex order is kept.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from drl_meshgen.mesh.topology import Topology

Triangles = Int[np.ndarray, "m 3"]
Points = Float[np.ndarray, "n 3"]


class CleanupWarning(UserWarning):
    """Part of the input was left out."""


def merged_ids(points: Points, tolerance: float) -> Int[np.ndarray, " n"]:
    """For each point the smallest index among the points it coincides with (transitively, within `tolerance`)."""
    pairs = KDTree(points).query_pairs(tolerance, output_type="ndarray")
    if len(pairs) == 0:
        return np.arange(len(points))
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), (len(points),) * 2)
    _, label = connected_components(graph, directed=False)
    first = np.full(label.max() + 1, len(points))
    np.minimum.at(first, label, np.arange(len(points)))
    return first[label]


def drop_collapsed(triangles: Triangles) -> Triangles:
    """Leave out triangles with a repeated corner."""
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (c != a)]


def drop_duplicates(triangles: Triangles) -> Triangles:
    """Keep the first of triangles with the same three corners."""
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    return triangles[np.sort(first)]


def flatness(points: Points, triangles: Triangles) -> Float[np.ndarray, " m"]:
    """Smallest height of each triangle over its longest side: 0.87 when equilateral, 0 when degenerate."""
    p = points[triangles]
    longest = np.linalg.norm(np.roll(p, -1, axis=1) - p, axis=2).max(axis=1)
    area2 = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    return area2 / np.maximum(longest, np.finfo(float).tiny) ** 2


def mend_flat(points: Points, triangles: Triangles, limit: float) -> tuple[Triangles, int]:
    """Remove triangles flatter than `limit` whose corners are distinct (caps) without opening a crack.

    The longest side is flipped with the neighbour across it; at the boundary the triangle is dropped. Repeats
    until no cap is left or a round changes nothing.
    """
    mended = 0
    for _ in range(20):
        flat = np.nonzero(flatness(points, triangles) < limit)[0]
        if len(flat) == 0:
            break
        topology = Topology(len(points), triangles)
        out, drop, touched = triangles.copy(), [], set()
        for f in flat.tolist():
            corners = points[triangles[f]]
            s = int(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1).argmax())
            edge = topology.face_edges[f, s]
            if topology.edge_count[edge] > 2:
                continue
            other = int(topology.neighbours[f, s]) if topology.edge_count[edge] == 2 else -1
            if f in touched or other in touched:
                continue
            touched.add(f)
            if other < 0:
                drop.append(f)
                continue
            touched.add(other)
            a, b, apex = (int(triangles[f, (s + k) % 3]) for k in range(3))
            far = int(np.setdiff1d(triangles[other], (a, b))[0])
            out[f], out[other] = (a, far, apex), (far, b, apex)
        if not touched:
            break
        mended += len(touched & set(flat.tolist()))
        triangles = np.delete(out, drop, axis=0)
    return triangles, mended


def trim_fins(points: Points, triangles: Triangles) -> tuple[Triangles, int]:
    """Drop triangles that hang on an edge of three or more triangles by one side and are free on another.

    The smallest go first and only until the edge is manifold, so no hole is torn.
    """
    trimmed = 0
    while True:
        topology = Topology(len(points), triangles)
        crowded = topology.edge_count[topology.face_edges] > 2
        free = topology.edge_count[topology.face_edges] == 1
        fins = np.nonzero(crowded.any(axis=1) & free.any(axis=1))[0]
        if len(fins) == 0:
            return triangles, trimmed
        p = points[triangles[fins]]
        area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
        left = topology.edge_count.copy()
        drop = []
        for f in fins[np.lexsort((fins, area))].tolist():
            sides = topology.face_edges[f]
            if (left[sides] > 2).any():
                left[sides] -= 1
                drop.append(f)
        triangles = np.delete(triangles, drop, axis=0)
        trimmed += len(drop)


def split_pinched(n_points: int, triangles: Triangles) -> tuple[Triangles, Int[np.ndarray, " n2"], int]:
    """Give each fan of triangles around a vertex its own vertex (edges must be manifold).

    Returns the triangles, the source of each vertex (old vertices first) and the number of copies.
    """
    topology = Topology(n_points, triangles)
    m = len(triangles)
    face, side = np.nonzero(topology.neighbours >= 0)
    other = topology.neighbours[face, side]
    links = []
    for k in range(2):
        vertex = triangles[face, (side + k) % 3]
        corner = (triangles[other] == vertex[:, None]).argmax(axis=1)
        links.append(np.c_[face * 3 + (side + k) % 3, other * 3 + corner])
    link = np.vstack(links)
    graph = coo_matrix((np.ones(len(link)), link.T), (3 * m, 3 * m))
    n_fans, fan = connected_components(graph, directed=False)
    if n_fans == int(topology.used.sum()):
        return triangles, np.arange(n_points), 0
    vertex_of_fan = np.empty(n_fans, np.int64)
    vertex_of_fan[fan] = triangles.ravel()
    _, first_corner = np.unique(fan, return_index=True)
    order = np.argsort(first_corner)
    _, first_fan = np.unique(vertex_of_fan[order], return_index=True)
    is_copy = np.ones(n_fans, bool)
    is_copy[first_fan] = False
    new_id = np.empty(n_fans, np.int64)
    new_id[order] = np.where(is_copy, n_points + np.cumsum(is_copy) - 1, vertex_of_fan[order])
    source = np.r_[np.arange(n_points), vertex_of_fan[order][is_copy]]
    return new_id[fan].reshape(-1, 3), source, int(is_copy.sum())


def orient(n_points: int, triangles: Triangles) -> tuple[Triangles | None, int]:
    """Turn triangles so that neighbours agree, as few as possible in each component; None if that is impossible.

    Works on the orientation double cover: a surface is orientable if no triangle is connected to its mirror image.
    """
    topology = Topology(n_points, triangles)
    if len(topology.misoriented_edges) == 0:
        return triangles, 0
    m = len(triangles)
    inner = topology.edge_count == 2
    disagree = np.zeros(len(topology.edges), bool)
    disagree[topology.misoriented_edges] = True
    f, g = topology.edge_faces[inner].T
    odd = disagree[inner]
    rows, columns = np.r_[f, f + m], np.r_[np.where(odd, g + m, g), np.where(odd, g, g + m)]
    _, sheet = connected_components(coo_matrix((np.ones(len(rows)), (rows, columns)), (2 * m, 2 * m)), directed=False)
    if (sheet[:m] == sheet[m:]).any():
        return None, 0
    size = np.bincount(sheet[:m], minlength=sheet.max() + 1)
    mirror_size = size[sheet[m:]]
    keep = (size[sheet[:m]] > mirror_size) | ((size[sheet[:m]] == mirror_size) & (sheet[:m] < sheet[m:]))
    return np.where(keep[:, None], triangles, triangles[:, ::-1]), int((~keep).sum())


def largest_component(points: Points, triangles: Triangles) -> tuple[Bool[np.ndarray, " m"], int]:
    """Triangles of the component with the largest area (joined through edges) and the number of components."""
    n, label = Topology(len(points), triangles).components
    if n == 1:
        return np.ones(len(triangles), bool), 1
    p = points[triangles]
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    return label == np.bincount(label, weights=area).argmax(), n
