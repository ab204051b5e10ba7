"""Unfolding a plane mesh by moving its interior nodes only."""

from enum import Enum

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from drl_meshgen.templates.energy import Corners, corner_operator, total_energy
from drl_meshgen.templates.mesh import TemplateMesh
from drl_meshgen.templates.score import jacobians


class Outcome(Enum):
    """Verdict on a filled domain."""

    VALID = "every cell is valid as instantiated"
    UNTANGLED = "cells were folded; moving interior nodes made every cell valid"
    FOLDED = "some cells are folded; choose other boundary nodes or split the domain"


def untangle(
    mesh: TemplateMesh, boundary: int, size: Float[np.ndarray, " p"], rounds: int = 8, iterations: int = 60
) -> tuple[TemplateMesh, Outcome]:
    """Return the mesh with interior nodes moved to least regularised energy, and its verdict.

    The first `boundary` points stay. `size` is the wanted edge length at each point. The regularisation shrinks with
    the worst Jacobian from round to round (Garanzha et al. 2021) until every cell is valid.
    """
    if mesh.valid:
        return mesh, Outcome.VALID
    points, quads = mesh.points.copy(), mesh.quads
    valence = mesh.blocks.mesh.topology.valence
    angle = np.where(np.arange(len(points)) < boundary, np.pi / 2, 2 * np.pi / valence)
    local = size[quads].mean(axis=1)
    side = np.repeat(local, 4)
    corners = Corners.wanted(side, side, angle[quads].ravel())
    operator = corner_operator(quads, len(points))
    inner = operator[:, boundary:]
    rim = operator[:, :boundary] @ points[:boundary]
    weight = np.full(len(side), 1 / len(side))
    epsilon = 1.0
    for _ in range(rounds):
        worst = float((jacobians(points, quads).min(axis=1) / local**2).min())
        epsilon = min(epsilon / 2, float(np.sqrt(1e-6 + 0.04 * min(worst, 0.0) ** 2))) if worst < 0 else epsilon / 2

        def objective(x: np.ndarray, epsilon: float = epsilon) -> tuple[float, np.ndarray]:
            value, slope = total_energy(rim + inner @ x.reshape(-1, 2), corners, weight, 0.2, epsilon)
            return value, (inner.T @ slope).ravel()

        options = {"maxiter": iterations, "maxcor": 12}
        found = minimize(objective, points[boundary:].ravel(), jac=True, method="L-BFGS-B", options=options)
        points[boundary:] = found.x.reshape(-1, 2)
        if (jacobians(points, quads) > 0).all():
            return TemplateMesh(points, mesh.grids), Outcome.UNTANGLED
    return TemplateMesh(points, mesh.grids), Outcome.FOLDED
