"""Turning bands and caps, and changing counts a little, so that mesh lines from irregular nodes meet.

Every line that runs from one irregular node into another saves all the patches that two lines would cut on their way.
The search is simulated annealing over integers; a candidate is counted in a fraction of a millisecond (see `Lines`).
"""

from cmath import phase, rect
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations
from math import inf, log, tau
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.decompose.cells import Cell
from drl_meshgen.decompose.counts import CountProblem
from drl_meshgen.decompose.junction import Rim
from drl_meshgen.decompose.lines import Lines, Turning, united
from drl_meshgen.decompose.loops import loop_map
from drl_meshgen.decompose.pieces import Pieces
from drl_meshgen.partition import Partition

#: Steps of each search.
STEPS = 5000
#: Temperature in the beginning (blocks).
HEAT = 5.0
#: Cost of a core that is not square: this times its girth times the squared logarithm of its aspect ratio.
CORE_COST = 0.125
#: Cost of twist: this times columns times the squared share of a turn, over the modulus of the band.
TWIST_COST = 20.0
#: A band counts as at least this long (modulus).
LEAST_MODULUS = 0.1


@dataclass(frozen=True, eq=False)
class Landing:
    """Where the feet of a band's first end come down at its second: sides, and the share of each that lies before.

    `modulus` is that of the whole band.
    """

    at: tuple[tuple[int, ...], tuple[float, ...]]
    modulus: float


def landings(partition: Partition, pieces: Pieces, lines: Lines) -> dict[int, Landing]:
    """Carry the feet of every band between two ends along its charts."""
    owners: list[Cell | Rim] = [owner for j in pieces.junctions for owner in (*j.cells, *j.rims)]
    found: dict[int, Landing] = {}
    for b, band in enumerate(lines.bands):
        if len(band.ends) < 2:
            continue
        first, second = (owners[k] for k in band.ends)
        here, there = (lines.ends[k].curve for k in band.ends)
        places, modulus = _feet(partition, first, here), 0.0
        for t, near in lines.passed(pieces, b):
            tube = pieces.tubes[t]
            loops = (tube.ring.inner, tube.ring.outer)
            one, two = (loop_map(tube.ring, loops[e], partition.curves[tube.curves[e]]) for e in (near, 1 - near))
            places = two.to_position(one.to_theta(places))
            modulus += tube.ring.chart.modulus
        corners = _feet(partition, second, there)
        modulus += sum(owner.ring.chart.modulus for owner in (first, second) if isinstance(owner, Cell))
        found[b] = _landing(places, corners, max(modulus, LEAST_MODULUS))
    return found


def _feet(partition: Partition, owner: Cell | Rim, curve: int) -> Float[np.ndarray, " f"]:
    """Places of the feet of a cell or rim on its curve, unrolled in the order of its sides."""
    if isinstance(owner, Rim):
        return owner.corners
    ring = owner.ring
    theta = ring.unwrapped(ring.outer)[owner.starts]
    return loop_map(ring, ring.inner, partition.curves[curve]).to_position(theta)


def _landing(places: np.ndarray, corners: np.ndarray, modulus: float) -> Landing:
    """Say between which of `corners` the places lie; corners go round once, rising or falling."""
    turn = 1.0 if len(corners) < 2 or corners[-1] > corners[0] else -1.0
    bounds = np.r_[turn * (corners - corners[0]), 1.0]
    at = (turn * (places - corners[0])) % 1.0
    side = np.searchsorted(bounds, at, side="right").clip(1, len(corners)) - 1
    share = (at - bounds[side]) / np.maximum(bounds[side + 1] - bounds[side], 1e-9)
    return Landing((tuple(side.tolist()), tuple(share.tolist())), modulus)


#: A corner of a cap as a foot of its band and columns after it, so that it keeps its place when counts change.
_Anchor = tuple[int, int]

#: Groups of edges and by how much their counts change.
_Move = tuple[tuple[int, int], ...]

T = TypeVar("T")


@dataclass(frozen=True)
class _State:
    """A candidate: counts of all graph edges, shifts of bands, the first two corners of caps."""

    counts: tuple[int, ...]
    shifts: tuple[int, ...]
    anchors: tuple[tuple[_Anchor, _Anchor], ...]


