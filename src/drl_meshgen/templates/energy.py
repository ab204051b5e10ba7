"""Regularised shape and size energy of plane quads: finite for folded cells, so that a descent unfolds them.

At each corner `J = E M` with `E` the two corner edges as columns and `M` the inverse of the wanted ones;
`(|J|^2 + s (1 + det^2)) / (2 chi)`, `chi = (det + sqrt(eps^2 + det^2)) / 2` (Garanzha et al. 2021, eq. 4). It is least,
1 + s, where the corner is the wanted one.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_matrix


def corner_energy(
    edges: Float[np.ndarray, "*b 2 2"], target: Float[np.ndarray, "*b 2 2"], size_weight: float, epsilon: float
) -> tuple[Float[np.ndarray, "*b"], Float[np.ndarray, "*b 2 2"]]:
    """Return the energy of each corner and its gradient in `edges` (rows: coordinate; columns: the two edges)."""
    jacobian = edges @ target
    a, b, c, d = jacobian[..., 0, 0], jacobian[..., 0, 1], jacobian[..., 1, 0], jacobian[..., 1, 1]
    det = a * d - b * c
    root = np.sqrt(epsilon**2 + det**2)
    # the two forms agree; the second does not cancel for det < 0
    chi = np.where(det > 0, (det + root) / 2, epsilon**2 / (2 * (root + np.abs(det))))
    energy = ((jacobian**2).sum(axis=(-2, -1)) + size_weight * (1 + det**2)) / (2 * chi)
    in_det = size_weight * det / chi - energy / root
    cofactor = np.stack([np.stack([d, -c], axis=-1), np.stack([-b, a], axis=-1)], axis=-2)
    gradient = jacobian / chi[..., None, None] + in_det[..., None, None] * cofactor
    return energy, gradient @ np.swapaxes(target, -2, -1)


def wanted(
    first: Float[np.ndarray, "*b"], second: Float[np.ndarray, "*b"], angle: Float[np.ndarray, "*b"]
) -> Float[np.ndarray, "*b 2 2"]:
    """Return the inverse of the matrix whose columns are edges of these lengths at `angle` radians (eq. above: `M`)."""
    zero = np.zeros(np.broadcast_shapes(np.shape(first), np.shape(second), np.shape(angle)))
    row = np.stack([1 / first + zero, -1 / (first * np.tan(angle)) + zero], axis=-1)
    return np.stack([row, np.stack([zero, 1 / (second * np.sin(angle)) + zero], axis=-1)], axis=-2)


def corner_operator(quads: Int[np.ndarray, "m 4"], size: int) -> csr_matrix:
    """Return the (8 m, size) matrix from points to corner edges: row `8 q + 2 c` is the edge of corner `c` ahead."""
    ahead, behind = np.roll(quads, -1, axis=1), np.roll(quads, 1, axis=1)
    head = np.stack([ahead, behind], axis=-1).ravel()
    tail = np.repeat(quads.ravel(), 2)
    rows = np.arange(len(head))
    data = np.concatenate([np.ones(len(head)), -np.ones(len(head))])
    return csr_matrix((data, (np.concatenate([rows, rows]), np.concatenate([head, tail]))), (len(head), size))


def mean_energy(
    edges: Float[np.ndarray, "r 2"],
    target: Float[np.ndarray, "m 4 2 2"],
    weight: Float[np.ndarray, " m"],
    size_weight: float,
    epsilon: float,
) -> tuple[float, Float[np.ndarray, "r 2"]]:
    """Return the mean over quads of given weight and its gradient in the rows of `corner_operator(...) @ points`."""
    stacked = np.swapaxes(edges.reshape(-1, 4, 2, 2), -2, -1)
    energy, gradient = corner_energy(stacked, target, size_weight, epsilon)
    share = weight / (4 * weight.sum())
    gradient *= share[:, None, None, None]
    return float(share @ energy.sum(axis=1)), np.swapaxes(gradient, -2, -1).reshape(-1, 2)
