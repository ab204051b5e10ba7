"""Plane quality figures of the template reward (paper eqs. 11-15), vectorised over leading axes of `points`."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.templates.domain import cross

#: Jacobians below this share of the squared mean side length of their quad are penalised while learning.
LEAST_JACOBIAN = 0.15
#: What a Jacobian counts for each unit it falls short of that.
PENALTY = 10.0


@dataclass(frozen=True)
class Weights:
    """Weights of the reward (paper section 6.2.1); each pair sums to 1."""

    quality: float = 0.8
    """Weight of the quality of the quads."""
    fidelity: float = 0.2
    """Weight of the fit to the boundary samples."""
    orthogonality: float = 0.6
    """Weight of angles within the quality."""
    jacobian: float = 0.4
    """Weight of the Jacobian ratio within the quality."""


def corner_edges(points: Float[np.ndarray, "*b p 2"], quads: Int[np.ndarray, "m 4"]) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges to the next and the previous corner, each (..., m, 4, 2), at every corner of every quad."""
    corner = points[..., quads, :]
    ahead = np.roll(corner, -1, axis=-2) - corner
    return ahead, -np.roll(ahead, 1, axis=-2)


def jacobians(points: Float[np.ndarray, "*b p 2"], quads: Int[np.ndarray, "m 4"]) -> Float[np.ndarray, "*b m 4"]:
    """Return the Jacobian determinant at each corner (area units), positive for anti-clockwise convex quads."""
    return cross(*corner_edges(points, quads))


def jacobian_ratio(points: Float[np.ndarray, "*b p 2"], quads: Int[np.ndarray, "m 4"]) -> Float[np.ndarray, "*b m"]:
    """Return `min J / max J` of each quad (eq. 12); 0 where a corner Jacobian is not positive."""
    j = jacobians(points, quads)
    low, high = j.min(axis=-1), j.max(axis=-1)
    return np.where(low > 0, low / np.where(high > 0, high, 1.0), 0.0)


def angle_defects(points: Float[np.ndarray, "*b p 2"], quads: Int[np.ndarray, "m 4"]) -> Float[np.ndarray, "*b m 4"]:
    """Return `|pi/2 - theta|` at each corner in radians; reflex angles count in full, up to 3 pi / 2."""
    ahead, behind = corner_edges(points, quads)
    theta = np.arctan2(cross(ahead, behind), (ahead * behind).sum(axis=-1))
    return np.abs(np.pi / 2 - np.where(theta < 0, theta + 2 * np.pi, theta))


def orthogonality(points: Float[np.ndarray, "*b p 2"], quads: Int[np.ndarray, "m 4"]) -> Float[np.ndarray, "*b m"]:
    """Return `1 - (2/pi) max |pi/2 - theta|` of each quad: the worst corner counts (eq. 11 prints the best)."""
    return 1 - 2 / np.pi * angle_defects(points, quads).max(axis=-1)


def orthogonality_printed(points: Float[np.ndarray, "*b p 2"], quads: Int[np.ndarray, "m 4"]) -> np.ndarray:
    """Return eq. 11 as printed, `1 - (2/pi) min |pi/2 - theta|`, (..., m)."""
    return 1 - 2 / np.pi * angle_defects(points, quads).min(axis=-1)


def boundary_mse(mesh_nodes: Float[np.ndarray, "a 2"], samples: Float[np.ndarray, "b 2"]) -> float:
    """Return the mean squared distance from each boundary sample to the nearest boundary node of the mesh (eq. 14)."""
    return float(((samples[:, None] - mesh_nodes[None]) ** 2).sum(axis=-1).min(axis=1).mean())


def reward(
    points: Float[np.ndarray, "*b p 2"],
    quads: Int[np.ndarray, "m 4"],
    mse: float = 0.0,
    spacing: float = 1.0,
    weights: Weights | None = None,
) -> Float[np.ndarray, "*b"]:
    """Return `R = 0.8 (0.6 O + 0.4 J) - 0.2 MSE / h^2` (eqs. 13, 15), `h` the mean boundary spacing.

    `weights` replaces the numbers. Templates that keep the boundary nodes have MSE 0.
    """
    w = weights or Weights()
    shape = w.orthogonality * orthogonality(points, quads) + w.jacobian * jacobian_ratio(points, quads)
    return w.quality * shape.mean(axis=-1) - w.fidelity * mse / spacing**2


def validity_penalty(points: Float[np.ndarray, "*b p 2"], quads: Int[np.ndarray, "m 4"]) -> Float[np.ndarray, "*b"]:
    """Return the mean over quads of `10 max(0, 0.15 - min J / s^2)`, `s` their mean side; 0 far from folding.

    Not in the paper, whose reward says nothing about how far a mesh is from being valid.
    """
    lack = np.maximum(LEAST_JACOBIAN - least_jacobian(points, quads), 0.0)
    return PENALTY * lack.mean(axis=-1)


def least_jacobian(points: Float[np.ndarray, "*b p 2"], quads: Int[np.ndarray, "m 4"]) -> Float[np.ndarray, "*b m"]:
    """Return the least corner Jacobian of each quad over its squared mean side: 1 for a square, positive if valid."""
    ahead, behind = corner_edges(points, quads)
    side = np.linalg.norm(ahead, axis=-1).mean(axis=-1)
    return cross(ahead, behind).min(axis=-1) / side**2
