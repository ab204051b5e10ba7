"""Where the nodes of every curve lie, and which node of a curve each column of a ring meets."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.decompose import Layout
from drl_meshgen.decompose.cells import Cell, spread
from drl_meshgen.decompose.junction import Rim
from drl_meshgen.decompose.loops import LoopMap, loop_map
from drl_meshgen.partition import Curve, Partition


@dataclass(frozen=True, eq=False)
class Columns:
    """Column `j` of a ring meets node `(start + direction * j) mod n` of a curve, at `theta[j]` (unrolled)."""

    start: int
    direction: int
    theta: Float[np.ndarray, " n"]

    def nodes(self) -> Int[np.ndarray, " n"]:
        """Index on the curve of the node that each column meets."""
        n = len(self.theta)
        return (self.start + self.direction * np.arange(n)) % n


def best_shift(wanted: Float[np.ndarray, " n"], given: Float[np.ndarray, " n"]) -> tuple[int, float]:
    """Cyclic shift `m` and whole turns `w` that bring `given[j + m] + w` closest to `wanted[j]`, both of period 1."""
    n = len(wanted)
    rolled = np.concatenate([given, given + 1])[np.arange(n)[None, :] + np.arange(n)[:, None]]
    gap = rolled - wanted[None, :]
    turns = np.round(gap.mean(1))
    cost = ((gap - turns[:, None]) ** 2).sum(1)
    m = int(np.argmin(cost))
    return m, float(-turns[m])


@dataclass(frozen=True, eq=False)
class Alignment:
    """Node positions of every curve (share of its length) and the columns of every ring.

    `cells[j][l]` are the columns at the loop and the theta of the outer nodes; `tubes[t]` those at both curves;
    `rims[j][l]` the node of the curve that each node around a rim is.
    """

    positions: tuple[Float[np.ndarray, " n"], ...]
    cells: tuple[tuple[tuple[Columns, Float[np.ndarray, " n"]], ...], ...]
    tubes: tuple[tuple[Columns, Columns], ...]
    rims: tuple[tuple[Int[np.ndarray, " n"], ...], ...]


class _Positions:
    """Places of the nodes of every curve, None where nobody has placed them yet; both sides of a seam have the same."""

    def __init__(self, layout: Layout) -> None:
        self._counts = layout.curve_counts
        self._shared = layout.pieces.shared(len(layout.curve_counts))
        self._places: list[np.ndarray | None] = [None] * len(layout.curve_counts)

    def __getitem__(self, c: int) -> Float[np.ndarray, " n"] | None:
        return self._places[self._shared[c]]

    def __setitem__(self, c: int, places: Float[np.ndarray, " n"]) -> None:
        self._places[self._shared[c]] = places

    def any_of(self, curves: tuple[int, ...]) -> bool:
        """Whether the nodes of one of `curves` have their places."""
        return any(self[c] is not None for c in curves)

    def are_one(self, c: int, other: int) -> bool:
        """Whether two curves have the same nodes."""
        return bool(self._shared[c] == self._shared[other])

    def space_evenly(self, c: int) -> None:
        """Place the nodes of a curve that nothing depends on."""
        self[c] = np.arange(self._counts[c]) / self._counts[c]


def align(partition: Partition, layout: Layout) -> Alignment:
    """Place the nodes of all curves: those of rims and the natural ones of cells first, carried on through tubes."""
    curves = partition.curves
    positions = _Positions(layout)
    rims = [
        tuple(_align_rim(rim, rim.natural(counts), positions) for rim in junction.rims)
        for junction, counts in zip(layout.pieces.junctions, layout.edge_counts, strict=True)
    ]
    cell_columns = [
        tuple(
            _align_cell(curves[c], cell, cell.outer_theta(counts), positions, c)
            for c, cell in zip(junction.curves, junction.cells, strict=True)
        )
        for junction, counts in zip(layout.pieces.junctions, layout.edge_counts, strict=True)
    ]
    tubes: list[tuple[Columns, Columns] | None] = [None] * len(layout.pieces.tubes)
    while any(t is None for t in tubes):
        ready = [k for k, t in enumerate(tubes) if t is None and positions.any_of(layout.pieces.tubes[k].curves)]
        if not ready:
            positions.space_evenly(next(layout.pieces.tubes[k].curves[0] for k, t in enumerate(tubes) if t is None))
            continue
        for k in ready:
            tubes[k] = _align_tube(layout, curves, positions, k)
    for cap in layout.pieces.caps:
        if positions[cap.curve] is None:
            positions.space_evenly(cap.curve)
    return Alignment(
        tuple(np.asarray(positions[c], float) for c in range(len(curves))),
        tuple(cell_columns),
        tuple(t for t in tubes if t is not None),
        tuple(rims),
    )


def _align_rim(rim: Rim, natural: Float[np.ndarray, " n"], positions: _Positions) -> Int[np.ndarray, " n"]:
    n, direction = len(natural), 1 if natural[1] > natural[0] else -1
    order = _order(n, direction)
    held = positions[rim.curve]
    if held is None:
        positions[rim.curve] = _rising(natural[order])
        return order
    shift, _ = best_shift(direction * natural, _rising(direction * held[order]))
    return order[(np.arange(n) + shift) % n]


def _align_cell(
    curve: Curve, cell: Cell, outer: np.ndarray, positions: _Positions, c: int
) -> tuple[Columns, np.ndarray]:
    relation = loop_map(cell.ring, cell.ring.inner, curve)
    theta = spread(outer)
    return _meet(relation, theta, positions, c), outer


def _meet(
    relation: LoopMap, theta: Float[np.ndarray, " n"], positions: _Positions, c: int, *, closing: bool = False
) -> Columns:
    """Let columns at `theta` meet the nodes of curve `c`, which they place where nobody has.

    With `closing` they come from the same nodes: where a quarter of a turn does it, each goes back to its own, so that
    mesh lines close instead of spiralling around a handle.
    """
    n, direction, held = len(theta), relation.direction, positions[c]
    order = _order(n, direction)
    if held is None:
        positions[c] = _rising(relation.to_position(theta)[order])
        return Columns(0, direction, theta)
    given = _rising(relation.to_theta(held)[order])
    shift, turns = best_shift(theta, given)
    if closing and min(shift, n - shift) <= n / 4:
        shift, turns = 0, turns + (2 * shift > n)
    met = given[(np.arange(n) + shift) % n] + (np.arange(n) + shift) // n + turns
    return Columns(shift if direction > 0 else (-shift) % n, direction, met)


def _order(n: int, direction: int) -> Int[np.ndarray, " n"]:
    """Nodes of a curve in the order in which columns from node 0 on meet them."""
    return np.arange(n) if direction > 0 else -np.arange(n) % n


def _rising(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Unroll values of period 1 that rise cyclically into an increasing sequence."""
    step = np.diff(values)
    return values[0] + np.r_[0.0, np.cumsum(step - np.floor(step))]


