"""What the tables of plane meshes show (paper section 6.1.2), by the same definitions for every method."""

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh import QuadMesh
from drl_meshgen.quality.metrics import line_smoothness
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.score import (
    Weights,
    angle_defects,
    boundary_mse,
    jacobian_ratio,
    jacobians,
    orthogonality,
    orthogonality_printed,
    reward,
)

COMPLIANT = np.pi / 12
"""Deviation of every corner from a right angle below which a quad complies, radians."""


def plane_metrics(
    domain: Domain, points: Float[np.ndarray, "p 2"], quads: Int[np.ndarray, "m 4"], weights: Weights | None = None
) -> dict[str, float]:
    """Measure a quad mesh of a domain, ours or a rival's; definitions are in docs/metrics.md.

    Orientation counts: a clockwise quad is not valid. `boundary_error` is the mean squared distance from the domain's
    nodes to the nearest boundary node of the mesh (eq. 14), in squared mean spacings of the domain, as in the reward.
    """
    mesh = QuadMesh(np.column_stack([points, np.zeros(len(points))]), quads)
    rim = points[np.unique(mesh.topology.boundary_edges)]
    spacing = float(domain.lengths.mean())
    mse = boundary_mse(rim, domain.nodes)
    valid = (jacobians(points, quads) > 0).all(axis=-1)
    smoothness, edge_ratio = line_smoothness(mesh)
    return {
        "quads": float(len(quads)),
        "orthogonality": float(orthogonality(points, quads).mean()),
        "orthogonality_printed": float(orthogonality_printed(points, quads).mean()),
        "compliance": float((angle_defects(points, quads).max(axis=-1) < COMPLIANT).mean()),
        "jacobian_ratio": float(jacobian_ratio(points, quads).mean()),
        "smoothness": smoothness,
        "edge_ratio": edge_ratio,
        "validity": float(valid.mean()),
        "valid": float(valid.all()),
        "boundary_error": mse / spacing**2,
        "boundary_fit": float(np.exp(-mse / spacing**2)),
        "reward": float(reward(points, quads, mse, spacing, weights)),
    }
