"""The assembly stage: one mesh from all pieces, welded by ids that follow from what a node belongs to."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.assembly.blocks import Annulus, along_feet, along_separatrices, bands
from drl_meshgen.assembly.subdomains import StripFill, Subdomains
from drl_meshgen.assembly.transition import TransitionFill
from drl_meshgen.decompose import Junction, Layout


@dataclass(frozen=True)
class AssemblyOptions:
    """How the mesh is cut into blocks."""

    most_blocks: int = 300
    """Blocks are the patches of the base complex, whose interfaces are 1-to-1, where there are at most this many; else
    bands, which are fewer and meet in T-junctions (count)."""


@dataclass(frozen=True, eq=False)
class Assembly:
    """Block grids over node ids, and where each node lies: in the chart of one of the pieces that share it.

    `piece (n,)` counts rings in the order of `Pieces.rings`, then caps, then strips; `chart (n, 2)` is `(theta, h)` on
    rings and `(x, y)` elsewhere.
    """

    grids: tuple[Int[np.ndarray, "ni1 nj1"], ...]
    piece: Int[np.ndarray, " n"]
    chart: Float[np.ndarray, "n 2"]


class _Nodes:
    """Ids handed out in order; the first piece that has a node says where it is."""

    def __init__(self) -> None:
        self._piece: list[np.ndarray] = []
        self._chart: list[np.ndarray] = []
        self._count = 0

    def new(self, n: int) -> Int[np.ndarray, " n"]:
        self._piece.append(np.full(n, -1))
        self._chart.append(np.zeros((n, 2)))
        self._count += n
        return np.arange(self._count - n, self._count)

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        return np.concatenate(self._piece), np.concatenate(self._chart)


def assemble(layout: Layout, subdomains: Subdomains, options: AssemblyOptions | None = None) -> Assembly:
    """Give ids to all nodes, stack the pieces into bands and cut these into structured blocks."""
    options = options or AssemblyOptions()
    nodes = _Nodes()
    shared = layout.pieces.shared(len(layout.curve_counts)).tolist()
    curves: list[np.ndarray] = []
    for c, n in enumerate(layout.curve_counts.tolist()):
        curves.append(nodes.new(n) if shared[c] == c else curves[shared[c]])
    annuli: list[Annulus] = []
    fills, strip_fills, rims = iter(subdomains.rings), iter(subdomains.strips), iter(subdomains.rims)
    patches, transitions = [], []
    for junction, counts in zip(layout.pieces.junctions, layout.edge_counts, strict=True):
        edges = _edge_nodes(junction, counts, nodes, curves, [next(rims) for _ in junction.rims])
        for c, cell in zip(junction.curves, junction.cells, strict=True):
            one = next(fills)
            sides = [edges[e] if forward else edges[e][::-1] for e, forward in cell.sides]
            outer = np.concatenate([side[:-1] for side in sides])
            inner = nodes.new((len(one.chart) - 2) * len(outer)).reshape(-1, len(outer))
            ids = np.vstack([curves[c][one.first], inner, outer])
            annuli.append(Annulus(ids, shared[c], -1, _feet(sides), is_cell=True))
        patches += [_patch([edges[e] for e in strip.sides], next(strip_fills), nodes) for strip in junction.strips]
    ring_ids = [annulus.ids for annulus in annuli]
    for tube in layout.pieces.tubes:
        one = next(fills)
        a, b = tube.curves
        if isinstance(one, TransitionFill):
            ends = np.r_[curves[a][one.first], curves[b][one.last]]
            ring_ids.append(np.r_[ends, nodes.new(len(one.chart) - len(ends))])
            transitions += [ring_ids[-1][grid] for grid in one.grids]
        else:
            inner = nodes.new((len(one.chart) - 2) * len(one.first)).reshape(-1, len(one.first))
            ring_ids.append(np.vstack([curves[a][one.first], inner, curves[b][one.last]]))
            annuli.append(Annulus(ring_ids[-1], shared[a], shared[b]))
    cores, cap_ids = [], []
    for cap, one in zip(layout.pieces.caps, subdomains.caps, strict=True):
        n = len(one.first)
        ids = np.r_[curves[cap.curve][one.first], nodes.new(len(one.chart) - n)]
        annuli.append(Annulus(ids[: n * (one.layers + 1)].reshape(-1, n), shared[cap.curve], -1, one.corners))
        cores.append(ids[one.core])
        cap_ids.append(ids)
    piece, chart = nodes.arrays()
    placements = [(ids.ravel(), one.chart.reshape(-1, 2)) for ids, one in zip(ring_ids, subdomains.rings, strict=True)]
    placements += [(ids, one.chart) for ids, one in zip(cap_ids, subdomains.caps, strict=True)]
    others = len(placements)
    placements += [(ids.ravel(), one.chart.reshape(-1, 2)) for ids, one in zip(patches, subdomains.strips, strict=True)]
    # the first ring or cap says where a node is, but a strip before all: charts of rings are singular at its corners
    for k in (*reversed(range(others)), *range(others, len(placements))):
        ids, where = placements[k]
        piece[ids], chart[ids] = k, where
    whole = [*cores, *patches, *transitions]
    grids = along_separatrices(whole, bands(annuli, through=True), len(piece))
    if len(grids) > options.most_blocks:
        grids = [*whole, *along_feet(bands(annuli, through=False))]
    return Assembly(tuple(grids), piece, chart)


def _edge_nodes(
    junction: Junction,
    counts: Int[np.ndarray, " e"],
    nodes: _Nodes,
    curves: list[Int[np.ndarray, " n"]],
    rims: list[Int[np.ndarray, " n"]],
) -> list[Int[np.ndarray, " k"]]:
    """Nodes along each edge of the junction's graph: those of curves on rims, new ones elsewhere."""
    edges: list[np.ndarray] = [np.empty(0, np.int64)] * len(counts)
    ends = np.full(len(junction.spine.nodes), -1)
    for rim, order in zip(junction.rims, rims, strict=True):
        around, start = curves[rim.curve][order], 0
        for e in rim.sides:
            edges[e] = around[np.arange(start, start + counts[e] + 1) % len(around)]
            ends[junction.spine.ends[e][0]] = edges[e][0]
            start += int(counts[e])
    free = ends < 0
    ends[free] = nodes.new(int(free.sum()))
    for e, (a, b) in enumerate(junction.spine.ends):
        if not len(edges[e]):
            edges[e] = np.r_[ends[a], nodes.new(int(counts[e]) - 1), ends[b]]
    return edges


def _patch(sides: list[Int[np.ndarray, " k"]], fill: StripFill, nodes: _Nodes) -> Int[np.ndarray, "w1 l1"]:
    """Nodes of a strip between its four sides, which run anti-clockwise from the corner `[0, 0]`."""
    ids = np.empty(fill.chart.shape[:2], np.int64)
    inner = ids[1:-1, 1:-1]
    inner[:] = nodes.new(inner.size).reshape(inner.shape)
    ids[:, 0], ids[-1], ids[:, -1], ids[0] = sides[0], sides[1], sides[2][::-1], sides[3][::-1]
    return ids


def _feet(sides: list[np.ndarray]) -> tuple[int, ...]:
    """Columns of the dividing lines of a cell: where its sides begin, and the middle of sides that are closed."""
    feet, start = [], 0
    for side in sides:
        feet.append(start)
        if side[0] == side[-1]:
            feet.append(start + (len(side) - 1) // 2)
        start += len(side) - 1
    return tuple(feet)