def across_transition(theta: Float[np.ndarray, " n"], n: int) -> Float[np.ndarray, " m"]:
    """Theta of `n` columns on the other side of a tube whose columns have `theta`.

    Where the counts differ, a C-type transition takes the sector that starts at column 0 (`sector` columns here): its
    columns are evenly spaced again, all others go straight on.
    """
    change = len(theta) - n
    if change == 0:
        return theta
    wide, narrow = sector(abs(change) // 2)
    here, there = (wide, narrow) if change > 0 else (narrow, wide)
    closed = np.r_[theta, theta[0] + 1]
    return np.r_[np.linspace(closed[0], closed[here], there + 1)[:-1], closed[here:-1]]


def sector(absorbed: int) -> tuple[int, int]:
    """Columns of a C-type transition on its wide and its narrow side: one on each side of a middle as wide as a leg."""
    return 2 + 3 * absorbed, 2 + absorbed


def _align_tube(layout: Layout, curves: tuple[Curve, ...], positions: _Positions, k: int) -> tuple[Columns, Columns]:
    tube = layout.pieces.tubes[k]
    maps = (
        loop_map(tube.ring, tube.ring.inner, curves[tube.curves[0]]),
        loop_map(tube.ring, tube.ring.outer, curves[tube.curves[1]]),
    )
    first = 0 if positions[tube.curves[0]] is not None else 1
    base, other = maps[first], maps[1 - first]
    n, far_n = (int(layout.curve_counts[tube.curves[end]]) for end in (first, 1 - first))
    held = positions[tube.curves[first]]
    theta = _rising(base.to_theta(np.asarray(held))[_order(n, base.direction)])
    mine = Columns(0, base.direction, theta)
    closing = positions.are_one(*tube.curves) and base.direction == other.direction
    theirs = _meet(other, across_transition(theta, far_n), positions, tube.curves[1 - first], closing=closing)
    return (mine, theirs) if first == 0 else (theirs, mine)
