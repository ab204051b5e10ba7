"""Implicit modelling: smooth unions of tubes and ellipsoids, evaluated at arbitrary points.

Every field is negative inside and roughly a distance near its zero set. Blends are the polynomial smooth
minimum, which changes a field only where its two operands are closer than the blend width.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

FAR = 1e3  # field value out of reach of every part
BUNDLE = 2048  # points evaluated together


def smooth_min(a: np.ndarray, b: np.ndarray, blend: float) -> np.ndarray:
    """Quadratic polynomial smooth minimum of width `blend` (0: the plain minimum)."""
    if blend <= 0:
        return np.minimum(a, b)
    h = np.maximum(blend - np.abs(a - b), 0) / blend
    return np.minimum(a, b) - h * h * (blend / 4)


def smooth_max(a: np.ndarray, b: np.ndarray, blend: float) -> np.ndarray:
    """Mirror image of `smooth_min`."""
    return -smooth_min(-a, -b, blend)


def gauss(distance: np.ndarray, width: float) -> np.ndarray:
    """Bell of height 1 and width `width`."""
    return np.exp(-((distance / width) ** 2))


def step_down(x: np.ndarray, width: float) -> np.ndarray:
    """Smooth step from 1 (negative `x`) to 0."""
    return 0.5 - 0.5 * np.tanh(x / width)


def catmull_rom(control: Float[np.ndarray, "c d"], pieces: int = 16) -> Float[np.ndarray, "p d"]:
    """Points of the Catmull-Rom spline through the control points, `pieces` per span."""
    w = np.vstack([2 * control[0] - control[1], control, 2 * control[-1] - control[-2]])
    t = np.linspace(0, 1, pieces, endpoint=False)[:, None]
    spans = [
        (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3) / 2
        for a, b, c, d in zip(w, w[1:], w[2:], w[3:], strict=False)
    ]
    return np.vstack([*spans, control[-1:]])


def distance_to_polyline(points: Float[np.ndarray, "n d"], line: Float[np.ndarray, "p d"]) -> Float[np.ndarray, " n"]:
    """Euclidean distance of each point to a polyline."""
    best = np.full(len(points), np.inf)
    for a, b in pairwise(line):
        d = b - a
        t = np.clip((points - a) @ d / (d @ d), 0, 1)
        best = np.minimum(best, np.linalg.norm(points - a - t[:, None] * d, axis=1))
    return best


def frame(axis: np.ndarray, up: np.ndarray) -> Float[np.ndarray, "3 3"]:
    """Right-handed orthonormal rows (lateral, axis, normal); the normal lies in the plane of `axis` and `up`."""
    a = np.asarray(axis, float) / np.linalg.norm(axis)
    u = np.cross(np.asarray(up, float), a)
    u /= np.linalg.norm(u)
    return np.array([u, a, np.cross(u, a)])


@dataclass(frozen=True, eq=False)
class Tube:
    """Tube around a polyline with a radius per point, linear in between.

    `stretch` scales each coordinate before distances are taken: above 1 flattens the tube along that axis.
    """

    axis: Float[np.ndarray, "p 3"]
    radii: Float[np.ndarray, " p"]
    stretch: Float[np.ndarray, " 3"]

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Box of the axis, widened by the largest radius."""
        reach = self.radii.max() / self.stretch
        return self.axis.min(axis=0) - reach, self.axis.max(axis=0) + reach

    def distance(self, points: Float[np.ndarray, "n 3"], reach: float) -> Float[np.ndarray, " n"]:
        """Minimum over the segments of the distance to the segment less the radius there."""
        best = np.full(len(points), FAR)
        scaled, axis = points * self.stretch, self.axis * self.stretch
        px, py, pz = np.ascontiguousarray(scaled.T)
        margin = np.maximum(self.radii[:-1], self.radii[1:])[:, None] + reach * self.stretch.max()
        low = np.minimum(axis[:-1], axis[1:]) - margin
        high = np.maximum(axis[:-1], axis[1:]) + margin
        points_low, points_high = _box(scaled)
        for s in np.nonzero(((low < points_high) & (high > points_low)).all(axis=1))[0]:
            d = axis[s + 1] - axis[s]
            x, y, z = px - axis[s, 0], py - axis[s, 1], pz - axis[s, 2]
            t = np.clip((x * d[0] + y * d[1] + z * d[2]) / (d @ d), 0, 1)
            across = (x - t * d[0]) ** 2 + (y - t * d[1]) ** 2 + (z - t * d[2]) ** 2
            np.minimum(best, np.sqrt(across) - (self.radii[s] + (self.radii[s + 1] - self.radii[s]) * t), out=best)
        return best / np.sqrt(self.stretch.max())


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """Ellipsoid with semi-axes `radii` along the rows of `axes`."""

    centre: Float[np.ndarray, " 3"]
    radii: Float[np.ndarray, " 3"]
    axes: Float[np.ndarray, "3 3"]

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Tight box."""
        reach = np.linalg.norm(self.radii[:, None] * self.axes, axis=0)
        return self.centre - reach, self.centre + reach

    def distance(self, points: Float[np.ndarray, "n 3"], reach: float) -> Float[np.ndarray, " n"]:  # noqa: ARG002
        """First-order distance `k0 (k0 - 1) / k1`, exact to second order at the surface."""
        local = (points - self.centre) @ self.axes.T
        k0 = np.linalg.norm(local / self.radii, axis=1)
        k1 = np.linalg.norm(local / self.radii**2, axis=1) + 1e-9
        return k0 * (k0 - 1) / k1


def tube(control: list, radii: list, stretch: tuple = (1, 1, 1), pieces: int = 16) -> Tube:
    """Tube along the spline through control points and radii (`pieces = 1`: straight segments)."""
    rows = np.c_[np.array(control, float), radii]
    if pieces > 1:
        rows = catmull_rom(rows, pieces)
    return Tube(rows[:, :3], rows[:, 3], np.array(stretch, float))


def ellipsoid(centre: np.ndarray | tuple, radii: tuple, axes: np.ndarray | None = None) -> Ellipsoid:
    """Ellipsoid, axis-parallel unless `axes` (orthonormal rows) are given."""
    return Ellipsoid(np.array(centre, float), np.array(radii, float), np.eye(3) if axes is None else axes)


@dataclass(frozen=True, eq=False)
class Part:
    """One step of building a solid."""

    solid: Tube | Ellipsoid
    """What is added or taken away."""
    blend: float
    """Blend width in model units."""
    carve: bool = False
    """Take the solid away instead of adding it."""


def _box(points: Float[np.ndarray, "n 3"]) -> tuple[np.ndarray, np.ndarray]:
    columns = points.T
    return np.array([c.min() for c in columns]), np.array([c.max() for c in columns])


def _morton_code(points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    """Position along a space-filling curve (6 bits per axis), so that points close in order are close in space."""
    low, high = _box(points)
    width = float((high - low).max()) or 1.0
    spread = np.array([sum(((k >> bit) & 1) << (3 * bit) for bit in range(6)) for k in range(64)])
    code = np.zeros(len(points), np.int64)
    for axis in range(3):
        cell = ((points[:, axis] - low[axis]) * (63.999 / width)).astype(np.int64)
        code |= spread[cell] << axis
    return code


def build(solids: Sequence[Sequence[Part]], points: Float[np.ndarray, "n 3"], band: float) -> Float[np.ndarray, "s n"]:
    """Field of each solid, built from its parts in order, right within `band` of its surface.

    Works on bundles of neighbouring points, so that a part costs nothing where it is out of reach.
    """
    order = np.argsort(_morton_code(points), kind="stable")
    fields = np.empty((len(solids), len(points)))
    for start in range(0, len(points), BUNDLE):
        bundle = order[start : start + BUNDLE]
        near = points[bundle]
        for field, parts in zip(fields, solids, strict=True):
            field[bundle] = _build_bundle(parts, near, band)
    return fields


def _build_bundle(parts: Sequence[Part], points: Float[np.ndarray, "n 3"], band: float) -> Float[np.ndarray, " n"]:
    field = np.full(len(points), FAR)
    low, high = _box(points)
    for part in parts:
        reach = part.blend + band
        part_low, part_high = part.solid.bounds
        if (part_low - reach > high).any() or (part_high + reach < low).any():
            continue
        value = part.solid.distance(points, reach)
        field = smooth_max(field, -value, part.blend) if part.carve else smooth_min(field, value, part.blend)
    return field
