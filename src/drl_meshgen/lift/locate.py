"""Points of a chart back on the surface (inverse map)."""

import numpy as np
from jaxtyping import Float, Int


def locate(corners: Float[np.ndarray, "f 3 2"], queries: Float[np.ndarray, "q 2"]) -> tuple[np.ndarray, np.ndarray]:
    """Triangle `(q,)` that holds each query and barycentric coordinates `(q, 3)`; the nearest one when none does."""
    import pyvista as pv

    points = np.zeros((corners.shape[0] * 3, 3))
    points[:, :2] = corners.reshape(-1, 2)
    sheet = pv.PolyData.from_regular_faces(points, np.arange(len(points)).reshape(-1, 3))
    wanted = np.c_[queries, np.zeros(len(queries))]
    triangle = np.asarray(sheet.find_closest_cell(wanted), np.int64)
    bary = barycentric(corners[triangle], queries)
    return triangle, bary


def barycentric(corners: Float[np.ndarray, "q 3 2"], points: Float[np.ndarray, "q 2"]) -> Float[np.ndarray, "q 3"]:
    """Barycentric coordinates of planar points, clipped to the triangle."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    cross = lambda u, v: u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]  # noqa: E731
    area = cross(b - a, c - a)
    area = np.where(np.abs(area) > np.finfo(float).tiny, area, 1.0)
    w = np.c_[cross(b - points, c - points), cross(c - points, a - points), cross(a - points, b - points)]
    w = np.clip(w / area[:, None], 0, None)
    total = w.sum(1, keepdims=True)
    return np.where(total > 0, w / np.where(total > 0, total, 1.0), 1 / 3)


def locate_in_ring(
    theta_corner: Float[np.ndarray, "f 3"],
    h_corner: Float[np.ndarray, "f 3"],
    queries: Float[np.ndarray, "q 2"],
) -> tuple[Int[np.ndarray, " q"], Float[np.ndarray, "q 3"]]:
    """`locate` for `(theta, h)` with period 1 in theta."""
    low = theta_corner.min()
    turns = int(np.ceil(theta_corner.max() - low))
    sheets = np.concatenate([np.stack([theta_corner + s, h_corner], axis=-1) for s in range(-turns, turns + 1)])
    start = np.floor(low) + turns - 1
    moved = np.c_[(queries[:, 0] - start) % 1.0 + start, queries[:, 1]]
    keep = np.nonzero((sheets[..., 0].max(1) >= start - 0.1) & (sheets[..., 0].min(1) <= start + 1.1))[0]
    triangle, bary = locate(sheets[keep], moved)
    return keep[triangle] % len(theta_corner), bary
