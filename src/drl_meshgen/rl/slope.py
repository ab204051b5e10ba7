"""Reward and penalty of meshes with their gradient in the nodes, compiled: the twin's figures, far cheaper.

`worth` brings them into PyTorch, which meshing does without: it takes two seconds to load.
"""

import numba
import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.templates.score import LEAST_JACOBIAN, PENALTY, Weights

HALF_PI = np.pi / 2


@numba.njit(cache=True, error_model="numpy")
def _worst(det: np.ndarray, dot: np.ndarray, square: np.ndarray, valid: bool) -> tuple[int, float]:  # noqa: FBT001
    """Return the corner of a quad whose angle is furthest from a right one, and by how much.

    `square` holds squared lengths of the edges ahead. In valid quads the corner of the largest squared cosine is found
    without an angle.
    """
    if valid:
        at, top, under = 0, dot[0] * dot[0], square[0] * square[3]
        for c in range(1, 4):
            here, of = dot[c] * dot[c], square[c] * square[c - 1]
            if here * under > top * of:
                at, top, under = c, here, of
        return at, np.arcsin(min(1.0, np.sqrt(top / under)))
    at, worst = 0, -1.0
    for c in range(4):
        theta = np.arctan2(det[c], dot[c])
        defect = abs(HALF_PI - (theta + 2 * np.pi if theta < 0 else theta))
        if defect > worst:
            worst, at = defect, c
    return at, worst


@numba.njit(cache=True, error_model="numpy")
def _worth(points: np.ndarray, quads: np.ndarray, share: np.ndarray, factors: tuple, slope: np.ndarray) -> np.ndarray:
    """Return the worth of each mesh and add its gradient to `slope`; `factors` weigh orthogonality and ratio."""
    for_angle, for_ratio = factors
    value = np.zeros(len(points))
    ex, ey, det, dots, square, length = (np.empty(4), np.empty(4), np.empty(4), np.empty(4), np.empty(4), np.empty(4))
    for b in range(len(points)):
        for q in range(len(quads)):
            weight = share[b if len(share) > 1 else 0, q]
            quad = quads[q]
            side = 0.0
            for c in range(4):
                tail, head = quad[c], quad[(c + 1) % 4]
                ex[c], ey[c] = points[b, head, 0] - points[b, tail, 0], points[b, head, 1] - points[b, tail, 1]
                square[c] = ex[c] * ex[c] + ey[c] * ey[c]
                length[c] = np.sqrt(square[c])
                side += length[c] / 4
            low, high = 0, 0
            for c in range(4):
                p = (c + 3) % 4
                det[c] = ey[c] * ex[p] - ex[c] * ey[p]
                dots[c] = -(ex[c] * ex[p] + ey[c] * ey[p])
                if det[c] < det[low]:
                    low = c
                if det[c] > det[high]:
                    high = c
            at, worst = _worst(det, dots, square, det[low] > 0)
            worth = for_angle * (1 - worst / HALF_PI)
            in_low, in_high, in_side = 0.0, 0.0, 0.0
            if det[low] > 0:
                worth += for_ratio * det[low] / det[high]
                in_low, in_high = for_ratio / det[high], -for_ratio * det[low] / det[high] ** 2
            lack = LEAST_JACOBIAN - det[low] / side**2
            if lack > 0:
                worth -= PENALTY * lack
                in_low += PENALTY / side**2
                in_side = -2 * PENALTY * det[low] / side**3
            value[b] += weight * worth
            for c in range(4):
                p = (c + 3) % 4
                back, here, ahead = quad[p], quad[c], quad[(c + 1) % 4]
                in_det = weight * ((in_low if c == low else 0.0) + (in_high if c == high else 0.0))
                in_dot = 0.0
                if c == at and length[c] > 0 and length[p] > 0:
                    sign = -1.0 if det[c] >= 0 and dots[c] > 0 else 1.0
                    turn = -weight * for_angle / HALF_PI * sign / (square[c] * square[p])
                    in_det += turn * dots[c]
                    in_dot = -turn * det[c]
                # det = a x b and dot = a . b of the edges a ahead and b back from this corner
                bx, by = -ex[p], -ey[p]
                ax = in_det * by + in_dot * bx
                ay = -in_det * bx + in_dot * by
                bx, by = -in_det * ey[c] + in_dot * ex[c], in_det * ex[c] + in_dot * ey[c]
                if in_side != 0 and length[c] > 0:
                    ax += weight * in_side * ex[c] / (4 * length[c])
                    ay += weight * in_side * ey[c] / (4 * length[c])
                slope[b, ahead, 0] += ax
                slope[b, ahead, 1] += ay
                slope[b, back, 0] += bx
                slope[b, back, 1] += by
                slope[b, here, 0] -= ax + bx
                slope[b, here, 1] -= ay + by
    return value


def worth_and_slope(
    points: Float[np.ndarray, "b p 2"],
    quads: Int[np.ndarray, "m 4"],
    share: Float[np.ndarray, "s m"] | None = None,
    weights: Weights | None = None,
) -> tuple[Float[np.ndarray, " b"], Float[np.ndarray, "b p 2"]]:
    """Return reward less validity penalty of meshes of one topology, and its gradient in their nodes.

    `share (b, m)` or `(1, m)` weighs the quads as in `twin.reward`. Where several corners of a quad are equally bad the
    first counts.
    """
    w = weights or Weights()
    share = np.full((1, len(quads)), 1 / len(quads)) if share is None else np.ascontiguousarray(share, np.float64)
    slope = np.zeros_like(points)
    factors = w.quality * w.orthogonality, w.quality * w.jacobian
    return _worth(np.ascontiguousarray(points, np.float64), quads, share, factors, slope), slope
