"""Join tree of a depth function: how superlevel sets are born at tips and merge at saddles.

Vertices are compared by (value, index), so ties never matter. Basins of steepest ascent are found by pointer
jumping; only edges between basins enter the union-find, which keeps the sequential part tiny.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from jaxtyping import Float, Int


@dataclass(frozen=True)
class Arc:
    """A superlevel component between two critical levels.

    `tips` are the significant maxima inside it; `low < level < high` are the levels at which it exists by itself.
    `upper` is the tip (when one tip) or the junction it starts from, `lower` the junction it runs into (-1: root).
    """

    tips: tuple[int, ...]
    low: float
    high: float
    upper: int
    lower: int


@dataclass(frozen=True, eq=False)
class Large:
    """Which limbs need less `persistence` than others: those whose vertices have at least `least` of `area (v,)`."""

    area: Float[np.ndarray, " v"]
    least: float
    persistence: float


@dataclass(frozen=True, eq=False)
class JoinTree:
    """Simplified join tree.

    `merges` lists every merge of two basins: saddle vertex and value, the tip that dies and the one that survives,
    persistence, and whether it is significant. `basin (v,)` is the tip each vertex climbs to after noise is absorbed.
    """

    merges: pd.DataFrame
    tips: tuple[int, ...]
    arcs: tuple[Arc, ...]
    basin: Int[np.ndarray, " v"]


def join_tree(
    edges: Int[np.ndarray, "e 2"],
    depth: Float[np.ndarray, " v"],
    persistence: float,
    min_arc: float,
    large: Large | None = None,
) -> JoinTree:
    """Build the join tree of `depth` on the graph `edges`, one for each of its components, and simplify it.

    Tips of less than `persistence` are absorbed, unless both sides of their saddle are `large`; saddles joined by an
    arc shorter than `min_arc` become one junction. `persistence` and `min_arc` are in units of the depth (log scale).
    """
    basin = _basins(edges, depth)
    merges = _merges(edges, depth, basin)
    significant = merges.persistence.to_numpy() >= persistence
    if large is not None:
        asked = ~significant & (merges.persistence.to_numpy() >= large.persistence)
        significant |= _smaller_sides(merges, asked, depth, basin, large.area) >= large.least
    merges["significant"] = significant
    tops = np.setdiff1d(basin, merges.dies).tolist()
    tips = (*tops, *merges.dies[significant].astype(int))
    return JoinTree(merges, tuple(sorted(tips)), _arcs(merges, depth, tops, min_arc), _absorbed(basin, merges))


def _ranks(depth: np.ndarray) -> np.ndarray:
    rank = np.empty(len(depth), np.int64)
    rank[np.lexsort((np.arange(len(depth)), depth))] = np.arange(len(depth))
    return rank


def _basins(edges: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Local maximum that steepest ascent reaches from every vertex."""
    rank = _ranks(depth)
    best = rank.copy()
    np.maximum.at(best, edges[:, 0], rank[edges[:, 1]])
    np.maximum.at(best, edges[:, 1], rank[edges[:, 0]])
    order = np.argsort(rank)
    up = order[best]
    while True:
        further = up[up]
        if np.array_equal(further, up):
            return up
        up = further


def _merges(edges: np.ndarray, depth: np.ndarray, basin: np.ndarray) -> pd.DataFrame:
    rank = _ranks(depth)
    across = edges[basin[edges[:, 0]] != basin[edges[:, 1]]]
    lower = np.where((rank[across[:, 0]] < rank[across[:, 1]]), across[:, 0], across[:, 1])
    order = np.argsort(-rank[lower], kind="stable")
    parent: dict[int, int] = {}

    def find(v: int) -> int:
        root = v
        while parent.get(root, root) != root:
            root = parent[root]
        while parent.get(v, v) != root:
            parent[v], v = root, parent[v]
        return root

    rows = []
    for saddle, a, b in zip(lower[order].tolist(), *basin[across[order]].T.tolist(), strict=True):
        ra, rb = find(a), find(b)
        if ra == rb:
            continue
        dies, survives = (ra, rb) if rank[ra] < rank[rb] else (rb, ra)
        parent[dies] = survives
        rows.append((saddle, depth[saddle], dies, survives, depth[dies] - depth[saddle]))
    frame = pd.DataFrame(rows, columns=["saddle", "value", "dies", "survives", "persistence"])
    return frame.astype(
        {"saddle": np.int64, "dies": np.int64, "survives": np.int64, "value": float, "persistence": float}
    )


