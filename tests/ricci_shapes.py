"""Surfaces with known conformal maps, for the tests of the Ricci flow."""

import numpy as np
from scipy.spatial import Delaunay

from drl_meshgen.mesh import TriMesh


def planar_disk(n: int, seed: int = 0) -> TriMesh:
    """Flat unit disk: `n` points on the rim, about `n * n / 12` scattered inside, Delaunay triangles."""
    rng = np.random.default_rng(seed)
    t = 2 * np.pi * np.arange(n) / n
    rim = np.c_[np.cos(t), np.sin(t)]
    inner = rng.uniform(-1, 1, (int(n * n / 9), 2)) * 0.97
    inner = inner[np.hypot(*inner.T) < 1 - np.pi / n]
    points = np.r_[rim, inner]
    triangles = Delaunay(points).simplices.astype(np.int64)
    return TriMesh(np.c_[points, np.zeros(len(points))], _anticlockwise(points, triangles))


def bumpy_disk(n: int, seed: int, height: float) -> TriMesh:
    """Graph of random bumps over the unit disk, Delaunay in the plane but not on the surface."""
    flat = planar_disk(n, seed)
    rng = np.random.default_rng(seed + 1)
    wave, phase = rng.normal(0, 3, (4, 2)), rng.uniform(0, 6, 4)
    z = height * np.sin(flat.vertices[:, :2] @ wave.T + phase).sum(axis=1) / 2
    return TriMesh(np.c_[flat.vertices[:, :2], z], flat.triangles)


def spherical_cap(n: int, degrees: float) -> tuple[TriMesh, np.ndarray]:
    """Cap of the unit sphere around the south pole, and its exact u.

    Stereographic projection from the north pole N scales a chord PQ by c / (|PN| |QN|): it is discretely conformal
    with u = const - 2 log |PN|, and u is constant on the rim. Rings of `n` vertices in geometric progression in the
    plane make near-equilateral triangles there and on the sphere.
    """
    rings = round(1.2 * n)
    radius = 2 * np.tan(np.radians(degrees) / 2) * np.exp(-np.sqrt(3) * np.pi / n * np.arange(rings))
    turn = 2 * np.pi * (np.arange(n) + 0.5 * np.arange(rings)[:, None]) / n
    plane = np.r_[np.c_[(radius[:, None] * np.cos(turn)).ravel(), (radius[:, None] * np.sin(turn)).ravel()], [[0, 0]]]
    triangles = Delaunay(plane).simplices.astype(np.int64)
    square = (plane**2).sum(axis=1)
    sphere = np.c_[4 * plane, square - 4] / (square + 4)[:, None]
    to_north = np.linalg.norm(sphere - [0, 0, 1], axis=1)
    return TriMesh(sphere, _anticlockwise(plane, triangles)), 2 * np.log(to_north[:n].mean() / to_north)


def capsule(around: int, length: float) -> tuple[TriMesh, np.ndarray]:
    """Cylinder of radius 1 with a hemispherical end, open at the other, and the exact u of the smooth surface.

    On the cylinder u falls by one per radius of depth; on the hemisphere it is that of the stereographic projection.
    """
    rows = round(length * around / (2 * np.pi))
    cap_rows = round(around / 4)
    depth = length * np.arange(rows + 1) / rows
    angle = np.pi / 2 * np.arange(1, cap_rows) / cap_rows
    radius = np.r_[np.ones(rows + 1), np.cos(angle)]
    z = np.r_[-depth, -length - np.sin(angle)]
    north = np.hypot(np.cos(angle), 1 + np.sin(angle))
    u = np.r_[-depth, -length + 2 * np.log(np.sqrt(2) / north), -length - np.log(2)]
    turn = 2 * np.pi * (np.arange(around) + 0.5 * np.arange(len(z))[:, None]) / around
    rings = np.stack([radius[:, None] * np.cos(turn), radius[:, None] * np.sin(turn), z[:, None] + 0 * turn], axis=-1)
    vertices = np.r_[rings.reshape(-1, 3), [[0, 0, -length - 1]]]
    ids = np.arange(len(z) * around).reshape(len(z), around)
    a, b = ids[:-1], np.roll(ids[:-1], -1, axis=1)
    c, d = ids[1:], np.roll(ids[1:], -1, axis=1)
    tip = np.full(around, len(vertices) - 1)
    triangles = [np.stack([a, c, b], axis=-1), np.stack([b, c, d], axis=-1)]
    last = np.stack([ids[-1], tip, np.roll(ids[-1], -1)], axis=-1)
    return TriMesh(vertices, np.concatenate([t.reshape(-1, 3) for t in (*triangles, last)])), np.r_[
        np.repeat(u[:-1], around), u[-1]
    ]


def annulus(n: int, height: float = 0.3) -> TriMesh:
    """Wavy ring between radii 1 and 2: Euler number 0, two loops."""
    radius, turn = np.meshgrid(np.linspace(1, 2, n // 4 + 1), 2 * np.pi * np.arange(n) / n, indexing="ij")
    z = height * np.sin(3 * turn) * np.sin(4 * radius)
    vertices = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=-1).reshape(-1, 3)
    ids = np.arange(len(vertices)).reshape(radius.shape)
    a, b = ids[:-1], np.roll(ids[:-1], -1, axis=1)
    c, d = ids[1:], np.roll(ids[1:], -1, axis=1)
    triangles = np.concatenate([np.stack([a, c, b], axis=-1), np.stack([b, c, d], axis=-1)]).reshape(-1, 3)
    return TriMesh(vertices, triangles)


def three_sided_tube(rings: int) -> TriMesh:
    """Tube whose rings have three vertices, open at both ends: every inner ring is a neck."""
    turn = 2 * np.pi * np.arange(3) / 3
    ring = np.c_[np.cos(turn), np.sin(turn)]
    vertices = np.concatenate([np.c_[ring, np.full(3, float(k))] for k in range(rings)])
    ids = np.arange(3 * rings).reshape(rings, 3)
    a, b = ids[:-1], np.roll(ids[:-1], -1, axis=1)
    c, d = ids[1:], np.roll(ids[1:], -1, axis=1)
    return TriMesh(
        vertices, np.concatenate([np.stack([a, b, c], axis=-1), np.stack([b, d, c], axis=-1)]).reshape(-1, 3)
    )


def icosahedron() -> TriMesh:
    """Closed surface of 20 triangles."""
    golden = (1 + np.sqrt(5)) / 2
    base = np.array([[0, s, t * golden] for s in (-1, 1) for t in (-1, 1)])
    vertices = np.concatenate([np.roll(base, k, axis=1) for k in range(3)])
    near = np.linalg.norm(vertices[:, None] - vertices, axis=-1) < 2.1
    triples = [
        (i, j, k) for i in range(12) for j in range(i) for k in range(j) if near[i, j] and near[j, k] and near[i, k]
    ]
    triangles = np.array(triples)
    inward = np.linalg.det(vertices[triangles]) < 0
    triangles[inward] = triangles[inward][:, [0, 2, 1]]
    return TriMesh(vertices, triangles)


def _anticlockwise(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b = (points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2))
    clockwise = a[:, 0] * b[:, 1] < a[:, 1] * b[:, 0]
    return np.where(clockwise[:, None], triangles[:, [0, 2, 1]], triangles)
