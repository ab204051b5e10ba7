"""The boundary of a surface as closed polylines with arc length, for nodes that slide along it."""

from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh import TriMesh

CHUNK = 1 << 20
"""Point-segment pairs compared at once."""


class BoundaryTrack:
    """All boundary loops of a surface, strung on one axis: loop `k` occupies `[start[k], start[k] + length[k])`.

    The coordinate `s` of a point is the start of its loop plus the arc length from the loop's first vertex.
    """

    def __init__(self, surface: TriMesh) -> None:
        self.surface = surface
        loops = surface.topology.loops
        self.tail = np.concatenate([*loops, np.empty(0, np.int64)])
        self.head = np.concatenate([*(np.roll(loop, -1) for loop in loops), np.empty(0, np.int64)])
        self.loop = np.repeat(np.arange(len(loops)), [len(loop) for loop in loops])
        edge = surface.vertices[self.head] - surface.vertices[self.tail]
        self.segment_length = np.linalg.norm(edge, axis=1)
        self.direction = edge / np.maximum(self.segment_length, np.finfo(float).tiny)[:, None]
        end = np.cumsum(self.segment_length)
        self.knot = end - self.segment_length
        self.length = np.bincount(self.loop, self.segment_length, minlength=len(loops))
        self.start = np.cumsum(self.length) - self.length

    @cached_property
    def _triangle(self) -> tuple[Int[np.ndarray, " b"], Int[np.ndarray, " b"]]:
        """Triangle at each segment and the side of it that the segment is."""
        topology, n = self.surface.topology, self.surface.topology.n_vertices
        face, side = np.nonzero(topology.edge_count[topology.face_edges] == 1)
        code = self.surface.triangles[face, side] * n + self.surface.triangles[face, (side + 1) % 3]
        order = np.argsort(code)
        at = order[np.searchsorted(code[order], self.tail * n + self.head)]
        return face[at], side[at]

    def project(self, points: Float[np.ndarray, "n 3"]) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Segment nearest to each point and the coordinate `s` of the nearest point on it."""
        tail = self.surface.vertices[self.tail]
        segment, s = np.empty(len(points), np.int64), np.empty(len(points))
        block = max(1, CHUNK // max(1, len(tail)))
        for first in range(0, len(points), block):
            part = slice(first, first + block)
            relative = points[part, None] - tail
            t = np.clip(np.einsum("nbi,bi->nb", relative, self.direction), 0, self.segment_length)
            relative -= t[..., None] * self.direction
            best = np.argmin(np.einsum("nbi,nbi->nb", relative, relative), axis=1)
            segment[part] = best
            s[part] = self.knot[best] + t[np.arange(len(best)), best]
        return segment, s

    def wrap(self, loop: Int[np.ndarray, " n"], s: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Bring coordinates back into the range of their loop."""
        return self.start[loop] + np.mod(s - self.start[loop], self.length[loop])

    def segment(self, loop: Int[np.ndarray, " n"], s: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Segment that holds each wrapped coordinate."""
        at = np.searchsorted(self.knot, s, side="right") - 1
        first = np.searchsorted(self.loop, loop)
        last = np.searchsorted(self.loop, loop, side="right") - 1
        return np.clip(at, first, last)

    def locate(
        self, loop: Int[np.ndarray, " n"], s: Float[np.ndarray, " n"]
    ) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Triangle, barycentric coordinates and unit boundary direction at each wrapped coordinate."""
        segment = self.segment(loop, s)
        t = np.clip((s - self.knot[segment]) / np.maximum(self.segment_length[segment], np.finfo(float).tiny), 0, 1)
        triangle, side = self._triangle[0][segment], self._triangle[1][segment]
        weights = np.zeros((len(s), 3))
        rows = np.arange(len(s))
        weights[rows, side] = 1 - t
        weights[rows, (side + 1) % 3] = t
        return triangle, weights, self.direction[segment]
