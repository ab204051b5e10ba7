"""Straightest walks on a triangulated surface, all nodes at once."""

from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh import TriMesh

MAX_CROSSINGS = 200
"""Triangles one walk may cross; longer walks stop where they are (a step is half a quad edge)."""


class SurfaceWalker:
    """Moves points given as (triangle, barycentric coordinates) along straight lines unfolded over the triangles."""

    def __init__(self, surface: TriMesh) -> None:
        self.surface = surface

    @cached_property
    def _neighbour(self) -> tuple[Int[np.ndarray, "f 3"], Int[np.ndarray, "f 3"]]:
        """Triangle across each side (-1 at the boundary) and which of its sides that is."""
        topology = self.surface.topology
        across, edge = topology.neighbours, topology.face_edges
        side = np.argmax(edge[across] == edge[..., None], axis=-1)
        return across, side

    @cached_property
    def _gradient(self) -> Float[np.ndarray, "f 3 3"]:
        """Gradient of each barycentric coordinate."""
        p, normal = self.surface.corners, self.surface.normals
        opposite = np.roll(p, -2, axis=1) - np.roll(p, -1, axis=1)
        double_area = np.maximum(2 * self.surface.areas, np.finfo(float).tiny)
        return np.cross(normal[:, None], opposite) / double_area[:, None, None]

    @cached_property
    def _sides(self) -> tuple[Float[np.ndarray, "f 3 3"], Float[np.ndarray, "f 3 3"]]:
        """Unit direction of each side and unit in-plane normal of it pointing into the triangle."""
        p = self.surface.corners
        along = np.roll(p, -1, axis=1) - p
        along /= np.maximum(np.linalg.norm(along, axis=2, keepdims=True), np.finfo(float).tiny)
        return along, np.cross(self.surface.normals[:, None], along)

    def locate(self, triangle: Int[np.ndarray, " n"], points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Barycentric coordinates of points in given triangles, clipped to the triangle."""
        relative = points - self.surface.corners[triangle].mean(axis=1)
        weights = np.einsum("nij,nj->ni", self._gradient[triangle], relative) + 1 / 3
        return normalised(weights)

    def positions(self, triangle: Int[np.ndarray, " n"], weights: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Points of (triangle, barycentric coordinates)."""
        return np.einsum("ni,nij->nj", weights, self.surface.corners[triangle])

    def normals(self, triangle: Int[np.ndarray, " n"], weights: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Interpolate unit normals from those of the vertices."""
        normal = np.einsum("ni,nij->nj", weights, self.surface.vertex_normals[self.surface.triangles[triangle]])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        flat = length < 1e-3  # opposite vertex normals cancel: fall back to the triangle's own
        return np.where(flat, self.surface.normals[triangle], normal / np.maximum(length, 1e-3))

    def walk(
        self,
        triangle: Int[np.ndarray, " n"],
        weights: Float[np.ndarray, "n 3"],
        displacement: Float[np.ndarray, "n 3"],
    ) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Walk from each point along its displacement, projected to the tangent plane; stop at the boundary.

        Where the line crosses a side it goes on in the next triangle at the same angle (straightest geodesic).
        Returns the new triangles and barycentric coordinates. Meant for steps of up to about a quad edge.
        """
        triangle, weights = triangle.copy(), weights.copy()
        across, mirror = self._neighbour
        along, inward = self._sides
        active = np.arange(len(triangle))
        d = displacement.astype(float)
        rows = active
        for _ in range(MAX_CROSSINGS):
            t, w = triangle[active], weights[active]
            rate = np.einsum("nij,nj->ni", self._gradient[t], d)
            time = np.where(rate < 0, w / np.maximum(-rate, np.finfo(float).tiny), np.inf)
            corner = np.argmin(time, axis=1)
            leave = time[rows, corner]
            inside = leave >= 1
            w = w + np.minimum(leave, 1)[:, None] * rate
            weights[active[inside]] = normalised(w[inside])

            out = ~inside
            active, t, w, corner = active[out], t[out], w[out], corner[out]
            d = d[out] * (1 - leave[out])[:, None]
            side = (corner + 1) % 3
            rows = np.arange(len(active))
            w[rows, corner] = 0
            weights[active] = normalised(w)
            following = across[t, side]
            stay = following >= 0
            active, t, w, side, d = active[stay], t[stay], weights[active[stay]], side[stay], d[stay]
            if not active.size:
                break
            rows = np.arange(len(active))
            following, entry = following[stay], mirror[t, side]
            crossed = np.zeros_like(w)
            crossed[rows, entry] = w[rows, (side + 1) % 3]
            crossed[rows, (entry + 1) % 3] = w[rows, side]
            triangle[active], weights[active] = following, crossed
            direction = along[t, side]
            parallel = np.einsum("ni,ni->n", d, direction)
            outward = -np.einsum("ni,ni->n", d, inward[t, side])
            d = parallel[:, None] * direction + np.maximum(outward, 0)[:, None] * inward[following, entry]
        return triangle, weights


def normalised(weights: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Clip barycentric coordinates to the triangle and make them add up to one."""
    clipped = np.maximum(weights, 0)
    return clipped / clipped.sum(axis=1, keepdims=True)
