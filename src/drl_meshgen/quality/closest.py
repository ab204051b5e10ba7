"""Closest points on triangle meshes and polygonal curves, exact and vectorised."""

from functools import cached_property
from itertools import chain

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

_TINY = np.finfo(float).tiny
_FIRST, _CHUNK = 8, 4096


def closest_on_segments(
    queries: Float[np.ndarray, "*n 3"], a: Float[np.ndarray, "*n 3"], b: Float[np.ndarray, "*n 3"]
) -> Float[np.ndarray, "*n 3"]:
    """Return the point of segment `ab` closest to each query."""
    d = b - a
    t = np.einsum("...i,...i->...", queries - a, d) / np.maximum(np.einsum("...i,...i->...", d, d), _TINY)
    return a + np.clip(t, 0, 1)[..., None] * d


def closest_on_triangles(
    queries: Float[np.ndarray, "n 3"], corners: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, "n 3"]:
    """Return the point of each triangle closest to its query; degenerate triangles count as segments."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    e, g, w = b - a, c - a, queries - a
    ee, eg, gg = (np.einsum("ij,ij->i", x, y) for x, y in ((e, e), (e, g), (g, g)))
    we, wg = np.einsum("ij,ij->i", w, e), np.einsum("ij,ij->i", w, g)
    det = ee * gg - eg * eg
    solid = det > 1e-14 * ee * gg
    scale = np.where(solid, det, 1.0)
    s, t = (gg * we - eg * wg) / scale, (ee * wg - eg * we) / scale
    point = a + s[:, None] * e + t[:, None] * g
    outside = np.nonzero(~solid | (s < 0) | (t < 0) | (s + t > 1))[0]
    if len(outside):
        q = queries[outside]
        p = corners[outside]
        rim = np.stack([closest_on_segments(q, p[:, k], p[:, (k + 1) % 3]) for k in range(3)], axis=1)
        nearest = ((rim - q[:, None]) ** 2).sum(axis=2).argmin(axis=1)
        point[outside] = rim[np.arange(len(q)), nearest]
    return point


class TriangleSearch:
    """Closest-point queries against triangles.

    Triangles are put in classes by radius (powers of two), each with a k-d tree of its centroids. A query is settled
    in a class by the nearest few if the last of them is farther off than the best distance plus the class's largest
    radius; else all centroids within that reach are tried.
    """

    def __init__(self, corners: Float[np.ndarray, "f 3 3"]) -> None:
        self.corners = corners

    @cached_property
    def _classes(self) -> list[tuple[np.ndarray, KDTree, np.ndarray]]:
        centre = self.corners.mean(axis=1)
        radius = np.linalg.norm(self.corners - centre[:, None], axis=2).max(axis=1)
        level = np.floor(np.log2(np.maximum(radius, radius.max() * 1e-6 + _TINY))).astype(int)
        ids = [np.nonzero(level == k)[0] for k in np.unique(level)]
        ids.sort(key=len, reverse=True)
        return [(i, KDTree(centre[i]), np.r_[radius[i], 0.0]) for i in ids]

    def __call__(
        self, queries: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Return distance, triangle id and closest point of each query."""
        best = np.full(len(queries), np.inf)
        triangle = np.zeros(len(queries), np.int64)
        point = np.zeros_like(queries)
        state = best, triangle, point
        for ids, tree, radius in self._classes:
            far, near = map(np.asarray, tree.query(queries, k=_FIRST))  # absent neighbours: far = inf, near = len(ids)
            everyone = np.arange(len(queries))
            self._offer(queries, everyone, ids[near[:, 0]], state)
            close = np.isfinite(far) & (far <= best[:, None] + radius[near])
            close[:, 0] = False
            row, column = np.nonzero(close)
            self._offer(queries, row, ids[near[row, column]], state)
            unsettled = np.nonzero(far[:, -1] <= best + radius.max())[0]
            for some in np.array_split(unsettled, 1 + len(unsettled) // _CHUNK):
                ball = tree.query_ball_point(queries[some], best[some] + radius.max(), return_sorted=True)
                count = np.array([len(b) for b in ball], np.int64)
                self._offer(queries, np.repeat(some, count), ids[np.array(list(chain(*ball)), np.int64)], state)
        return best, triangle, point

    def _offer(
        self,
        queries: np.ndarray,
        query: np.ndarray,
        candidate: np.ndarray,
        state: tuple[np.ndarray, np.ndarray, np.ndarray],
    ) -> None:
        """Let each query (ids in ascending order) take its candidate where that is nearer; ties: smaller id."""
        found = closest_on_triangles(queries[query], self.corners[candidate])
        distance = np.linalg.norm(found - queries[query], axis=1)
        best, triangle, point = state
        nearer = np.nonzero(distance < best[query])[0]
        order = nearer[np.lexsort((candidate[nearer], distance[nearer], query[nearer]))]
        first = order[np.diff(query[order], prepend=-1) > 0]
        best[query[first]], triangle[query[first]] = distance[first], candidate[first]
        point[query[first]] = found[first]
