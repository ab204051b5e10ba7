"""Repairs of triangle lists. Each takes and returns plain arrays and says how many items it changed.

Positions are in units where the bounding-box diagonal is 1. Nothing moves a point; vertex order is kept.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components
from scipy.spatial import KDTree

from drl_meshgen.mesh.topology import Topology, graph_components

Triangles = Int[np.ndarray, "m 3"]
Points = Float[np.ndarray, "n 3"]


SLIVER = 0.02
"""Triangles with a smaller height over their longest side are slivers (ratio)."""
_FEW_TRIANGLES = 8
_IN_PLANE = 1e-6


class CleanupWarning(UserWarning):
    """Part of the input was left out, or added to."""


def merged_ids(points: Points, tolerance: float) -> Int[np.ndarray, " n"]:
    """For each point the smallest index among the points it coincides with (transitively, within `tolerance`)."""
    pairs = KDTree(points).query_pairs(tolerance, output_type="ndarray")
    if len(pairs) == 0:
        return np.arange(len(points))
    label = graph_components(pairs, len(points))
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
    return 2 * areas(points, triangles) / np.maximum(longest, np.finfo(float).tiny) ** 2


def areas(points: Points, triangles: Triangles) -> Float[np.ndarray, " m"]:
    """Area of each triangle."""
    p = points[triangles]
    return np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1) / 2


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


def drop_needless(points: Points, triangles: Triangles) -> tuple[Triangles, int]:
    """Merge the three triangles around a vertex into one where one of them is a sliver and the shape stays.

    The vertex must lie within `_IN_PLANE` of the plane of its neighbours, inside their triangle. Repeats until none is
    left; of neighbours the one with the smaller index goes first.
    """
    dropped = 0
    while True:
        topology = Topology(len(points), triangles)
        spokes = np.bincount(triangles.ravel(), minlength=len(points)) == 3
        ring = topology.valence == 3  # as many edges as triangles: the vertex is not on the boundary
        sliver = np.zeros(len(points), bool)
        sliver[triangles[flatness(points, triangles) < SLIVER]] = True
        found = np.nonzero(spokes & ring & sliver & ~_at_crowded_edges(topology))[0]
        around, outline = _outlines(triangles, found)
        p, q = points[found], points[outline]
        normal = np.cross(q[:, 1] - q[:, 0], q[:, 2] - q[:, 0])
        area = np.linalg.norm(normal, axis=1) / 2
        height = np.abs(np.einsum("ni,ni->n", p - q[:, 0], normal)) / np.maximum(2 * area, np.finfo(float).tiny)
        inside = areas(points, triangles[around].reshape(-1, 3)).reshape(-1, 3).sum(axis=1) <= area * (1 + 1e-6)
        known = np.sort(triangles, axis=1) @ (len(points) ** 2, len(points), 1)
        single = ~np.isin(np.sort(outline, axis=1) @ (len(points) ** 2, len(points), 1), known)
        drop = np.zeros(len(triangles), bool)
        new = []
        for k in np.nonzero((height < _IN_PLANE) & inside & single)[0].tolist():
            if not drop[around[k]].any():
                drop[around[k]] = True
                new.append(outline[k])
        if not new:
            return triangles, dropped
        triangles = np.vstack([triangles[~drop], new])
        dropped += len(new)


def _at_crowded_edges(topology: Topology) -> Bool[np.ndarray, " n"]:
    flag = np.zeros(topology.n_vertices, bool)
    flag[topology.edges[topology.edge_count > 2]] = True
    return flag


def _outlines(triangles: Triangles, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles around each vertex of three, and the triangle of its neighbours, wound as the first of them."""
    flat = triangles.ravel()
    order = np.argsort(flat, kind="stable")
    start = np.searchsorted(flat[order], vertices)
    corner = order[start[:, None] + np.arange(3)]
    around = corner // 3
    first = corner[:, 0] % 3
    b, c = (triangles[around[:, 0], (first + k) % 3] for k in (1, 2))
    others = triangles[around].reshape(-1, 9)
    rest = others.sum(axis=1) - 3 * vertices - 2 * (b + c)  # every neighbour is in two of the three triangles
    return around, np.c_[b, c, rest // 2]


def trim_fins(points: Points, triangles: Triangles) -> tuple[Triangles, int]:
    """Drop triangles that hang on an edge of three or more triangles by one side and are free on the other two.

    The smallest go first and only until the edge is manifold, so no hole is torn.
    """
    trimmed = 0
    while True:
        topology = Topology(len(points), triangles)
        crowded = topology.edge_count[topology.face_edges] > 2
        free = topology.edge_count[topology.face_edges] == 1
        fins = np.nonzero(crowded.any(axis=1) & (free.sum(axis=1) == 2))[0]
        if len(fins) == 0:
            return triangles, trimmed
        area = areas(points, triangles[fins])
        left = topology.edge_count.copy()
        drop = []
        for f in fins[np.lexsort((fins, area))].tolist():
            sides = topology.face_edges[f]
            if (left[sides] > 2).any():
                left[sides] -= 1
                drop.append(f)
        triangles = np.delete(triangles, drop, axis=0)
        trimmed += len(drop)


def orient(n_points: int, triangles: Triangles) -> tuple[Triangles, int, Bool[np.ndarray, " m"]]:
    """Turn triangles so that neighbours agree, as few as possible in each component.

    Works on the orientation double cover: a surface is orientable if no triangle is connected to its mirror image.
    Returns the triangles, how many were turned, and which belong to components with only one side (left as they are).
    """
    topology = Topology(n_points, triangles)
    m = len(triangles)
    if len(topology.misoriented_edges) == 0:
        return triangles, 0, np.zeros(m, bool)
    inner = topology.edge_count == 2
    disagree = np.zeros(len(topology.edges), bool)
    disagree[topology.misoriented_edges] = True
    f, g = topology.edge_faces[inner].T
    odd = disagree[inner]
    rows, columns = np.r_[f, f + m], np.r_[np.where(odd, g + m, g), np.where(odd, g, g + m)]
    _, sheet = connected_components(coo_matrix((np.ones(len(rows)), (rows, columns)), (2 * m, 2 * m)), directed=False)
    one_sided = sheet[:m] == sheet[m:]
    size = np.bincount(sheet[:m], minlength=sheet.max() + 1)
    mirror_size = size[sheet[m:]]
    keep = (size[sheet[:m]] > mirror_size) | ((size[sheet[:m]] == mirror_size) & (sheet[:m] < sheet[m:])) | one_sided
    return np.where(keep[:, None], triangles, triangles[:, ::-1]), int((~keep).sum()), one_sided


def disagreeing(n_points: int, triangles: Triangles) -> Int[np.ndarray, " k"]:
    """Return the vertices of edges at which a surface with one side must be cut to get two, ascending.

    Neighbours are made to agree along a breadth-first tree of triangles; these are the edges where they still do not.
    """
    topology = Topology(n_points, triangles)
    inner = topology.edge_count == 2
    disagree = np.zeros(len(topology.edges), bool)
    disagree[topology.misoriented_edges] = True
    f, g = topology.edge_faces[inner].T
    odd = disagree[inner]
    m = len(triangles)
    _, label = connected_components(coo_matrix((np.ones(len(f)), (f, g)), (m, m)), directed=False)
    weight = coo_matrix((np.where(odd, 2.0, 1.0), (f, g)), (m, m)).tocsr()
    weight = weight + weight.T
    turned = np.zeros(m, bool)
    for start in np.unique(label, return_index=True)[1]:
        order, before = breadth_first_order(weight, start, directed=False)
        steps = np.asarray(weight[order[1:], before[order[1:]]]).ravel() == 2
        for face, parent, step in zip(order[1:].tolist(), before[order[1:]].tolist(), steps.tolist(), strict=True):
            turned[face] = turned[parent] ^ step
    return np.unique(topology.edges[inner][odd ^ turned[f] ^ turned[g]])


def specks(points: Points, triangles: Triangles, share: float) -> tuple[Bool[np.ndarray, " m"], int, int]:
    """Triangles of components too small to matter, the number of these components and of all (joined through edges).

    Small is less than `share` of the area, ten times that with fewer than eight triangles; the largest component is
    never a speck.
    """
    n, label = Topology(len(points), triangles).components
    area = np.bincount(label, weights=areas(points, triangles))
    few = np.bincount(label) < _FEW_TRIANGLES
    small = area < area.sum() * share * np.where(few, 10, 1)
    small[area.argmax()] = False
    return small[label], int(small.sum()), n
