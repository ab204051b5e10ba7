"""Opening a mesh along some of its edges."""

import numpy as np
from jaxtyping import Bool, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from drl_meshgen.mesh.topology import Topology


def corner_classes(topology: Topology, cut_edge: np.ndarray) -> Int[np.ndarray, "m k"]:
    """Vertex of each face corner after opening the mesh along the edges flagged in `cut_edge (e,)` (bool).

    Corners at one vertex stay together when a fan of faces joins them without crossing a cut edge. Classes are
    numbered by their first corner.
    """
    faces, k = topology.faces, topology.faces.shape[1]
    keep = (topology.edge_count == 2) & ~cut_edge
    flat = topology.face_edges.ravel()
    order = np.argsort(flat, kind="stable")
    order = order[keep[flat[order]]]
    one, two = order[0::2], order[1::2]
    # side s of a face runs from corner s to corner s + 1; the neighbour runs through it the other way
    ahead = lambda side: side - side % k + (side % k + 1) % k  # noqa: E731
    a = np.r_[one, ahead(one)]
    b = np.r_[ahead(two), two]
    n = faces.size
    label = connected_components(coo_matrix((np.ones(len(a), np.int8), (a, b)), (n, n)), directed=False)[1]
    first = np.unique(label, return_index=True)[1]
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first, kind="stable")] = np.arange(len(first))
    return rank[label].reshape(-1, k)


def corners_left_of(topology: Topology, curve: Int[np.ndarray, " n"], *, closed: bool) -> Bool[np.ndarray, "m k"]:
    """Face corners at the vertices of `curve` that lie on its left; `curve` is a simple path along edges.

    A path that is not closed runs from boundary to boundary.
    """
    n = topology.n_vertices
    tail, head = (curve, np.roll(curve, -1)) if closed else (curve[:-1], curve[1:])
    edges = topology.edges
    flags = np.zeros(len(edges), bool)
    flags[np.searchsorted(edges @ (n, 1), np.minimum(tail, head) * n + np.maximum(tail, head))] = True
    classes = corner_classes(topology, flags)
    side = np.isin(topology.faces * n + np.roll(topology.faces, -1, axis=1), tail * n + head)
    left = np.zeros(classes.max() + 1, bool)
    left[classes[side]] = True
    left[np.roll(classes, -1, axis=1)[side]] = True
    return left[classes]


def trace(edges: Int[np.ndarray, "e 2"]) -> list[Int[np.ndarray, " n"]]:
    """Order undirected edges into closed curves, each from its smallest vertex towards its smaller neighbour."""
    around: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        around.setdefault(a, []).append(b)
        around.setdefault(b, []).append(a)
    curves = []
    for start in sorted(around):
        if start not in around:
            continue
        curve, before, here = [start], -1, start
        while True:
            ahead = [v for v in sorted(around.pop(here)) if v != before]
            before, here = here, ahead[0]
            if here == start:
                break
            curve.append(here)
        curves.append(np.array(curve, np.int64))
    return curves
