"""Why given node counts cannot be met, as one sentence."""

import difflib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drl_meshgen.decompose.counts import CountProblem, solve_counts
from drl_meshgen.errors import InputError, StageError

#: Counts up to this far from one that cannot be met are tried for the advice.
REACH = 8


def numbered(names: Sequence[str], given: Sequence[tuple[str, int]]) -> tuple[tuple[int, int], ...]:
    """Return given (name, value) with places in `names`. Raises `InputError` for a name that is not among them."""
    place = {name: k for k, name in enumerate(names)}
    for name, _ in given:
        if name not in place:
            near = difflib.get_close_matches(name, names, 1)
            remedy = f"did you mean {near[0]}?" if near else f"known are {', '.join(names)}"
            raise InputError("layout", f"has no edge or ring {name}", remedy)
    return tuple((place[name], value) for name, value in given)


def contradiction(problem: CountProblem, names: Sequence[str]) -> InputError | None:
    """Return an error that names the given counts that cannot hold together; None where they can.

    None also where there are no counts, whatever is given. The fewest that contradict are found by leaving out one
    after the other as long as the rest is infeasible.
    """
    for count, value in problem.fixed:
        if value < problem.least[count]:
            return InputError("layout", f"{names[count]} = {value} is less than {problem.least[count]}")
    if _feasible(problem):
        return None
    guilty = list(problem.fixed)
    for one in problem.fixed:
        rest = [other for other in guilty if other != one]
        if not _feasible(replace(problem, fixed=tuple(rest))):
            guilty = rest
    if not guilty:
        return None
    said = _listed([f"{names[count]} = {value}" for count, value in guilty], "and")
    return InputError("layout", f"{said} {_rule(problem, guilty, names)}", _advice(problem, guilty[-1], names))


def _feasible(problem: CountProblem) -> bool:
    try:
        solve_counts(replace(problem, weight=np.zeros(len(problem.target)), step_cost=0.0, hold=0.0))
    except StageError:
        return False
    return True


def _rule(problem: CountProblem, guilty: list[tuple[int, int]], names: Sequence[str]) -> str:
    """Say what the counts violate: a parity, an equality, a sum, or something that takes all of the layout."""
    counts = {count for count, _ in guilty}
    same = _linked(problem, guilty[0][0])
    if len(guilty) == 1 and guilty[0][1] % 2 and same & set(problem.even):
        return "must be even"
    if len(guilty) == 2 and counts <= same:
        return "must be equal"
    for total, parts in problem.sums:
        if counts <= {c for one in (total, *parts) for c in _linked(problem, one)}:
            even = ", which must be even," if _linked(problem, total) & set(problem.even) else ""
            return f"cannot be: {names[total]}{even} is the sum of {_listed([names[part] for part in parts], 'and')}"
    return "cannot be met" if len(guilty) == 1 else "contradict each other"


def _linked(problem: CountProblem, count: int) -> set[int]:
    """Return the counts that must be equal to `count`, itself included."""
    linked = {count}
    pairs = [*problem.equal, *((total, parts[0]) for total, parts in problem.sums if len(parts) == 1)]
    while True:
        more = {c for pair in pairs if linked & set(pair) for c in pair} - linked
        if not more:
            return linked
        linked |= more


def _advice(problem: CountProblem, last: tuple[int, int], names: Sequence[str]) -> str:
    """Say which values nearby the last of the counts could have, the others being as they are."""
    count, value = last
    others = tuple(one for one in problem.fixed if one != last)
    for step in range(1, REACH + 1):
        near = [
            v
            for v in (value - step, value + step)
            if v >= problem.least[count] and _feasible(replace(problem, fixed=(*others, (count, v))))
        ]
        if near:
            return f"{names[count]} = {' or '.join(map(str, near))} would do"
    return ""


def _listed(items: Sequence[str], word: str) -> str:
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {word} {items[-1]}"
