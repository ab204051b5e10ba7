"""Closed surfaces with a known number of handles."""

import numpy as np

from drl_meshgen.mesh import TriMesh
from tests.chains import tube


def voxel_surface(full: np.ndarray, relax: int = 0) -> TriMesh:
    """Boundary of a solid of unit cubes (bool array), normals outwards, after `relax` averages over neighbours.

    Cubes must not meet along an edge or at a corner only.
    """
    solid = np.pad(full, 1)
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for step in (1, -1):
            cells = np.argwhere(solid & ~np.roll(solid, -step, axis=axis))
            corner = np.repeat(cells[:, None, :], 4, axis=1)
            corner[:, :, axis] += step > 0
            turn = [(0, 0), (1, 0), (1, 1), (0, 1)][::step]
            for k, (a, b) in enumerate(turn):
                corner[:, k, u] += a
                corner[:, k, v] += b
            quads.append(corner)
    points, ids = np.unique(np.concatenate(quads).reshape(-1, 3), axis=0, return_inverse=True)
    q = ids.reshape(-1, 4)
    mesh = TriMesh(points.astype(float), np.r_[q[:, [0, 1, 2]], q[:, [0, 2, 3]]])
    a, b = mesh.topology.edges.T
    points = mesh.vertices.copy()
    for _ in range(relax):
        total = np.zeros_like(points)
        np.add.at(total, a, points[b])
        np.add.at(total, b, points[a])
        points = 0.5 * points + 0.5 * total / mesh.topology.valence[:, None]
    return TriMesh(points, mesh.triangles)


def pierced_plate(holes: int, wide: int = 6) -> TriMesh:
    """Plate with square holes through it, smoothed: genus `holes`. Its bars are `wide` cubes across."""
    full = np.ones((2 * wide * holes + wide, 3 * wide, 4), bool)
    for k in range(holes):
        full[wide + 2 * wide * k : 2 * wide + 2 * wide * k, wide : 2 * wide] = False
    return voxel_surface(full, relax=4)


def tapered_torus(n: int = 60, m: int = 24, thin: float = 0.5) -> TriMesh:
    """Torus of radius 3 whose tube has radius 1, but `thin` at (3, 0, 0)."""
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    s, t = 2 * np.pi * (i + 0.5 * (j % 2)) / n, 2 * np.pi * j / m
    r = (1 + thin) / 2 - (1 - thin) / 2 * np.cos(s)
    points = np.stack([(3 + r * np.cos(t)) * np.cos(s), (3 + r * np.cos(t)) * np.sin(s), r * np.sin(t)], -1)
    node = lambda a, b: (a % n) * m + b % m  # noqa: E731
    a, b, c, d = node(i, j), node(i + 1, j), node(i, j + 1), node(i + 1, j + 1)
    even = (j % 2 == 0)[..., None]
    one = np.where(even, np.stack([a, b, c], -1), np.stack([a, b, d], -1))
    two = np.where(even, np.stack([b, d, c], -1), np.stack([a, d, c], -1))
    return TriMesh(points.reshape(-1, 3), np.concatenate([one, two]).reshape(-1, 3))


def spindle(radius: np.ndarray, height: np.ndarray, around: int = 24) -> TriMesh:
    """Closed surface of revolution about z, its first and last ring closed by a fan; normals outwards."""
    side = tube(around, len(radius) - 1, radius, height)
    n, last = len(side.vertices), len(side.vertices) - around
    k = np.arange(around)
    low = np.c_[np.full(around, n), (k + 1) % around, k]
    high = np.c_[np.full(around, n + 1), last + k, last + (k + 1) % around]
    poles = [[0, 0, height[0]], [0, 0, height[-1]]]
    return TriMesh(np.vstack([side.vertices, poles]), np.vstack([side.triangles, low, high]))


def sphere(rows: int = 20) -> TriMesh:
    """Unit sphere."""
    polar = np.pi * (np.arange(rows) + 0.5) / rows
    return spindle(np.sin(polar)[::-1], np.cos(polar)[::-1], 2 * rows)


def side_by_side(*meshes: TriMesh) -> TriMesh:
    """One mesh of several, apart from one another."""
    points, triangles, count, right = [], [], 0, 0.0
    for mesh in meshes:
        points.append(mesh.vertices + np.array([right - mesh.vertices[:, 0].min(), 0, 0]))
        triangles.append(mesh.triangles + count)
        count += len(mesh.vertices)
        right = points[-1][:, 0].max() + 1
    return TriMesh(np.vstack(points), np.vstack(triangles))
