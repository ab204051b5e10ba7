"""Polylines on a surface with arc length: its boundary loops and feature curves, for nodes that slide along them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh import FeatureCurve, TriMesh
from drl_meshgen.quality.closest import TriangleSearch
from drl_meshgen.smoothing.walk import SurfaceWalker

CHUNK = 1 << 20
"""Point-segment pairs compared at once."""


class CurveTrack:
    """All boundary loops of a surface, then feature curves, strung on one axis.

    Curve `k` occupies `[start[k], start[k] + length[k]]`. The coordinate `s` of a point is the start of its curve plus
    the arc length from the curve's first vertex.
    """

    def __init__(self, walker: SurfaceWalker, features: Sequence[FeatureCurve] = ()) -> None:
        self._walker, surface = walker, walker.surface
        loops = surface.topology.loops
        curves = [surface.vertices[loop] for loop in loops] + [np.asarray(c.points, float) for c in features]
        self.n_loops = len(loops)
        self.closed = np.array([True] * len(loops) + [c.closed for c in features], bool)
        ahead = [np.roll(p, -1, axis=0) for p in curves]
        kept = [len(p) - (not closed) for p, closed in zip(curves, self.closed, strict=True)]
        self.tail = np.concatenate([np.empty((0, 3)), *(p[:n] for p, n in zip(curves, kept, strict=True))])
        head = np.concatenate([np.empty((0, 3)), *(p[:n] for p, n in zip(ahead, kept, strict=True))])
        self.curve = np.repeat(np.arange(len(curves)), np.array(kept, np.int64))
        edge = head - self.tail
        self.segment_length = np.linalg.norm(edge, axis=1)
        self.direction = edge / np.maximum(self.segment_length, np.finfo(float).tiny)[:, None]
        end = np.cumsum(self.segment_length)
        self.knot = end - self.segment_length
        self.length = np.bincount(self.curve, self.segment_length, minlength=len(curves))
        self.start = np.cumsum(self.length) - self.length
        self._first = np.searchsorted(self.curve, np.arange(len(curves)))
        self._last = np.searchsorted(self.curve, np.arange(len(curves)), side="right") - 1
        self._triangle, self._weights = _boundary_places(surface)
        if len(features):
            rest = slice(len(self._triangle), None)
            across = TriangleSearch(surface.corners)(0.5 * (self.tail + head)[rest])[1]
            ends = np.stack([walker.locate(across, self.tail[rest]), walker.locate(across, head[rest])], axis=1)
            self._triangle = np.concatenate([self._triangle, across])
            self._weights = np.concatenate([self._weights, ends])

    def project(
        self, points: Float[np.ndarray, "n 3"], curves: Int[np.ndarray, " c"]
    ) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Of some curves the one nearest to each point, the coordinate `s` of the nearest point on it, the distance."""
        chosen = np.nonzero(np.isin(self.curve, curves))[0]
        tail, direction, length = self.tail[chosen], self.direction[chosen], self.segment_length[chosen]
        curve, s, distance = np.empty(len(points), np.int64), np.empty(len(points)), np.empty(len(points))
        block = max(1, CHUNK // max(1, len(tail)))
        for first in range(0, len(points), block):
            part = slice(first, first + block)
            relative = points[part, None] - tail
            t = np.clip(np.einsum("nbi,bi->nb", relative, direction), 0, length)
            relative -= t[..., None] * direction
            square = np.einsum("nbi,nbi->nb", relative, relative)
            best, rows = np.argmin(square, axis=1), np.arange(len(relative))
            curve[part] = self.curve[chosen[best]]
            s[part] = self.knot[chosen[best]] + t[rows, best]
            distance[part] = np.sqrt(square[rows, best])
        return curve, s, distance

    def wrap(self, curve: Int[np.ndarray, " n"], s: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Bring coordinates back into the range of their curve: around a closed one, to the end of an open one."""
        along, length = s - self.start[curve], self.length[curve]
        return self.start[curve] + np.where(self.closed[curve], np.mod(along, length), np.clip(along, 0, length))

    def _segment(self, curve: Int[np.ndarray, " n"], s: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        at = np.searchsorted(self.knot, s, side="right") - 1
        return np.clip(at, self._first[curve], self._last[curve])

    def locate(
        self, curve: Int[np.ndarray, " n"], s: Float[np.ndarray, " n"]
    ) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Triangle, barycentric coordinates and unit direction of the curve at each wrapped coordinate."""
        segment = self._segment(curve, s)
        t = np.clip((s - self.knot[segment]) / np.maximum(self.segment_length[segment], np.finfo(float).tiny), 0, 1)
        tail, head = self._weights[segment, 0], self._weights[segment, 1]
        return self._triangle[segment], tail + t[:, None] * (head - tail), self.direction[segment]

    def points(self, curve: Int[np.ndarray, " n"], s: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Points at coordinates of any size."""
        wrapped = self.wrap(curve, s)
        segment = self._segment(curve, wrapped)
        return self.tail[segment] + (wrapped - self.knot[segment])[:, None] * self.direction[segment]

    def corners(
        self, curve: int, scale: float, least_turn: float
    ) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
        """Coordinates of the vertices where a curve turns by at least `least_turn`, and the angles on their left.

        Radians, sharpest first. The turn is that between the chords of length `scale` to both sides, so that jags
        smaller than that do not count; of corners closer than `scale` to each other the sharpest is taken.
        """
        s = self.knot[self._first[curve] : self._last[curve] + 1]
        of = np.full(len(s), curve)
        triangle, weights, _ = self.locate(of, s)
        here, up = self.points(of, s), self._walker.normals(triangle, weights)
        ahead, behind = self.points(of, s + scale) - here, here - self.points(of, s - scale)
        turning, cosine = np.cross(behind, ahead), np.einsum("ni,ni->n", ahead, behind)
        turn = np.arctan2(np.linalg.norm(turning, axis=1), cosine)
        left = np.pi - np.arctan2(np.einsum("ni,ni->n", turning, up), cosine)
        found: list[int] = []
        for k in np.argsort(-turn, kind="stable"):
            if turn[k] < least_turn:
                break
            gap = np.abs(s[k] - s[found])
            if self.closed[curve]:
                gap = np.minimum(gap, self.length[curve] - gap)
            if (gap >= scale).all():
                found.append(int(k))
        return s[found], left[found]


def _boundary_places(surface: TriMesh) -> tuple[Int[np.ndarray, " b"], Float[np.ndarray, "b 2 3"]]:
    """Triangle at each boundary edge, loop by loop, and barycentric coordinates of both its ends there."""
    loops = surface.topology.loops
    tail = np.concatenate([*loops, np.empty(0, np.int64)])
    head = np.concatenate([*(np.roll(loop, -1) for loop in loops), np.empty(0, np.int64)])
    topology, n = surface.topology, surface.topology.n_vertices
    face, side = np.nonzero(topology.edge_count[topology.face_edges] == 1)
    code = surface.triangles[face, side] * n + surface.triangles[face, (side + 1) % 3]
    order = np.argsort(code)
    at = order[np.searchsorted(code[order], tail * n + head)]
    ends = np.stack([side[at], (side[at] + 1) % 3], axis=1)
    return face[at], np.eye(3)[ends]
