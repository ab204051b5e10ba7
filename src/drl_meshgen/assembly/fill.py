"""Filling rings and caps with nodes in their charts and mapping them back to the surface."""

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from drl_meshgen.decompose import Cap
from drl_meshgen.decompose.cells import Ring
from drl_meshgen.lift.harmonic import disk_chart
from drl_meshgen.lift.locate import locate, locate_in_ring
from drl_meshgen.templates import FilledCap, Policy, fill_cap


def ring_nodes(
    ring: Ring, inner: Float[np.ndarray, " n"], outer: Float[np.ndarray, " n"], rows: int
) -> Float[np.ndarray, "r n 3"]:
    """Positions of the `rows - 1` inner rows of nodes of a ring, from theta of its columns on both loops.

    Rows are equally spaced in `h` and columns straight in the chart, so cells cannot overlap there.
    """
    share = (np.arange(1, rows) / rows)[:, None]
    theta = (1 - share) * inner[None, :] + share * outer[None, :]
    queries = np.c_[theta.ravel(), np.broadcast_to(share, theta.shape).ravel()]
    triangle, bary = locate_in_ring(ring.chart.theta_corner, ring.chart.h[ring.mesh.triangles], queries)
    return np.einsum("qk,qkd->qd", bary, ring.mesh.corners[triangle]).reshape(rows - 1, len(inner), 3)


def cap_nodes(
    cap: Cap, angle: Float[np.ndarray, " n"], vertex_angle: Float[np.ndarray, " b"], policy: Policy, spacing: float
) -> tuple[FilledCap, Float[np.ndarray, "p 3"]]:
    """Fill a cap by the O-type template: its mesh in the disk chart and the positions of its nodes on the surface.

    `vertex_angle` are the angles of the loop's vertices in the chart, `angle` those of the nodes, both increasing.
    """
    plane = disk_chart(cap.mesh, cap.loop, vertex_angle)
    edges = cap.mesh.topology.edges
    flat = np.linalg.norm(plane[edges[:, 1]] - plane[edges[:, 0]], axis=1)
    stretch = np.full(len(plane), 0.0)
    for k in range(2):
        stretch += np.bincount(edges[:, k], flat / cap.mesh.edge_lengths, len(plane))
    stretch /= np.maximum(cap.mesh.topology.valence, 1)
    tree = cKDTree(plane)

    def size(points: np.ndarray) -> np.ndarray:
        return spacing * stretch[tree.query(points)[1]]

    filled = fill_cap(np.c_[np.cos(angle), np.sin(angle)], policy, size=size)
    triangle, bary = locate(plane[cap.mesh.triangles], filled.points)
    return filled, np.einsum("qk,qkd->qd", bary, cap.mesh.corners[triangle])
