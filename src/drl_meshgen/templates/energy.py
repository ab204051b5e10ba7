"""Regularised shape and size energy of plane quads: finite for folded cells, so that a descent unfolds them.

At each corner `J = E M` with `E` the two corner edges as columns and `M` the inverse of the wanted ones;
`(|J|^2 + s (1 + det^2)) / (2 chi)`, `chi = (det + sqrt(eps^2 + det^2)) / 2` (Garanzha et al. 2021, eq. 4). It is least,
1 + s, where the corner is the wanted one.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_matrix


@dataclass(frozen=True, eq=False)
class Corners:
    """Wanted corners as coefficients: `|J|^2 = ff f.f + 2 fg f.g + gg g.g`, `det J = scale (f x g)` for edges f, g."""

    ff: Float[np.ndarray, "*c"]
    fg: Float[np.ndarray, "*c"]
    gg: Float[np.ndarray, "*c"]
    scale: Float[np.ndarray, "*c"]

    @classmethod
    def wanted(
        cls,
        first: Float[np.ndarray, "*c"],
        second: Float[np.ndarray, "*c"],
        angle: Float[np.ndarray, "*c"] | None = None,
    ) -> "Corners":
        """Return corners with edges of lengths `first`, `second` at `angle` radians (a right angle if None)."""
        if angle is None:
            f, g = 1 / first, 1 / second
            return cls(f * f, np.zeros(()), g * g, f * g)
        sine = np.sin(angle)
        cotangent = np.cos(angle) / sine
        return cls(
            (1 + cotangent**2) / first**2,
            -cotangent / (first * second * sine),
            1 / (second * sine) ** 2,
            1 / (first * second * sine),
        )


def corner_operator(quads: Int[np.ndarray, "m 4"], size: int) -> csr_matrix:
    """Return the (8 m, size) matrix from points to corner edges.

    Row `4 q + c` is the edge from corner `c` of quad `q` to the next corner, row `4 m + 4 q + c` that to the previous.
    """
    head = np.concatenate([np.roll(quads, -1, axis=1).ravel(), np.roll(quads, 1, axis=1).ravel()])
    tail = np.tile(quads.ravel(), 2)
    rows = np.tile(np.arange(len(head)), 2)
    data = np.repeat([1.0, -1.0], len(head))
    return csr_matrix((data, (rows, np.concatenate([head, tail]))), (len(head), size))


def corner_energy(
    edges: Float[np.ndarray, "r 2"], corners: Corners, size_weight: float, epsilon: float
) -> Float[np.ndarray, "*c"]:
    """Return the energy of each corner for edges as `corner_operator` gives them."""
    (fx, gx), (fy, gy) = edges.T.reshape(2, 2, -1)
    spread = corners.ff * (fx * fx + fy * fy) + 2 * corners.fg * (fx * gx + fy * gy) + corners.gg * (gx * gx + gy * gy)
    det = corners.scale * (fx * gy - fy * gx)
    chi, _ = _regularised(det, epsilon)
    return (spread + size_weight * (1 + det * det)) / (2 * chi)


def total_energy(
    edges: Float[np.ndarray, "r 2"],
    corners: Corners,
    weight: Float[np.ndarray, " c"],
    size_weight: float,
    epsilon: float,
) -> tuple[float, Float[np.ndarray, "r 2"]]:
    """Return the weighted sum of the corner energies and its gradient in `edges`."""
    (fx, gx), (fy, gy) = edges.T.reshape(2, 2, -1)
    ff, fg, gg, scale = corners.ff, corners.fg, corners.gg, corners.scale
    spread = ff * (fx * fx + fy * fy) + 2 * fg * (fx * gx + fy * gy) + gg * (gx * gx + gy * gy)
    det = scale * (fx * gy - fy * gx)
    chi, root = _regularised(det, epsilon)
    energy = (spread + size_weight * (1 + det * det)) / (2 * chi)
    share = weight / chi
    turn = weight * scale * (size_weight * det / chi - energy / root)
    ff, fg, gg = share * ff, share * fg, share * gg
    slope = np.empty((2, 2, len(fx)))
    slope[0, 0], slope[1, 0] = ff * fx + fg * gx + turn * gy, ff * fy + fg * gy - turn * gx
    slope[0, 1], slope[1, 1] = gg * gx + fg * fx - turn * fy, gg * gy + fg * fy + turn * fx
    return float(weight @ energy), slope.reshape(2, -1).T


def _regularised(det: np.ndarray, epsilon: float) -> tuple[np.ndarray, np.ndarray]:
    """Return `chi` and `sqrt(eps^2 + det^2)`; for det < 0 by the form that does not cancel."""
    root = np.sqrt(epsilon**2 + det * det)
    sum_ = root + np.abs(det)
    return np.where(det > 0, sum_ / 2, epsilon**2 / (2 * sum_)), root
