"""Where on the join tree the surface is cut: one or two isovalues on every arc."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float

from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.curves import closed_length
from drl_meshgen.partition.join_tree import Arc, JoinTree, Large


@dataclass(frozen=True)
class PartitionOptions:
    """How the depth becomes regions. Depth is a log scale: one unit is a factor e of conformal length."""

    smoothing: int = 3
    """Damped averaging sweeps of the depth before anything else (count)."""
    persistence: float = 1.2
    """Tips that rise less above their saddle are noise (depth units)."""
    large_limb: float = 0.0025
    """Limbs of at least this area are not noise so soon: they would be missed (share of the surface's)."""
    large_share: float = 0.7
    """Share of the persistence that they need (ratio)."""
    min_arc: float = 0.6
    """Saddles closer than this along an arc are one junction (depth units)."""
    cap_depth: float = 1.0
    """How far below a tip its cap is cut off (depth units)."""
    min_tube: float = 0.5
    """Two contours on one arc are kept apart by at least this, else one is cut (depth units)."""
    saddle_clearance: float = 0.25
    """Closest approach of a contour to a saddle (depth units)."""
    saddle_reach: float = 1.5
    """Farthest from a saddle that its contour is looked for (depth units)."""
    bottleneck: float = 1.3
    """A tube is put between the boundary and the first junction if its contour is at most this times the boundary."""
    widening: float = 2.0
    """A tube may end in a contour this much longer than its shortest: between junctions it has none there else,
    behind a loop it ends before (ratio)."""
    collar: float = 0.5
    """Limbs that end in one of several loops are cut off where they are at least this long (girths); 0: never."""
    flare: float = 2.0
    """They end where the logarithm of their girth grows faster per girth (ratio; 2 pi in a plane)."""
    neck: float = 1.5
    """A contour around several loops gives way to a curve around the same loops if so much longer (ratio); 0: never."""
    least_girth: float = 3.0
    """Small limbs of less typical girth stay with what they grow from (wanted edges); 0 keeps all."""
    small_limb: float = 20.0
    """Limbs of less area are small (wanted quads)."""
    target_quads: int = 0
    """Wanted number of quads, 0: not known; a run takes that of `decompose`."""
    target_edge: float = 0.0
    """Wanted edge length, 0: by the number of quads; a run takes that of `decompose` (model units)."""

    def large(self, surface: TriMesh) -> Large:
        """Return which limbs of `surface` are large."""
        return Large(surface.vertex_areas, self.large_limb * surface.area, self.large_share * self.persistence)


@dataclass(frozen=True)
class Level:
    """One contour to cut: the arc, the isovalue, a tip above it, its length on the surface (model units)."""

    arc: int
    value: float
    tip: int
    length: float
    reason: str


def arc_lengths(
    surface: TriMesh, depth: Float[np.ndarray, " v"], faces: np.ndarray, values: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Length of the isocontours of `depth` at `values` within `faces` (model units)."""
    tri = surface.triangles[faces]
    rising = np.argsort(depth[tri], axis=1, kind="stable")
    tri = np.take_along_axis(tri, rising, axis=1)
    order = np.argsort(values, kind="stable")
    # the values strictly between the lowest and the highest corner of each triangle, one after the other
    first = np.searchsorted(values[order], depth[tri[:, 0]], side="right")
    count = np.maximum(np.searchsorted(values[order], depth[tri[:, 2]]) - first, 0)
    tri = np.repeat(tri, count, axis=0)
    at = np.arange(len(tri)) - np.repeat(np.cumsum(count) - count - first, count)
    value = values[order][at]
    p, f = surface.vertices, depth

    def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        share = np.clip((value - f[a]) / np.where(f[b] > f[a], f[b] - f[a], 1.0), 0, 1)[:, None]
        return p[a] + share * (p[b] - p[a])

    low, middle, high = tri.T
    below = value < f[middle]
    near = between(np.where(below, low, middle), np.where(below, middle, high))
    out = np.empty(len(values))
    out[order] = np.bincount(at, np.linalg.norm(between(low, high) - near, axis=1), len(values))
    return out


@dataclass(frozen=True, eq=False)
class _ArcContours:
    """Isocontours within one arc of the join tree."""

    index: int
    arc: Arc
    surface: TriMesh
    depth: Float[np.ndarray, " v"]
    faces: Bool[np.ndarray, " f"]

    def level(self, value: float, reason: str) -> Level:
        length = float(arc_lengths(self.surface, self.depth, self.faces, np.array([value]))[0])
        return Level(self.index, value, self.arc.tips[0], length, reason)

    def near_saddle(self, saddle: float, direction: float, options: PartitionOptions) -> float:
        """Level nearest the saddle whose contour is within 10 % of the shortest one in reach."""
        gap = self.arc.high - self.arc.low
        first = min(options.saddle_clearance, gap / 3)
        last = max(first, min(options.saddle_reach, gap / 2))
        values = saddle + direction * np.linspace(first, last, 9)
        lengths = arc_lengths(self.surface, self.depth, self.faces, values)
        return float(values[np.argmax(lengths <= 1.1 * lengths.min())])


def choose_levels(
    surface: TriMesh, depth: Float[np.ndarray, " v"], tree: JoinTree, options: PartitionOptions
) -> tuple[Level, ...]:
    """Choose the isovalues: each strictly inside its own arc, the shortest contour near a junction preferred."""
    component = surface.vertex_components
    rims: dict[int, list[float]] = {}
    for loop in surface.topology.loops:
        rims.setdefault(int(component[loop[0]]), []).append(closed_length(surface.vertices[loop]))
    levels: list[Level] = []
    for index, arc in enumerate(tree.arcs):
        faces = np.asarray(np.isin(tree.basin[surface.triangles], arc.tips).any(axis=1))
        loops = rims[int(component[arc.tips[0]])]
        # with several loops at depth 0 a contour around one of them says nothing about a bottleneck
        rim = loops[0] if len(loops) == 1 else 0.0
        levels += _levels_of(_ArcContours(index, arc, surface, depth, faces), rim, options)
    return tuple(levels)


def _levels_of(at: _ArcContours, rim: float, options: PartitionOptions) -> list[Level]:
    """Levels of one arc; `rim` is the length of the boundary (model units)."""
    arc, gap = at.arc, at.arc.high - at.arc.low
    if arc.upper < 0:  # ends in a tip
        cap = max(arc.high - options.cap_depth, (arc.high + arc.low) / 2)
        if arc.lower < 0:
            return [at.level(cap, "cap")] if gap > options.cap_depth + 1 else []
        root = at.near_saddle(arc.low, 1.0, options)
        if cap - root >= options.min_tube:
            return [at.level(root, "limb"), at.level(cap, "cap")]
        return [at.level(root, "limb and cap")]
    if arc.lower < 0:  # reaches the boundary
        if gap < options.min_tube:
            return []
        below = at.level(at.near_saddle(arc.high, -1.0, options), "bottleneck")
        return [below] if below.length <= options.bottleneck * rim else []
    upper, lower = at.near_saddle(arc.high, -1.0, options), at.near_saddle(arc.low, 1.0, options)
    if upper - lower < options.min_tube:
        return [at.level((upper + lower) / 2, "between junctions")]
    both = [at.level(lower, "limb"), at.level(upper, "limb")]
    short = min(level.length for level in both)
    return [level for level in both if level.length <= options.widening * short]


def isovalue_table(tree: JoinTree, levels: tuple[Level, ...], first: int = 0) -> pd.DataFrame:
    """One row per contour: isovalue, arc (its range, tips, junctions), length, why it was cut.

    Contours are numbered from `first`.
    """
    rows = [
        {
            "contour": n,
            "isovalue": level.value,
            "reason": level.reason,
            "length": level.length,
            "arc": level.arc,
            "arc_low": tree.arcs[level.arc].low,
            "arc_high": tree.arcs[level.arc].high,
            "upper": tree.arcs[level.arc].upper,
            "lower": tree.arcs[level.arc].lower,
            "tips": ",".join(map(str, sorted(tree.arcs[level.arc].tips))),
        }
        for n, level in enumerate(levels, first)
    ]
    columns = ["contour", "isovalue", "reason", "length", "arc", "arc_low", "arc_high", "upper", "lower", "tips"]
    return pd.DataFrame(rows, columns=columns)