def turned(
    partition: Partition,
    pieces: Pieces,
    problem: CountProblem,
    counts: Int[np.ndarray, " n"],
    weight: float,
    *,
    searches: int = 1,
) -> tuple[Int[np.ndarray, " n"], Turning]:
    """Return counts near `counts`, solutions of `problem`, and the turning with the fewest blocks for them.

    Counts that the problem fixes stay. `weight` is what a block costs in the units of the problem: length over
    spacing. The best of `searches` counts, each with draws of its own. Deterministic.
    """
    search = _Search(partition, pieces, problem, counts, weight)
    state = search.run(searches)
    return search.solution(state), search.turning(state, search.lines.feet(state.counts))


class _Search:
    def __init__(
        self, partition: Partition, pieces: Pieces, problem: CountProblem, counts: np.ndarray, weight: float
    ) -> None:
        n_curves = len(partition.curves)
        self.n_edges = len(counts) - n_curves
        self.lines = lines = Lines.of(pieces, n_curves)
        self.weight, self.given = weight, counts
        self.landings = landings(partition, pieces, lines)
        self.double = list(self.landings)
        ends = {band.cap: band.ends[0] for band in lines.bands if band.ends and band.cap >= 0}
        self.end_of_cap = [ends.get(k, -1) for k in range(len(pieces.caps))]
        self.free_caps = sorted(ends)
        self.costs = _Costs(problem, lines, self.n_edges)
        self.groups = _groups(lines, self.n_edges)
        self.moves = _moves(lines, self.groups, {k for k, _ in problem.fixed}, self.n_edges)
        self.counted = lru_cache(maxsize=8)(self._counted)

    def start(self) -> _State:
        """Return the counts given, bands as they come, and caps whose first corner is at a foot and core is square."""
        counts = tuple(self.given[: self.n_edges].tolist())
        feet = self.lines.feet(counts)
        anchors = tuple(((0, 0), (0, feet[k][-1] // 4 if k >= 0 else 0)) for k in self.end_of_cap)
        shifts = [round(self.natural(feet, b)) if b in self.double else 0 for b in range(len(self.lines.bands))]
        return _State(counts, tuple(shifts), anchors)

    def run(self, searches: int) -> _State:
        """Anneal from `start` as often as wanted; return the best state met."""
        state = self.start()
        if not (self.free_caps or self.double):
            return state
        found = [self.annealed(state, seed) for seed in range(searches)]
        return min(found, key=self.cost)

    def annealed(self, state: _State, seed: int) -> _State:
        """Anneal from `state` with the draws of `seed`; return the best state met."""
        best, cost = state, self.cost(state)
        least = cost
        draws = np.random.default_rng(seed).random((STEPS, 8))
        for step, draw in enumerate(draws.tolist()):
            heat = self.weight * HEAT * (1 - step / STEPS) ** 2
            new, limit = self.neighbour(state, draw), cost - heat * log(1 - draw[7])
            price = self.cost(new, limit)
            if price < limit:
                state, cost = new, price
                if cost < least - 1e-9:
                    best, least = state, cost
        return self.polished(best, least)

    def polished(self, state: _State, cost: float) -> _State:
        """Take every single step that helps, until none does."""
        better = True
        while better:
            better = False
            for new in self.around(state):
                price = self.cost(new, cost)
                if price < cost - 1e-9:
                    state, cost, better = new, price, True
                    break
        return state

    def around(self, state: _State) -> Iterator[_State]:
        """Yield all states one change of counts, one cap or one step of a shift away."""
        for move in self.moves:
            yield self.moved(state, move)
        for k in self.free_caps:
            sides = self.lines.ends[self.end_of_cap[k]].sides
            half = sum(state.counts[e] for e, _ in sides) // 2
            for foot in range(len(sides)):
                for m in range(1, half):
                    yield replace(state, anchors=_put(state.anchors, k, ((foot, 0), (foot, m))))
        for b in self.double:
            for step in (-1, 1):
                yield replace(state, shifts=_put(state.shifts, b, state.shifts[b] + step))

    def moved(self, state: _State, move: _Move, times: int = 1) -> _State:
        """Change counts `times` over; corners of caps stay with their feet."""
        counts = list(state.counts)
        for group, change in move:
            for edge in self.groups[group]:
                counts[edge] += times * change
        return replace(state, counts=tuple(counts))

    def neighbour(self, state: _State, draw: list[float]) -> _State:
        """Change counts, the corners of a cap or the shift of a band."""
        kind = draw[0] * 10
        if kind < 5 and self.moves:
            times = (1, 1, 1, 2, 2, 3)[int(draw[2] * 6)]
            return self.moved(state, self.moves[int(draw[1] * len(self.moves))], times)
        if (kind < 6 or not self.free_caps) and self.double:
            b = self.double[int(draw[1] * len(self.double))]
            step = (-2, -1, 1, 2)[int(draw[2] * 4)]
            return replace(state, shifts=_put(state.shifts, b, state.shifts[b] + step))
        if not self.free_caps:
            return state
        k = self.free_caps[int(draw[1] * len(self.free_caps))]
        sides = self.lines.ends[self.end_of_cap[k]].sides
        feet, half = len(sides), sum(state.counts[e] for e, _ in sides) // 2
        one, two = int(draw[2] * feet), int(draw[3] * feet)
        if draw[6] < 0.3:
            pair = ((one, 0), (one, 1 + int(draw[4] * (half - 1))))
        else:
            pair = ((one, _step(draw[4])), (two, _step(draw[5])))
        return replace(state, anchors=_put(state.anchors, k, pair))

    def cost(self, state: _State, limit: float = inf) -> float:
        """Return the cost of a state: infinite where it is none, some number above `limit` if it is above."""
        feet, total = self.counted(state.counts)
        if total >= limit:
            return inf
        turning = self.turning(state, feet)
        for k in self.free_caps:
            half, m = feet[self.end_of_cap[k]][-1] // 2, turning.corners[k][1]
            if not 0 < m < half:
                return inf
            total += CORE_COST * 2 * half * log(m / (half - m)) ** 2
        for b, landing in self.landings.items():
            n = feet[self.lines.bands[b].ends[0]][-1]
            off = (state.shifts[b] - self.natural(feet, b)) / n
            off -= round(off)
            total += TWIST_COST * n * off**2 / landing.modulus
        if total >= limit:
            return inf
        left = (limit - total) / self.weight
        return total + self.weight * self.lines.patches(state.counts, turning, feet=feet, limit=left)

    def _counted(self, counts: tuple[int, ...]) -> tuple[list[list[int]], float]:
        """Return the feet of counts and what counts cost; most steps of a search leave counts as they are."""
        feet = self.lines.feet(counts)
        return feet, self.costs.of(counts, feet)

    def natural(self, feet: list[list[int]], band: int) -> float:
        """Shift of a band without twist."""
        near, far = (feet[k] for k in self.lines.bands[band].ends)
        n, total = near[-1], 0j
        for foot, side, share in zip(near, *self.landings[band].at, strict=False):
            at = foot + far[side] + share * (far[side + 1] - far[side])
            total += rect(1.0, tau * at / n)
        return phase(total) / tau * n

    def turning(self, state: _State, feet: list[list[int]]) -> Turning:
        """Return shifts and corners as columns."""
        corners = [(0, 0)] * len(self.end_of_cap)
        for k in self.free_caps:
            here = feet[self.end_of_cap[k]]
            (one, more), (two, further) = state.anchors[k]
            first = here[one] + more
            corners[k] = (first % here[-1], (here[two] + further - first) % here[-1])
        return Turning(state.shifts, tuple(corners))

    def solution(self, state: _State) -> Int[np.ndarray, " n"]:
        """Return counts of all edges and curves."""
        around, feet = np.array(self.given[self.n_edges :]), self.lines.feet(state.counts)
        for band in self.lines.bands:
            if band.ends:
                around[list(band.curves)] = feet[band.ends[0]][-1]
        return np.r_[state.counts, around].astype(np.int64)


def _put(items: tuple[T, ...], k: int, item: T) -> tuple[T, ...]:
    return (*items[:k], item, *items[k + 1 :])


def _step(draw: float) -> int:
    """Mostly 0, else up to two columns either way."""
    return 0 if draw < 0.6 else (-2, -1, 1, 2)[int((draw - 0.6) / 0.4 * 4) % 4]


class _Costs:
    """What counts cost in the count problem, one term per edge and per band."""

    def __init__(self, problem: CountProblem, lines: Lines, n_edges: int) -> None:
        w, t = problem.weight, problem.target
        self.lines = lines
        self.edges = list(
            zip((w / t)[:n_edges].tolist(), (w * t)[:n_edges].tolist(), problem.least[:n_edges].tolist(), strict=True)
        )
        self.bands = []
        for b, band in enumerate(lines.bands):
            if band.ends:
                c = n_edges + np.array(band.curves)
                self.bands.append((b, float((w / t)[c].sum()), float((w * t)[c].sum()), int(problem.least[c].max())))
        self.fixed = 2 * float(w[:n_edges].sum()) + 2 * sum(
            float(w[n_edges + np.array(lines.bands[b].curves)].sum()) for b, *_ in self.bands
        )

    def of(self, counts: Sequence[int], feet: list[list[int]]) -> float:
        total = -self.fixed
        for x, (rise, fall, least) in zip(counts, self.edges, strict=True):
            if x < least:
                return inf
            total += rise * x + fall / x
        for b, rise, fall, least in self.bands:
            n = feet[self.lines.bands[b].ends[0]][-1]
            if n < least:
                return inf
            total += rise * n + fall / n
        return total


def _groups(lines: Lines, n_edges: int) -> list[tuple[int, ...]]:
    """Edges that have the same count because strips lie between them."""
    return united(n_edges, [pair for a, b, c, d in lines.strips for pair in ((a, c), (b, d))])


def _moves(lines: Lines, groups: list[tuple[int, ...]], fixed: set[int], n_edges: int) -> list[_Move]:
    """List changes of up to three groups by one, or one by two, that keep all equations and `fixed` counts.

    A band that has two ends keeps as many columns at both, one with a cap an even number, one with a fixed curve all.
    """
    owner = {e: g for g, edges in enumerate(groups) for e in edges}
    effect: list[dict[int, int]] = [{} for _ in groups]  # on equations: twice the band, and 1 more where it is fixed
    parity: set[int] = set()
    for k, (b, which) in enumerate(lines.place):
        band, signs = lines.bands[b], {}
        if len(band.ends) == 2:
            signs[2 * b] = -1 if which else 1
        elif band.cap >= 0:
            signs[2 * b] = 1
            parity.add(2 * b)
        if which == 0 and any(n_edges + c in fixed for c in band.curves):
            signs[2 * b + 1] = 1
        for e, _ in lines.ends[k].sides:
            mine = effect[owner[e]]
            for equation, sign in signs.items():
                mine[equation] = mine.get(equation, 0) + sign

    def total(parts: Sequence[tuple[int, int]]) -> tuple[tuple[int, int], ...]:
        sums: dict[int, int] = {}
        for g, change in parts:
            for equation, value in effect[g].items():
                sums[equation] = sums.get(equation, 0) + change * value
        kept = [(equation, v % 2 if equation in parity else v) for equation, v in sorted(sums.items())]
        return tuple((equation, v) for equation, v in kept if v)

    free = [g for g, edges in enumerate(groups) if not fixed.intersection(edges)]
    changes = [(g, change) for g in free for change in (1, -1)]
    moves: list[_Move] = [((g, s),) for g in free for s in (1, -1, 2, -2) if not total([(g, s)])]
    by_effect: dict[tuple[tuple[int, int], ...], list[tuple[int, int]]] = {}
    for change in changes:
        by_effect.setdefault(total([change]), []).append(change)
    for one, two in combinations(changes, 2):
        if one[0] == two[0] or not (effect[one[0]].keys() & effect[two[0]].keys()):
            continue
        left = total([one, two])
        if not left:
            moves.append((one, two))
            continue
        wanted = tuple((equation, v if equation in parity else -v) for equation, v in left)
        for three in by_effect.get(wanted, []):
            if three[0] not in (one[0], two[0]):
                first, second, third = sorted((one, two, three))
                moves.append((first, second, third))
    return list(dict.fromkeys(moves))
