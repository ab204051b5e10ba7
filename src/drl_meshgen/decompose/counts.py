"""Node counts of spine edges and loops: one integer program for the whole surface."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import lil_matrix

from drl_meshgen.errors import StageError

#: Tangents of the cost are laid at these multiples of the target.
TANGENTS = np.array([0.15, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0, 1.15, 1.35, 1.6, 2.0, 2.8, 4.0])


#: Most nodes of the branch-and-bound tree; the first few dozen decide, the rest is proof.
NODE_LIMIT = 2000


class CountOutcome(Enum):
    """Verdicts of the integer program."""

    INFEASIBLE = "no node counts satisfy all blocks"


@dataclass(frozen=True, eq=False)
class CountProblem:
    """Targets (real, > 0), weights and least counts of `n` unknown counts; `sums` are equations.

    A sum `(total, parts)` says: count `total` equals the sum of counts `parts` (repeats allowed). `equal` are pairs of
    equal counts, `even` counts that must be even.
    """

    target: Float[np.ndarray, " n"]
    weight: Float[np.ndarray, " n"]
    least: Int[np.ndarray, " n"]
    sums: tuple[tuple[int, tuple[int, ...]], ...]
    equal: tuple[tuple[int, int], ...]
    even: tuple[int, ...]


def solve_counts(problem: CountProblem, *, integral: bool = True) -> Float[np.ndarray, " n"]:
    """Minimise `sum w (x / t + t / x - 2)`, which is `2 cosh(log(x / t)) - 2`, convex in x, by tangents.

    Without `integral` the relaxation is solved, which is fast. HiGHS runs with a gap and a limit of nodes, not of time,
    so the result is reproducible. Raises `StageError` when infeasible.
    """
    n, even = len(problem.target), problem.even
    size = 2 * n + len(even)  # counts, costs, halves
    rows = lil_matrix((len(problem.sums) + len(problem.equal) + len(even) + n * len(TANGENTS), size))
    low = np.zeros(rows.shape[0])
    high = np.zeros(rows.shape[0])
    r = 0
    for total, parts in problem.sums:
        rows[r, total] -= 1
        for part in parts:
            rows[r, part] += 1
        r += 1
    for a, b in problem.equal:
        rows[r, a], rows[r, b] = 1, -1
        r += 1
    for k, a in enumerate(even):
        rows[r, a], rows[r, 2 * n + k] = 1, -2
        r += 1
    for k, t in enumerate(problem.target):
        for m in TANGENTS:
            slope = (1 - 1 / m**2) / t
            rows[r, n + k], rows[r, k] = 1, -slope
            low[r], high[r] = (m + 1 / m - 2) - slope * m * t, np.inf
            r += 1
    result = milp(
        np.r_[np.zeros(n), problem.weight, np.zeros(len(even))],
        integrality=np.r_[np.ones(n), np.zeros(n), np.ones(len(even))] if integral else np.zeros(size),
        bounds=Bounds(np.r_[problem.least, np.zeros(n + len(even))], np.full(size, np.inf)),
        constraints=LinearConstraint(rows.tocsr(), low, high),
        options={"mip_rel_gap": 0.02, "node_limit": NODE_LIMIT},
    )
    if result.x is None:
        raise StageError("decompose", CountOutcome.INFEASIBLE, result.message)
    return np.round(result.x[:n]) if integral else result.x[:n]
