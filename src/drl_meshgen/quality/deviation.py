"""Distances between a mesh and the surface it stands for."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from drl_meshgen.mesh import QuadMesh, TriMesh
from drl_meshgen.quality.closest import TriangleSearch, closest_on_segments

_PLASTIC = 1.32471795724474602596  # its powers give the two-dimensional golden-ratio sequence


@dataclass(frozen=True)
class Deviation:
    """Two-sided distances as a fraction of the bounding-box diagonal of the surface; NaN where there is no boundary."""

    surface: float
    surface_rms: float
    nodes: float
    boundary: float
    boundary_rms: float


def as_triangles(mesh: QuadMesh) -> Int[np.ndarray, "2m 3"]:
    """Return the quads split along their first diagonal."""
    return np.concatenate([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]])


def area_samples(corners: Float[np.ndarray, "f 3 3"], count: int) -> Float[np.ndarray, "count 3"]:
    """Return `count` points spread evenly over the triangles, without a random number.

    Triangles are hit at equal steps of their accumulated area; the place inside follows the low-discrepancy
    sequence of the plastic number.
    """
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    total = np.cumsum(area)
    pick = np.searchsorted(total, (np.arange(count) + 0.5) / count * total[-1])
    pick = np.minimum(pick, len(corners) - 1)
    n = np.arange(1, count + 1)
    u, v = (0.5 + n / _PLASTIC) % 1, (0.5 + n / _PLASTIC**2) % 1
    beyond = u + v > 1
    u, v = np.where(beyond, 1 - u, u), np.where(beyond, 1 - v, v)
    p = corners[pick]
    return p[:, 0] + u[:, None] * (p[:, 1] - p[:, 0]) + v[:, None] * (p[:, 2] - p[:, 0])


def _along(a: np.ndarray, b: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Points on the segments at most `step` apart, both ends included, and the segment of each."""
    count = np.maximum(2, np.ceil(np.linalg.norm(b - a, axis=1) / step).astype(int) + 1)
    segment = np.repeat(np.arange(len(a)), count)
    rank = np.arange(len(segment)) - np.repeat(np.cumsum(count) - count, count)
    t = rank / (count[segment] - 1)
    return a[segment] + t[:, None] * (b - a)[segment], segment


def _curve_distance(
    queries: np.ndarray, a: np.ndarray, b: np.ndarray, samples: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    points, segment = samples
    near = segment[KDTree(points).query(queries, k=4)[1]]
    closest = closest_on_segments(np.broadcast_to(queries[:, None], (*near.shape, 3)), a[near], b[near])
    return np.linalg.norm(closest - queries[:, None], axis=2).min(axis=1)


def boundary_distances(
    points: Float[np.ndarray, "n 3"], rim: Int[np.ndarray, "b 2"], surface: TriMesh
) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances from boundary edges to the surface's boundary and back, each 1/2000 of the diagonal."""
    p, q = (points[rim[:, k]] for k in range(2))
    r, s = (surface.vertices[surface.topology.boundary_edges[:, k]] for k in range(2))
    step = surface.diagonal / 2000
    mine, theirs = _along(p, q, step), _along(r, s, step)
    return _curve_distance(mine[0], r, s, theirs), _curve_distance(theirs[0], p, q, mine)


def boundary_mse(
    points: Float[np.ndarray, "n 3"], rim: Int[np.ndarray, "b 2"], surface: TriMesh
) -> tuple[float, float]:
    """Return eq. 14's mean squared distance of surface boundary vertices to mesh boundary nodes, and exp(-MSE / h^2).

    `h` is the mean spacing of the mesh's boundary nodes. The first is relative to the squared diagonal. Both are NaN
    where either has no boundary.
    """
    on_boundary = surface.topology.on_boundary
    if not len(rim) or not on_boundary.any():
        return np.nan, np.nan
    ends = points[rim]
    mse = float((KDTree(ends[:, 0]).query(surface.vertices[on_boundary])[0] ** 2).mean())
    spacing = float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean())
    return mse / surface.diagonal**2, float(np.exp(-mse / spacing**2))


def deviation(
    mesh: QuadMesh,
    surface: TriMesh,
    rim: Int[np.ndarray, "b 2"],
    search: TriangleSearch | None = None,
    triangles: Int[np.ndarray, "t 3"] | None = None,
    *,
    samples: int = 12000,
) -> Deviation:
    """Return Hausdorff and RMS distances between mesh and surface and between their boundaries.

    `rim` are the boundary edges of the mesh. `search` is a search structure of the surface, if there is one already;
    `triangles` are faces of a mixed mesh beside its quads. Each side is sampled at its nodes (largest distance) and
    `samples` points spread by area.
    """
    search = search or TriangleSearch(surface.corners)
    faces = as_triangles(mesh) if triangles is None else np.concatenate([as_triangles(mesh), triangles])
    mine = mesh.points[faces]
    nodes = search(mesh.points[np.unique(faces)])[0]
    there = search(area_samples(mine, samples))[0]
    back = TriangleSearch(mine)(area_samples(surface.corners, samples))[0]
    d = surface.diagonal
    boundary = boundary_rms = np.nan
    if len(rim) and len(surface.topology.boundary_edges):
        out, home = boundary_distances(mesh.points, rim, surface)
        boundary = max(out.max(), home.max()) / d
        boundary_rms = np.sqrt(((out**2).mean() + (home**2).mean()) / 2) / d
    return Deviation(
        surface=float(max(nodes.max(), there.max(), back.max()) / d),
        surface_rms=float(np.sqrt(((there**2).mean() + (back**2).mean()) / 2) / d),
        nodes=float(nodes.max() / d),
        boundary=float(boundary),
        boundary_rms=float(boundary_rms),
    )
