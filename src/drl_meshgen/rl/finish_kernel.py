"""Smooth stand-ins for the figures of plane meshes with their gradient in the nodes, compiled (numba, float64)."""

from typing import NamedTuple

import numba
import numpy as np

from drl_meshgen.templates.score import LEAST_JACOBIAN, PENALTY

HALF_PI = np.pi / 2


class Pairs(NamedTuple):
    """Consecutive interior edges of mesh lines."""

    edges: np.ndarray
    """Nodes of every edge, (e, 2)."""
    pairs: np.ndarray
    """Edges of every pair, (p, 2)."""


@numba.njit(cache=True, error_model="numpy")
def _power_mean(x: np.ndarray, doublings: int, powers: np.ndarray) -> float:
    """Return the mean of four numbers in [0, 1], one of them 1, by exponent `2 ** doublings`; fill `powers`."""
    mean = 0.0
    for c in range(4):
        power = x[c]
        for _ in range(doublings):
            power *= power
        powers[c] = power
        mean += power / 4
    for c in range(4):
        powers[c] /= 4 * mean  # what the mean changes by with the logarithm of each number, over the mean
    return np.exp(np.log(mean) / 2**doublings)


@numba.njit(cache=True, error_model="numpy")
def quads_worth(
    points: np.ndarray, quads: np.ndarray, factors: tuple, doublings: int, slope: np.ndarray
) -> tuple[float, float]:
    """Return the mean worth of quads and the least corner Jacobian over squared mean side; add the gradient to `slope`.

    `factors` weigh orthogonality and Jacobian ratio. Defects of angles and least and largest Jacobian are power means
    over the corners, of exponent `2 ** doublings`; the penalty is that of `templates.score`. Right for valid quads,
    for others a continuation that leads back.
    """
    for_angle, for_ratio = factors
    total, least = 0.0, np.inf
    ex, ey, length, det, dot = np.empty(4), np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    defect, in_det, in_dot, share = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    powers, others = np.empty(4), np.empty(4)
    for quad in quads:
        side = 0.0
        for c in range(4):
            tail, head = quad[c], quad[(c + 1) % 4]
            ex[c], ey[c] = points[head, 0] - points[tail, 0], points[head, 1] - points[tail, 1]
            length[c] = np.sqrt(ex[c] * ex[c] + ey[c] * ey[c])
            side += length[c] / 4
        low, high, worst = 0, 0, 0.0
        for c in range(4):
            p = (c + 3) % 4
            det[c] = ey[c] * ex[p] - ex[c] * ey[p]
            dot[c] = -(ex[c] * ex[p] + ey[c] * ey[p])
            defect[c] = np.arctan2(dot[c], det[c])
            worst = max(worst, abs(defect[c]))
            low = c if det[c] < det[low] else low
            high = c if det[c] > det[high] else high
        square = side * side
        least = min(least, det[low] / square)
        total += for_angle
        in_det[:], in_dot[:] = 0.0, 0.0
        if worst > 0:
            for c in range(4):
                share[c] = abs(defect[c]) / worst
            lost = for_angle * worst * _power_mean(share, doublings, powers) / HALF_PI
            total -= lost
            for c in range(4):
                turn = lost * powers[c] / defect[c] / (det[c] * det[c] + dot[c] * dot[c]) if powers[c] > 0 else 0.0
                in_det[c] += turn * dot[c]
                in_dot[c] -= turn * det[c]
        if det[low] > 0:
            for c in range(4):
                share[c] = det[low] / det[c]
            ratio = for_ratio * det[low] / det[high] / _power_mean(share, doublings, powers)
            for c in range(4):
                share[c] = det[c] / det[high]
            ratio /= _power_mean(share, doublings, others)
            total += ratio
            for c in range(4):
                in_det[c] += ratio * (powers[c] - others[c]) / det[c]
        lack, in_side = LEAST_JACOBIAN - det[low] / square, 0.0
        if lack > 0:
            total -= PENALTY * lack
            in_det[low] += PENALTY / square
            in_side = -2 * PENALTY * det[low] / (square * side)
        for c in range(4):
            p = (c + 3) % 4
            back, here, ahead = quad[p], quad[c], quad[(c + 1) % 4]
            # det = a x b and dot = a . b of the edges a ahead and b back from this corner
            ax, ay = in_dot[c] * -ex[p] - in_det[c] * ey[p], in_dot[c] * -ey[p] + in_det[c] * ex[p]
            bx, by = in_dot[c] * ex[c] - in_det[c] * ey[c], in_dot[c] * ey[c] + in_det[c] * ex[c]
            if in_side != 0 and length[c] > 0:
                ax += in_side * ex[c] / (4 * length[c])
                ay += in_side * ey[c] / (4 * length[c])
            slope[ahead, 0] += ax / len(quads)
            slope[ahead, 1] += ay / len(quads)
            slope[back, 0] += bx / len(quads)
            slope[back, 1] += by / len(quads)
            slope[here, 0] -= (ax + bx) / len(quads)
            slope[here, 1] -= (ay + by) / len(quads)
    return total / len(quads), least


@numba.njit(cache=True, error_model="numpy")
def line_smoothness(points: np.ndarray, lines: Pairs, rounding: float, factor: float, slope: np.ndarray) -> float:
    """Return the mean of shorter / longer over pairs of edges, 1 where there are none; add its gradient to `slope`.

    The gradient is that of `factor` times the mean. With x the difference of log lengths a pair counts
    `exp(rounding - sqrt(x^2 + rounding^2))`; with `rounding` 0 the figure is that of `quality.metrics`.
    """
    edges, pairs = lines
    if len(pairs) == 0:
        return 1.0
    square, slopes, total = np.empty(len(edges)), np.zeros(len(edges)), 0.0
    for e in range(len(edges)):
        x, y = points[edges[e, 1], 0] - points[edges[e, 0], 0], points[edges[e, 1], 1] - points[edges[e, 0], 1]
        square[e] = x * x + y * y
    for i in range(len(pairs)):
        a, b = pairs[i, 0], pairs[i, 1]
        apart = np.log(square[a] / square[b]) / 2
        rounded = np.sqrt(apart * apart + rounding * rounding)
        ratio = np.exp(rounding - rounded)
        total += ratio
        if rounded > 0:
            change = factor * ratio * apart / rounded / len(pairs)
            slopes[a] -= change
            slopes[b] += change
    for e in range(len(edges)):
        tail, head = edges[e, 0], edges[e, 1]
        for axis in range(2):
            change = slopes[e] / square[e] * (points[head, axis] - points[tail, axis])
            slope[head, axis] += change
            slope[tail, axis] -= change
    return float(total / len(pairs))
