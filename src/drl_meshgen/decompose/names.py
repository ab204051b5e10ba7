"""Names for what has a node count or rows, from what it is a part of: `limb3-ring1`, `junction1-limb2-limb3`.

Curves that tubes or seams join form a chain. A chain with a cap is a limb, one between junctions a link, one that ends
at the boundary carries the name of its boundary loop. Each kind is numbered from its largest on, by area or length, so
names do not depend on the wanted size of the mesh, nor on the place or scale of the surface.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Float

from drl_meshgen.decompose.junction import Junction
from drl_meshgen.decompose.pieces import Pieces
from drl_meshgen.partition import Partition

#: Sizes that agree in this many digits count as equal, so that rounding does not number the halves of symmetric shapes.
DIGITS = 6


class EdgeKind(Enum):
    """What an edge of the layout is."""

    CONTOUR = "contour"
    BOUNDARY = "boundary"
    SEAM = "seam"
    SPINE = "spine"
    SIDE = "side of a strip"
    MOUTH = "mouth of a strip"
    ARC = "arc between strips"


@dataclass(frozen=True)
class Names:
    """Names of all counts and rows of a layout; no name occurs twice."""

    edges: tuple[str, ...]
    """Of the graph edges, junction after junction, then of the curves: the order of the count program."""
    kinds: tuple[EdgeKind, ...]
    """Of each edge."""
    rings: tuple[str, ...]
    """Of the rings of all cells and tubes, in the order of `Pieces.rings`."""


@dataclass(frozen=True)
class _Chain:
    """Curves in order with the tubes between them, and what lies at their two ends."""

    curves: tuple[int, ...]
    tubes: tuple[int, ...]
    ends: tuple[str, ...]
    size: float


def name_parts(partition: Partition, parts: Pieces) -> Names:
    """Name all edges and rings of `parts`."""
    length = np.array([curve.arc_length(partition.surface.mesh.vertices)[1] for curve in partition.curves])
    loops = [c for c, curve in enumerate(partition.curves) if curve.is_boundary]
    boundary = dict(zip(loops, _numbered(["boundary"] * len(loops), length[loops], always=True), strict=True))
    order = np.argsort(np.argsort(-_rounded([_area(junction) for junction in parts.junctions]), kind="stable"))
    chains = _chains(parts, length, order.tolist())
    bases = [_base(chain, boundary) for chain in chains]
    plain = [k for k, base in enumerate(bases) if base not in boundary.values()]
    for k, name in zip(
        plain, _numbered([bases[k] for k in plain], [chains[k].size for k in plain], always=True), strict=True
    ):
        bases[k] = name
    curves, of_curve = dict(boundary), {}
    tubes: dict[int, str] = {}
    for chain, name in zip(chains, bases, strict=True):
        rings = [c for c in chain.curves if c not in boundary]
        curves |= dict(zip(rings, _counted(f"{name}-ring", len(rings)), strict=True))
        tubes |= dict(zip(chain.tubes, _counted(f"{name}-rows", len(chain.tubes)), strict=True))
        of_curve |= dict.fromkeys(chain.curves, name)
    edges: list[str] = []
    kinds: list[EdgeKind] = []
    cells: list[str] = []
    for junction, number in zip(parts.junctions, order.tolist(), strict=True):
        own, own_kinds = _graph_names(junction, f"junction{number + 1}", of_curve)
        edges += own
        kinds += own_kinds
        rows = [f"junction{number + 1}-{of_curve[c]}-rows" for c in junction.curves]
        cells += _numbered(rows, length[list(junction.curves)])
    kinds += [EdgeKind.BOUNDARY if curve.is_boundary else EdgeKind.CONTOUR for curve in partition.curves]
    for c in {c for pair in parts.seams for c in pair}:
        kinds[c - len(length)] = EdgeKind.SEAM
    edges += [curves[c] for c in range(len(length))]
    return Names(tuple(edges), tuple(kinds), (*cells, *(tubes[t] for t in range(len(parts.tubes)))))


def _graph_names(
    junction: Junction, prefix: str, of_curve: dict[int, str]
) -> tuple[tuple[str, ...], tuple[EdgeKind, ...]]:
    """Name the edges of a junction's graph by the loops on both of their sides or at both of their ends."""
    n = len(junction.spine.paths)
    beside: list[list[str]] = [[] for _ in range(n)]
    for curve, cell in zip(junction.curves, junction.cells, strict=True):
        for edge, _ in cell.sides:
            beside[edge].append(of_curve[curve])
    kinds = [EdgeKind.SPINE] * n
    names = [f"{prefix}-{'-'.join(sorted(loops, key=_natural))}" for loops in beside]
    rim_of = {edge: of_curve[rim.curve] for rim in junction.rims for edge in rim.sides}
    for edge, loop in rim_of.items():
        kinds[edge], names[edge] = EdgeKind.ARC, f"{prefix}-{loop}-arc"
    for strip in junction.strips:
        near, one, far, other = strip.sides
        for mouth, opposite in ((near, far), (far, near)):
            kinds[mouth], names[mouth] = EdgeKind.MOUTH, f"{prefix}-{rim_of[mouth]}-mouth-{rim_of[opposite]}"
        ends = "-".join(sorted((rim_of[near], rim_of[far]), key=_natural))
        for side in (one, other):
            kinds[side], names[side] = EdgeKind.SIDE, f"{prefix}-{ends}-side"
    return _numbered(names, junction.lengths), tuple(kinds)


