"""Small holes, as scans have them, filled with triangles over their own vertices."""

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh.topology import Topology

_LONGER = {3: 5.0, 4: 2.0, 5: 2.0, 6: 2.0}  # by number of edges: a missing triangle is a likelier flaw than a hole
_COMPACT = 0.05  # weight of the squared sides beside the area, so that flat holes get no needles


def fill_holes(
    points: Float[np.ndarray, "n 3"], triangles: Int[np.ndarray, "m 3"], longest: float
) -> tuple[Int[np.ndarray, "m2 3"], int]:
    """Fill the holes up to `longest` around, those of at most six edges up to twice, of three up to five times that.

    Manifold, oriented triangles are needed and kept; new ones come last. Returns all triangles and how many holes
    were filled. A hole whose every triangulation would double an edge of the surface stays open.
    """
    topology = Topology(len(points), triangles)
    taken = {(int(a), int(b)) for a, b in topology.edges[topology.on_boundary[topology.edges].all(axis=1)]}
    patches = []
    for loop in topology.loops if longest > 0 else ():
        length = np.linalg.norm(points[loop] - np.roll(points[loop], 1, axis=0), axis=1).sum()
        if length > longest * _LONGER.get(len(loop), 1.0):
            continue
        corners = loop[::-1]  # the loop has the surface on its left, the patch lies on the other side
        patch = _triangulated(points[corners], _chords(corners, taken))
        if patch is not None:
            patches.append(corners[patch])
            taken |= {
                (int(min(a, b)), int(max(a, b))) for t in patches[-1] for a, b in zip(t, np.roll(t, 1), strict=True)
            }
    return np.vstack([triangles, *patches]), len(patches)


def _chords(corners: Int[np.ndarray, " k"], taken: set[tuple[int, int]]) -> np.ndarray:
    """Which pairs of corners may be joined: neighbours, and those without an edge of the surface between them."""
    k = len(corners)
    free = np.ones((k, k), bool)
    for i in range(k):
        for j in range(i + 2, k):
            ends = sorted((int(corners[i]), int(corners[j])))
            free[i, j] = (i == 0 and j == k - 1) or tuple(ends) not in taken
    return free


def _triangulated(p: Float[np.ndarray, "k 3"], free: np.ndarray) -> Int[np.ndarray, "t 3"] | None:
    """Triangulation of a polygon in space of least cost (Barequet and Sharir 1995), or None where none is allowed."""
    k = len(p)
    cost, split = np.zeros((k, k)), np.zeros((k, k), np.int64)
    for span in range(2, k):
        for i in range(k - span):
            j = i + span
            m = np.arange(i + 1, j)
            area = np.linalg.norm(np.cross(p[m] - p[i], p[j] - p[i]), axis=1) / 2
            sides = ((p[m] - p[i]) ** 2).sum(axis=1) + ((p[m] - p[j]) ** 2).sum(axis=1) + ((p[i] - p[j]) ** 2).sum()
            total = cost[i, m] + cost[m, j] + area + _COMPACT * sides
            best = int(total.argmin())
            cost[i, j], split[i, j] = (total[best] if free[i, j] else np.inf), m[best]
    if not np.isfinite(cost[0, k - 1]):
        return None
    open_spans, found = [(0, k - 1)], []
    while open_spans:
        i, j = open_spans.pop()
        if j - i >= 2:
            m = int(split[i, j])
            found.append((i, m, j))
            open_spans += [(i, m), (m, j)]
    return np.array(found, np.int64)