def _smaller_sides(
    merges: pd.DataFrame, asked: np.ndarray, depth: np.ndarray, basin: np.ndarray, area: np.ndarray
) -> Float[np.ndarray, " m"]:
    """Area above each saddle of the smaller of the two components that meet there; -1 where nobody `asked`."""
    order = np.lexsort((-depth, basin))
    tips, first = np.unique(basin[order], return_index=True)
    bounds = np.r_[first, len(order)]
    span = {int(tip): (int(a), int(b)) for tip, a, b in zip(tips, bounds, bounds[1:], strict=False)}
    height, total = -depth[order], np.r_[0.0, np.cumsum(area[order])]

    def above(members: list[int], level: float) -> float:
        ends = [(a, a + np.searchsorted(height[a:b], -level)) for a, b in (span[tip] for tip in members)]
        return float(sum(total[b] - total[a] for a, b in ends))

    members: dict[int, list[int]] = {}
    out = np.full(len(merges), -1.0)
    for k, (level, dies, survives) in enumerate(merges[["value", "dies", "survives"]].itertuples(index=False)):
        less, more = sorted((members.pop(int(tip), [int(tip)]) for tip in (dies, survives)), key=len)
        if asked[k]:
            out[k] = min(above(less, level), above(more, level))
        more.extend(less)
        members[int(survives)] = more
    return out


def _absorbed(basin: np.ndarray, merges: pd.DataFrame) -> np.ndarray:
    """Basin of each vertex after insignificant tips went to what swallowed them."""
    target = np.arange(len(basin))
    small = merges[~merges.significant]
    target[small.dies.to_numpy()] = small.survives.to_numpy()
    while True:
        further = target[target]
        if np.array_equal(further, target):
            return target[basin]
        target = further


def _arcs(merges: pd.DataFrame, depth: np.ndarray, tops: list[int], min_arc: float) -> tuple[Arc, ...]:
    """Arcs between tips, junctions (clusters of saddles) and the root, highest junction first."""
    alive: dict[int, tuple[tuple[int, ...], float, int]] = {}  # tip -> tips below, level it starts from, junction
    arcs: list[Arc] = []
    n_junctions = 0

    def component(tip: int) -> tuple[tuple[int, ...], float, int]:
        return alive.get(tip, ((tip,), float(depth[tip]), -1))

    for saddle, dies, survives in merges.loc[merges.significant, ["value", "dies", "survives"]].itertuples(index=False):
        junction, parts = -1, []
        for tips, high, upper in (component(int(survives)), component(int(dies))):
            if upper >= 0 and high - saddle < min_arc:
                # too short to be an arc of its own: its junction and the new one become one
                if junction >= 0:
                    arcs = [
                        Arc(a.tips, a.low, a.high, a.upper, junction if a.lower == upper else a.lower) for a in arcs
                    ]
                else:
                    junction = upper
            else:
                parts.append((tips, high, upper))
        if junction < 0:
            junction, n_junctions = n_junctions, n_junctions + 1
        arcs += [Arc(tips, float(saddle), high, upper, junction) for tips, high, upper in parts]
        alive[int(survives)] = (component(int(survives))[0] + component(int(dies))[0], float(saddle), junction)
    for top in tops:
        tips, high, upper = component(top)
        arcs.append(Arc(tips, 0.0, high, upper, -1))
    return tuple(arcs)