def _chains(parts: Pieces, length: Float[np.ndarray, " c"], order: Sequence[int]) -> list[_Chain]:
    """Chains of curves, each from the junction of smallest number or the boundary towards its cap."""
    ends: list[list[str]] = [[] for _ in length]
    area = length * 0
    for j, junction in enumerate(parts.junctions):
        for c in (*junction.curves, *(rim.curve for rim in junction.rims)):
            ends[c].append(f"junction{order[j]}")
    for cap in parts.caps:
        ends[cap.curve].append("~cap")  # sorts last
        area[cap.curve] += cap.mesh.area
    links = [*(tube.curves for tube in parts.tubes), *parts.seams]
    at: list[list[int]] = [[] for _ in length]
    for t, pair in enumerate(links):
        for c in pair:
            at[c].append(t)
    chains, seen = [], set()
    for start in [*(c for c in range(len(length)) if len(at[c]) < 2), *range(len(length))]:
        if start in seen:
            continue
        curves, tubes = [start], []
        while ahead := [t for t in at[curves[-1]] if t not in tubes]:
            tubes.append(ahead[0])
            one, other = links[ahead[0]]
            curves.append(other if one == curves[-1] else one)
        if tubes and curves[-1] == start:
            curves.pop()
        seen.update(curves)
        tubes = [t for t in tubes if t < len(parts.tubes)]
        first, last = (sorted(_natural(end) for end in ends[c]) for c in (curves[0], curves[-1]))
        if first > last:
            curves, tubes = curves[::-1], tubes[::-1]
        size = float(sum(area[c] for c in curves) + sum(parts.tubes[t].ring.mesh.area for t in tubes))
        around = tuple(end for c in curves for end in ends[c])
        chains.append(_Chain(tuple(curves), tuple(tubes), around, size or float(length[start])))
    return chains


def _base(chain: _Chain, boundary: dict[int, str]) -> str:
    if "~cap" in chain.ends:
        return "limb"
    loops = [boundary[c] for c in chain.curves if c in boundary]
    if loops:
        return min(loops, key=_natural)
    return "link" if len(chain.ends) == 2 else "ring"


def _natural(name: str) -> tuple[str, int]:
    """Key by which `limb10` comes after `limb9`."""
    stem = name.rstrip("0123456789")
    return stem, int(name[len(stem) :] or 0)


def _area(junction: Junction) -> float:
    return sum(cell.ring.mesh.area for cell in junction.cells) + sum(strip.mesh.area for strip in junction.strips)


def _rounded(sizes: Sequence[float] | np.ndarray) -> Float[np.ndarray, " n"]:
    values = np.asarray(sizes, float)
    return np.round(values / max(values.max(initial=0.0), np.finfo(float).tiny), DIGITS)


def _counted(name: str, n: int) -> tuple[str, ...]:
    return (name,) if n == 1 else tuple(f"{name}{k + 1}" for k in range(n))


def _numbered(names: list[str], sizes: Sequence[float] | np.ndarray, *, always: bool = False) -> tuple[str, ...]:
    """Append numbers to names that occur more than once, or to all, from the largest on; then by place."""
    out, total = list(names), Counter(names)
    met: Counter[str] = Counter()
    for k in np.argsort(-_rounded(sizes), kind="stable").tolist():
        met[names[k]] += 1
        if always:
            out[k] = f"{names[k]}{met[names[k]]}"
        elif total[names[k]] > 1:
            out[k] = f"{names[k]}-{met[names[k]]}"
    return tuple(out)
