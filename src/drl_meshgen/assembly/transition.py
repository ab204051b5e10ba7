"""Tubes whose ends have different counts: a C-type transition in one sector, plain columns elsewhere."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.assembly.align import Columns, sector
from drl_meshgen.templates import CCounts, TemplatePolicy, fill_transition


@dataclass(frozen=True, eq=False)
class TransitionFill:
    """Nodes of a tube that loses columns on its way: `chart (p, 2)` in `(theta, h)`, those on its two curves first.

    `first` and `last` are the indices of these on their curves, `grids` the node grids of the nine blocks of the C-type
    template and of the plain rest, right-handed in the chart.
    """

    chart: Float[np.ndarray, "p 2"]
    first: Int[np.ndarray, " n"]
    last: Int[np.ndarray, " m"]
    grids: tuple[Int[np.ndarray, "ni1 nj1"], ...]


def transition_fill(one: Columns, two: Columns, rows: int, modulus: float, policy: TemplatePolicy) -> TransitionFill:
    """Fill a tube between columns `one` (h = 0) and `two` (h = 1) that differ by an even number of columns.

    The transition takes the sector that `across_transition` left it, next to the end with more columns; `modulus` is
    that of the chart, so that shapes are judged where the chart is conformal.
    """
    n, m = len(one.theta), len(two.theta)
    absorbed = abs(n - m) // 2
    wide, narrow = sector(absorbed)
    low, high = (wide, narrow) if n > m else (narrow, wide)
    rows = max(rows, absorbed + 2)
    turns = np.round(one.theta[0] - two.theta[0])
    bottom = np.c_[np.r_[one.theta, one.theta[0] + 1], np.zeros(n + 1)]
    top = np.c_[np.r_[two.theta, two.theta[0] + 1] + turns, np.ones(m + 1)]
    share = (np.arange(1, rows) / rows)[:, None, None]
    plain = (1 - share) * bottom[low:] + share * top[high:]  # rows, columns from the right edge of the sector, 2
    right, left = plain[:, 0], plain[:, -1] - np.array([1.0, 0.0])
    # ids: bottom, top, then the inner rows of the plain columns (the last column closes at the left of the sector)
    inner = n + m + np.arange(plain.shape[0] * plain.shape[1]).reshape(plain.shape[:2])
    rest = np.vstack([np.r_[low:n, 0], inner, n + np.r_[high:m, 0]])
    rim = [
        (np.arange(low), bottom[:low]),
        (np.r_[low % n, inner[:, 0]], np.vstack([bottom[low], right])),
        (n + np.arange(high, 0, -1) % m, top[high:0:-1]),
        (np.r_[n, inner[::-1, -1]], np.vstack([top[0], left[::-1]])),
    ]
    if n < m:  # the template starts at the left end of its wide side, seen from inside: the top right corner
        rim = rim[2:] + rim[:2]
    ids, places = (np.concatenate(parts) for parts in zip(*rim, strict=True))
    below = absorbed + 1 if rows > 2 * (absorbed + 1) else rows // 2
    counts = CCounts(q0=1, p=absorbed, n=absorbed, q1=1, below=below, above=rows - below)
    patch = fill_transition(places * np.array([1.0, modulus]), 0, counts, policy)
    new = patch.points[len(ids) :] / np.array([1.0, modulus])
    chart = np.vstack([bottom[:n], top[:m], plain.reshape(-1, 2), new])
    local = np.r_[ids, len(chart) - len(new) + np.arange(len(new))]
    return TransitionFill(chart, one.nodes(), two.nodes(), (rest.T, *(local[grid] for grid in patch.grids)))
