"""The unit hemisphere, triangulated directly."""

import numpy as np
from jaxtyping import Int

from drl_meshgen.mesh import TriMesh


def hemisphere(triangles: int) -> TriMesh:
    """Upper unit hemisphere, rim on the equator, about `triangles` nearly equilateral triangles.

    Vertices lie on circles of latitude (exactly on the sphere, the rim exactly on the unit circle), their number
    per circle proportional to its length, neighbouring circles shifted by half a spacing.
    """
    edge = np.sqrt(2 * np.pi * 4 / (np.sqrt(3) * triangles))
    rings = max(2, round(np.pi / 2 / (np.sqrt(3) / 2 * edge)))
    polar = np.pi / 2 * np.arange(1, rings + 1) / rings
    count = np.maximum(6, np.round(2 * np.pi * np.sin(polar) / edge)).astype(int)
    count[-1] += count[-1] % 2
    points, faces = [np.array([[0.0, 0.0, 1.0]])], []
    first, shift = 1, 0.0
    for i, (angle, n) in enumerate(zip(polar, count, strict=True)):
        last = i == rings - 1
        longitude = 2 * np.pi * (np.arange(n) + shift) / n
        height, radius = (0.0, 1.0) if last else (np.cos(angle), np.sin(angle))
        points.append(np.c_[radius * np.cos(longitude), radius * np.sin(longitude), np.full(n, height)])
        if i == 0:
            faces.append(np.c_[np.zeros(n, int), first + np.arange(n), first + (np.arange(n) + 1) % n])
        else:
            faces.append(_stitch((first - count[i - 1], count[i - 1], 0.5 - shift), (first, n, shift)))
        first, shift = first + n, 0.5 - shift
    return TriMesh(np.vstack(points), np.vstack(faces))


def _stitch(inner: tuple[int, int, float], outer: tuple[int, int, float]) -> Int[np.ndarray, "t 3"]:
    """Zip two rings (first vertex, number of vertices, shift): one triangle per edge of either ring.

    Edges are taken in the order of their mid-longitudes.
    """
    (a, n, shift_a), (b, m, shift_b) = inner, outer
    middle = np.r_[(np.arange(n) + shift_a + 0.5) / n, (np.arange(m) + shift_b + 0.5) / m]
    is_inner = np.r_[np.ones(n, bool), np.zeros(m, bool)]
    order = np.lexsort((is_inner, middle))
    is_inner = is_inner[order]
    i = (np.cumsum(is_inner) - is_inner) % n  # ring vertices reached before the edge
    j = (np.cumsum(~is_inner) - ~is_inner) % m
    apex = np.where(is_inner, a + (i + 1) % n, b + (j + 1) % m)
    return np.c_[a + i, b + j, apex]
