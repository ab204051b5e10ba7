"""Unfolding a plane mesh by moving its interior nodes only."""

from enum import Enum

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize

from drl_meshgen.templates.energy import Corners, corner_operator, total_energy
from drl_meshgen.templates.mesh import TemplateMesh
from drl_meshgen.templates.score import jacobians
from drl_meshgen.templates.tutte import tutte

#: Weight of equal size against shape while unfolding (dimensionless).
SIZE_WEIGHT = 0.2


class Outcome(Enum):
    """Verdict on a filled domain."""

    VALID = "every cell is valid as instantiated"
    UNTANGLED = "cells were folded; moving interior nodes made every cell valid"
    FOLDED = "some cells are folded; choose other boundary nodes or split the domain"


def untangle(
    mesh: TemplateMesh, boundary: int, size: Float[np.ndarray, " p"], rounds: int = 12, iterations: int = 120
) -> tuple[TemplateMesh, Outcome]:
    """Return the mesh with interior nodes moved to least regularised energy, and its verdict.

    The first `boundary` points stay. `size` is the wanted edge length at each point. The regularisation shrinks with
    the worst Jacobian from round to round (Garanzha et al. 2021) until every cell is valid; where the mesh as it is
    leads nowhere, Tutte's embedding is a second start.
    """
    if mesh.valid:
        return mesh, Outcome.VALID
    topology = mesh.blocks.mesh.topology
    angle = np.where(np.arange(len(mesh.points)) < boundary, np.pi / 2, 2 * np.pi / topology.valence)
    side = np.repeat(size[mesh.quads].mean(axis=1), 4)
    corners = Corners.wanted(side, side, angle[mesh.quads].ravel())
    points = _descend(mesh.points, mesh.quads, boundary, corners, rounds, iterations)
    if points is None:
        start = tutte(mesh.points[:boundary], topology.edges, len(mesh.points))
        points = _descend(start, mesh.quads, boundary, corners, rounds, iterations)
    if points is None:
        return mesh, Outcome.FOLDED
    return TemplateMesh(points, mesh.grids), Outcome.UNTANGLED


def _descend(
    start: Float[np.ndarray, "p 2"],
    quads: Int[np.ndarray, "m 4"],
    boundary: int,
    corners: Corners,
    *schedule: int,
) -> Float[np.ndarray, "p 2"] | None:
    """Return positions in which every cell is valid, or None; `schedule` is rounds and iterations per round."""
    rounds, iterations = schedule
    points = start.copy()
    operator = corner_operator(quads, len(points))
    inner, rim = operator[:, boundary:], operator[:, :boundary] @ points[:boundary]
    weight = np.full(4 * len(quads), 0.25 / len(quads))
    epsilon = 1.0
    for _ in range(rounds):
        det = jacobians(points, quads)
        if (det > 0).all():
            return points
        epsilon = min(epsilon / 2, float(np.hypot(1e-3, 0.2 * min(0.0, (det.ravel() * corners.scale).min()))))

        def objective(x: np.ndarray, epsilon: float = epsilon) -> tuple[float, np.ndarray]:
            value, slope = total_energy(rim + inner @ x.reshape(-1, 2), corners, weight, SIZE_WEIGHT, epsilon)
            return value, (inner.T @ slope).ravel()

        options = {"maxiter": iterations, "maxcor": 12}
        found = minimize(objective, points[boundary:].ravel(), jac=True, method="L-BFGS-B", options=options)
        points[boundary:] = found.x.reshape(-1, 2)
    return points if (jacobians(points, quads) > 0).all() else None
