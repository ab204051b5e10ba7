"""Node counts of spine edges and loops: one integer program for the whole surface."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_matrix, lil_matrix

from drl_meshgen.errors import StageError

#: Tangents of the cost are laid at these multiples of the target.
TANGENTS = np.array([0.15, 0.25, 0.4, 0.55, 0.7, 0.85, 0.95, 1.0, 1.05, 1.15, 1.35, 1.6, 2.0, 2.8, 4.0])


#: Most nodes of the branch-and-bound tree; the first few dozen decide, the rest is proof.
NODE_LIMIT = 2000

#: Whole counts are first sought this close to those of the relaxation, where the program is much smaller.
WINDOW = 2


#: Most columns a transition absorbs on each side of its middle.
MOST_ABSORBED = 8
#: Columns of a ring beyond three times what its transition absorbs on each side: two beside it and two elsewhere.
ROOM = 4


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
    steps: tuple[tuple[int, int], ...] = ()
    """Pairs (wide, narrow): the first count exceeds the second by an even number, which a C-type transition absorbs."""
    step_cost: float = 0.0
    """Cost of each transition, in the units of `weight`."""
    fixed: tuple[tuple[int, int], ...] = ()
    """Pairs (count, value): counts that are given."""
    hold: float = 0.0
    """Cost of every deviation `|x / t - 1|` on top, so that counts leave their targets only where they must."""


def solve_counts(problem: CountProblem, *, integral: bool = True) -> Float[np.ndarray, " n"]:
    """Minimise `sum w (x / t + t / x - 2)`, which is `2 cosh(log(x / t)) - 2`, convex in x, by tangents.

    Without `integral` the relaxation is solved, which is fast. Whole counts are sought near those of the relaxation
    and, where there are none or `hold` asks for the best, everywhere. HiGHS runs with a gap and a limit of nodes, not
    of time, so the result is reproducible. Raises `StageError` when infeasible.
    """
    relaxed = _checked(*_minimised(problem, whole=False))
    if not integral:
        return relaxed
    found = None if problem.hold else _minimised(problem, near=relaxed)[0]
    return np.round(_checked(*_minimised(problem)) if found is None else found)


def _checked(counts: Float[np.ndarray, " n"] | None, message: str) -> Float[np.ndarray, " n"]:
    if counts is None:
        raise StageError("decompose", CountOutcome.INFEASIBLE, message)
    return counts


def _minimised(
    problem: CountProblem, *, near: Float[np.ndarray, " n"] | None = None, whole: bool = True
) -> tuple[Float[np.ndarray, " n"] | None, str]:
    """Return the counts of least cost, None where there are none, and what the solver says.

    None is further than `WINDOW` from what `near`, where given, is rounded to either way.
    """
    n, n_even, n_steps = len(problem.target), len(problem.even), len(problem.steps)
    # counts, costs, halves of even counts, columns absorbed on each side, whether any is
    size = 2 * n + n_even + 2 * n_steps
    low = np.r_[problem.least, np.zeros(size - n)]
    high = np.r_[np.full(size - n_steps, np.inf), np.ones(n_steps)]
    for count, value in problem.fixed:
        if value < low[count]:
            raise StageError("decompose", CountOutcome.INFEASIBLE, f"{value} is less than {low[count]:.0f}")
        low[count] = high[count] = value
    if near is not None:
        low[:n] = np.maximum(low[:n], np.floor(near) - WINDOW)
        high[:n] = np.minimum(high[:n], np.ceil(near) + WINDOW)
    result = milp(
        np.r_[np.zeros(n), problem.weight, np.zeros(n_even + n_steps), np.full(n_steps, problem.step_cost)],
        integrality=np.r_[np.ones(n), np.zeros(n), np.ones(size - 2 * n)] if whole else np.zeros(size),
        bounds=Bounds(low, high),  # pyright: ignore[reportArgumentType]
        constraints=[_equations(problem, size), _transitions(problem, size), _tangents(problem, size)],
        options={"mip_rel_gap": 0.0 if problem.hold else 0.02, "node_limit": NODE_LIMIT},
    )
    return None if result.x is None else result.x[:n], result.message


def _equations(problem: CountProblem, size: int) -> LinearConstraint:
    """Return the sums, equal pairs and even counts."""
    n = len(problem.target)
    rows = lil_matrix((len(problem.sums) + len(problem.equal) + len(problem.even) + len(problem.steps), size))
    r = 0
    for total, parts in problem.sums:
        rows[r, total] -= 1
        for part in parts:
            rows[r, part] += 1
        r += 1
    for a, b in problem.equal:
        rows[r, a], rows[r, b] = 1, -1
        r += 1
    for k, a in enumerate(problem.even):
        rows[r, a], rows[r, 2 * n + k] = 1, -2
        r += 1
    for k, (wide, narrow) in enumerate(problem.steps):
        rows[r, wide], rows[r, narrow], rows[r, 2 * n + len(problem.even) + k] = 1, -1, -2
        r += 1
    return LinearConstraint(rows.tocsr(), 0, 0)


def _transitions(problem: CountProblem, size: int) -> LinearConstraint:
    """Let a transition absorb columns only where it is paid for and its nine blocks find room in the ring."""
    n, n_steps = len(problem.target), len(problem.steps)
    rows = lil_matrix((2 * n_steps, size))
    first = 2 * n + len(problem.even)
    for k, (wide, _) in enumerate(problem.steps):
        rows[k, first + k], rows[k, first + n_steps + k] = 1, -MOST_ABSORBED
        rows[n_steps + k, first + k], rows[n_steps + k, wide] = 3, -1
    return LinearConstraint(rows.tocsr(), -np.inf, np.r_[np.zeros(n_steps), np.full(n_steps, -ROOM)])


def _tangents(problem: CountProblem, size: int) -> LinearConstraint:
    """Keep the cost above every tangent of `m + 1 / m - 2 + hold |m - 1|` at `m = x / t`."""
    places = np.r_[TANGENTS, 1.0] if problem.hold else TANGENTS  # the bend at 1 has two tangents
    bend = problem.hold * np.where(places > 1, 1.0, -1.0)
    bend[-1] = problem.hold
    n, k = len(problem.target), len(places)
    count = np.repeat(np.arange(n), k)
    slope = np.tile(1 - 1 / places**2 + bend, n) / problem.target[count]
    at = np.tile(places, n)
    row = np.arange(n * k)
    values = np.r_[np.ones(n * k), -slope]
    matrix = coo_matrix((values, (np.r_[row, row], np.r_[n + count, count])), (n * k, size))
    low = at + 1 / at - 2 + np.tile(bend * (places - 1), n) - slope * at * problem.target[count]
    return LinearConstraint(matrix.tocsr(), low, np.inf)  # pyright: ignore[reportArgumentType]
