"""The inverse map: from the charts of the pieces back to the surface."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.assembly import Assembly
from drl_meshgen.decompose import Layout
from drl_meshgen.lift.locate import locate, locate_in_ring
from drl_meshgen.mesh import BlockMesh, TriMesh
from drl_meshgen.quality.closest import TriangleSearch


@dataclass(frozen=True, eq=False)
class LiftedMesh:
    """A block mesh on the surface; `triangle (n,)` is the surface triangle that holds each node."""

    mesh: BlockMesh
    triangle: Int[np.ndarray, " n"]


def inverse_map(surface: TriMesh, layout: Layout, assembly: Assembly) -> LiftedMesh:
    """Map every node from the chart that holds it to the surface (piecewise linear, by barycentric coordinates)."""
    points = np.empty((len(assembly.piece), 3))
    pieces = layout.pieces
    total = len(pieces.rings) + len(pieces.caps) + len(pieces.strips)
    order = np.argsort(assembly.piece, kind="stable")
    bounds = np.searchsorted(assembly.piece[order], np.arange(total + 1))
    for k in range(total):
        ids = order[bounds[k] : bounds[k + 1]]
        if not len(ids):
            continue
        points[ids] = _lift(layout, k, assembly.chart[ids])
    return LiftedMesh(BlockMesh(points, assembly.grids), TriangleSearch(surface.corners)(points)[1])


def _lift(layout: Layout, k: int, chart: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    rings = layout.pieces.rings
    if k < len(rings):
        mesh = rings[k].mesh
        triangle, bary = locate_in_ring(rings[k].chart.theta_corner, rings[k].chart.h[mesh.triangles], chart)
    else:
        disk = (*layout.pieces.caps, *layout.pieces.strips)[k - len(rings)]
        mesh = disk.mesh
        triangle, bary = locate(disk.plane[mesh.triangles], chart)
    return np.einsum("qk,qkd->qd", bary, mesh.corners[triangle])
