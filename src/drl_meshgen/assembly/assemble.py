"""The assembly stage: one mesh from all pieces, welded by ids that follow from what a node belongs to."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.assembly.blocks import Annulus, blocks
from drl_meshgen.assembly.subdomains import Subdomains
from drl_meshgen.decompose import Layout


@dataclass(frozen=True, eq=False)
class Assembly:
    """Block grids over node ids, and where each node lies: in the chart of one of the pieces that share it.

    `piece (n,)` counts rings in the order of `Pieces.rings`, then caps; `chart (n, 2)` is `(theta, h)` or `(x, y)`.
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


def assemble(layout: Layout, subdomains: Subdomains) -> Assembly:
    """Give ids to all nodes, stack the pieces into bands and cut these into structured blocks."""
    nodes = _Nodes()
    curves = [nodes.new(int(n)) for n in layout.curve_counts]
    annuli: list[Annulus] = []
    fills = iter(subdomains.rings)
    for junction, counts in zip(layout.pieces.junctions, layout.edge_counts, strict=True):
        ends = nodes.new(len(junction.spine.nodes))
        edges = [
            np.r_[ends[a], nodes.new(int(n) - 1), ends[b]]
            for (a, b), n in zip(junction.spine.ends, counts, strict=True)
        ]
        for c, cell in zip(junction.curves, junction.cells, strict=True):
            one = next(fills)
            sides = [edges[e] if forward else edges[e][::-1] for e, forward in cell.sides]
            outer = np.concatenate([side[:-1] for side in sides])
            inner = nodes.new((len(one.chart) - 2) * len(outer)).reshape(-1, len(outer))
            ids = np.vstack([curves[c][one.first], inner, outer])
            annuli.append(Annulus(ids, c, -1, _feet(sides), is_cell=True))
    for tube in layout.pieces.tubes:
        one = next(fills)
        a, b = tube.curves
        inner = nodes.new((len(one.chart) - 2) * len(one.first)).reshape(-1, len(one.first))
        annuli.append(Annulus(np.vstack([curves[a][one.first], inner, curves[b][one.last]]), a, b))
    cores, cap_ids = [], []
    for cap, one in zip(layout.pieces.caps, subdomains.caps, strict=True):
        n = len(one.first)
        ids = np.r_[curves[cap.curve][one.first], nodes.new(len(one.chart) - n)]
        annuli.append(Annulus(ids[: n * (one.layers + 1)].reshape(-1, n), cap.curve, -1, one.corners))
        cores.append(ids[one.core])
        cap_ids.append(ids)
    piece, chart = nodes.arrays()
    placements = [(a.ids.ravel(), f.chart.reshape(-1, 2)) for a, f in zip(annuli, subdomains.rings, strict=False)]
    placements += [(ids, one.chart) for ids, one in zip(cap_ids, subdomains.caps, strict=True)]
    for k, (ids, where) in reversed(list(enumerate(placements))):
        piece[ids], chart[ids] = k, where
    return Assembly((*cores, *blocks(annuli)), piece, chart)


def _feet(sides: list[np.ndarray]) -> tuple[int, ...]:
    """Columns of the dividing lines of a cell: where its sides begin, and the middle of sides that are closed."""
    feet, start = [], 0
    for side in sides:
        feet.append(start)
        if side[0] == side[-1]:
            feet.append(start + (len(side) - 1) // 2)
        start += len(side) - 1
    return tuple(feet)
