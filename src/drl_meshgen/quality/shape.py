"""Shape of single quads: angles, Jacobians, warp, size; all arrays have one row per quad."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

_TINY = np.finfo(float).tiny


def unit(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Return the vectors scaled to length one; zero vectors stay zero."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), _TINY)


def own_normals(corners: Float[np.ndarray, "m 4 3"]) -> Float[np.ndarray, "m 3"]:
    """Return the unit cross product of the diagonals of each quad."""
    return unit(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]))


def _warp(p: Float[np.ndarray, "m 4 3"]) -> Float[np.ndarray, " m"]:
    def fold(i: int, j: int, k: int, l: int) -> np.ndarray:
        a = np.cross(p[:, j] - p[:, i], p[:, k] - p[:, i])
        b = np.cross(p[:, k] - p[:, i], p[:, l] - p[:, i])
        return np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b))

    return np.degrees(np.maximum(fold(0, 1, 2, 3), fold(1, 2, 3, 0)))


@dataclass(frozen=True, eq=False)
class QuadShape:
    """Quads given by their corner positions, and the unit normal that says which side is up.

    The Jacobian at a corner is the signed area of the parallelogram of its two sides, seen from `normals`. Angles
    are in degrees, in 0..360: a corner with a negative Jacobian is reflex.
    """

    corners: Float[np.ndarray, "m 4 3"]
    normals: Float[np.ndarray, "m 3"]

    @cached_property
    def _corner_geometry(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        ahead = np.roll(self.corners, -1, axis=1) - self.corners
        behind = np.roll(self.corners, 1, axis=1) - self.corners
        cross = np.cross(ahead, behind)
        size = np.linalg.norm(cross, axis=2)
        jacobian = np.einsum("mki,mi->mk", cross, self.normals)
        angle = np.degrees(np.arctan2(size, np.einsum("mki,mki->mk", ahead, behind)))
        return jacobian, np.linalg.norm(ahead, axis=2), np.where(jacobian < 0, 360 - angle, angle), size

    @property
    def jacobian(self) -> Float[np.ndarray, "m 4"]:
        """Jacobian at each corner."""
        return self._corner_geometry[0]

    @property
    def sides(self) -> Float[np.ndarray, "m 4"]:
        """Length of each side; side `s` runs from corner `s` to `s + 1`."""
        return self._corner_geometry[1]

    @property
    def angle(self) -> Float[np.ndarray, "m 4"]:
        """Angle at each corner, degrees."""
        return self._corner_geometry[2]

    @cached_property
    def min_angle(self) -> Float[np.ndarray, " m"]:
        """Smallest corner angle, degrees."""
        return self.angle.min(axis=1)

    @cached_property
    def max_angle(self) -> Float[np.ndarray, " m"]:
        """Largest corner angle, degrees."""
        return self.angle.max(axis=1)

    @cached_property
    def deviation(self) -> Float[np.ndarray, " m"]:
        """Largest distance of a corner angle from 90 degrees."""
        return np.maximum(self.max_angle - 90, 90 - self.min_angle)

    @cached_property
    def orthogonality(self) -> Float[np.ndarray, " m"]:
        """Eq. 11 with the worst corner, clipped to 0..1."""
        return np.clip(1 - self.deviation / 90, 0, 1)

    @cached_property
    def orthogonality_printed(self) -> Float[np.ndarray, " m"]:
        """Eq. 11 as printed: with the best corner."""
        return 1 - np.abs(self.angle - 90).min(axis=1) / 90

    @cached_property
    def valid(self) -> Bool[np.ndarray, " m"]:
        """All four Jacobians are positive."""
        return self.jacobian.min(axis=1) > 0

    @cached_property
    def jacobian_ratio(self) -> Float[np.ndarray, " m"]:
        """Eq. 12, 0 for invalid quads."""
        return np.where(self.valid, self.jacobian.min(axis=1) / np.maximum(self.jacobian.max(axis=1), _TINY), 0.0)

    @cached_property
    def scaled_jacobian(self) -> Float[np.ndarray, " m"]:
        """Smallest Jacobian divided by the lengths of its two sides, in -1..1."""
        both = self.sides * np.roll(self.sides, 1, axis=1)
        return (self.jacobian / np.maximum(both, _TINY)).min(axis=1)

    @cached_property
    def warp(self) -> Float[np.ndarray, " m"]:
        """Larger angle between the two triangles of either diagonal split, degrees."""
        return _warp(self.corners)

    @cached_property
    def area(self) -> Float[np.ndarray, " m"]:
        """Mean of the areas of both diagonal splits."""
        return self._corner_geometry[3].sum(axis=1) / 4

    @cached_property
    def size(self) -> Float[np.ndarray, " m"]:
        """Mean side length."""
        return self.sides.mean(axis=1)

    def worst(self, count: int) -> Int[np.ndarray, " k"]:
        """Return the ids of the `count` worst quads, worst first: invalid ones, then by angle; ties by id."""
        return np.lexsort((-self.deviation, self.valid))[:count]
