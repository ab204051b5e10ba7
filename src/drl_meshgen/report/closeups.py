"""Close-ups of single quads as SVG: a handful of flat polygons needs no renderer."""

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh import QuadMesh
from drl_meshgen.quality import QuadShape
from drl_meshgen.quality.shape import unit
from drl_meshgen.report import palette

_SIDE, _ZOOM, _RINGS = 240, 2.6, 6


def draw_quad(mesh: QuadMesh, shape: QuadShape, quad: int) -> str:
    """Return one quad seen from straight above, in red, among its neighbours of a few rings, as an SVG document.

    What is farther from the eye is drawn first, the quad itself last.
    """
    corners, normal = shape.corners[quad], shape.normals[quad]
    centre = corners.mean(axis=0)
    up = corners[3] - corners[0]
    up = up - (up @ normal) * normal
    up = unit(up if up.any() else np.cross(normal, np.eye(3)[np.abs(normal).argmin()]))
    half = _ZOOM * float(np.linalg.norm(corners - centre, axis=1).max())
    near = _around(mesh, quad)
    seen = (mesh.points[mesh.quads[near]] - centre) @ np.c_[np.cross(up, normal), -up, normal]
    flat = _SIDE / 2 * (1 + seen[..., :2] / half)
    inside = ((flat.max(axis=1) > 0) & (flat.min(axis=1) < _SIDE)).all(axis=1)
    order = np.lexsort((near, seen[..., 2].mean(axis=1), near == quad))
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_SIDE} {_SIDE}" stroke-linejoin="round">',
            f'<rect width="{_SIDE}" height="{_SIDE}" fill="#fff"/>',
            f'<g fill="{palette.PLAIN}" stroke="{palette.LINE}">',
            *(_polygon(flat[k]) for k in order[:-1] if inside[k]),
            "</g>",
            f'<g fill="{palette.WORST}" stroke="{palette.INK}" stroke-width="1.5">',
            _polygon(flat[order[-1]]),
            "</g>",
            "</svg>",
            "",
        ]
    )


def _around(mesh: QuadMesh, quad: int) -> Int[np.ndarray, " n"]:
    """Return the quad with the rings around it, ascending."""
    near = np.array([quad])
    for _ in range(_RINGS):
        near = np.union1d(near, mesh.topology.neighbours[near])
        near = near[near >= 0]
    return near


def _polygon(points: Float[np.ndarray, "n 2"]) -> str:
    return f'<polygon points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in points.tolist())}"/>'
