"""One mesh from all pieces: nodes get ids by what they belong to, never by where they are."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.assembly.align import Alignment, align
from drl_meshgen.assembly.fill import cap_nodes, ring_nodes
from drl_meshgen.decompose import Cap, Layout
from drl_meshgen.decompose.cells import Ring
from drl_meshgen.mesh import BlockMesh, TriMesh
from drl_meshgen.partition import Curve, Partition
from drl_meshgen.templates import Policy, RulePolicy


class _Nodes:
    """Ids handed out in order, with positions."""

    def __init__(self) -> None:
        self.positions: list[np.ndarray] = []
        self.count = 0

    def add(self, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        self.positions.append(points)
        self.count += len(points)
        return np.arange(self.count - len(points), self.count)


@dataclass(frozen=True, eq=False)
class _Annulus:
    """Node ids `(rows + 1, n)` from curve `first` to curve `last` (-1: a spine or a core).

    Columns run so that (column, row) is right-handed on the surface. `feet` are the columns of dividing lines.
    """

    ids: Int[np.ndarray, "r n"]
    first: int
    last: int
    feet: tuple[int, ...] = ()
    is_cell: bool = False

    def flipped(self) -> "_Annulus":
        """The same ring seen from its other end; column 0 stays."""
        n = self.ids.shape[1]
        ids = np.roll(self.ids[::-1, ::-1], 1, axis=1)
        return _Annulus(ids, self.last, self.first, tuple((n - f) % n for f in self.feet), self.is_cell)


def assemble(partition: Partition, layout: Layout, policy: Policy | None = None) -> BlockMesh:
    """Fill every piece of `layout` in its chart, weld the pieces by node ids and cut the result into blocks.

    `policy` chooses the parameters of the O-type template of every cap.
    """
    policy = policy or RulePolicy()
    placed = align(partition, layout)
    surface = partition.surface.mesh
    nodes = _Nodes()
    curve_ids = [
        nodes.add(points_on(curve, surface, at)) for curve, at in zip(partition.curves, placed.positions, strict=True)
    ]
    annuli: list[_Annulus] = []
    grids: list[np.ndarray] = []
    for junction, counts, rows, columns in zip(
        layout.pieces.junctions, layout.edge_counts, layout.cell_rows, placed.cells, strict=True
    ):
        node_ids = nodes.add(junction.points[junction.spine.nodes])
        edge_ids = []
        for path, (a, b), count in zip(junction.spine.paths, junction.spine.ends, counts, strict=True):
            inner = nodes.add(_along(junction.points[path], int(count))[1:-1])
            edge_ids.append(np.r_[node_ids[a], inner, node_ids[b]])
        for c, cell, r, (foot, outer_theta) in zip(junction.curves, junction.cells, rows, columns, strict=True):
            sides = [edge_ids[e] if forward else edge_ids[e][::-1] for e, forward in cell.sides]
            outer = np.concatenate([side[:-1] for side in sides])
            feet = _feet(sides)
            ids = _ring_ids(nodes, cell.ring, curve_ids[c][foot.nodes()], outer, foot.theta, outer_theta, int(r))
            annuli.append(_Annulus(ids, c, -1, feet, is_cell=True))
    for tube, r, (one, two) in zip(layout.pieces.tubes, layout.tube_rows, placed.tubes, strict=True):
        a, b = tube.curves
        inner, outer = curve_ids[a][one.nodes()], curve_ids[b][two.nodes()]
        ids = _ring_ids(nodes, tube.ring, inner, outer, one.theta, two.theta, int(r))
        annuli.append(_Annulus(ids, a, b))
    for cap in layout.pieces.caps:
        ids, core, corners = _cap_ids(nodes, partition, cap, curve_ids[cap.curve], placed.positions[cap.curve], policy)
        annuli.append(_Annulus(ids, cap.curve, -1, corners))
        grids.append(core)
    grids += _blocks(annuli)
    return BlockMesh(np.concatenate(nodes.positions), tuple(grids))


def points_on(curve: Curve, surface: TriMesh, positions: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """Points of a closed curve at shares of its length (period 1)."""
    at, _ = curve.arc_length(surface.vertices)
    closed = surface.vertices[np.r_[curve.vertices, curve.vertices[0]]]
    return np.stack([np.interp(positions % 1.0, np.r_[at, 1.0], closed[:, k]) for k in range(3)], axis=1)


def _along(points: Float[np.ndarray, "k 3"], count: int) -> Float[np.ndarray, "n 3"]:
    """`count + 1` equally spaced points of a polyline."""
    length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    return np.stack([np.interp(np.linspace(0, length[-1], count + 1), length, points[:, k]) for k in range(3)], axis=1)


def _ring_ids(
    nodes: _Nodes,
    ring: Ring,
    inner: np.ndarray,
    outer: np.ndarray,
    inner_theta: np.ndarray,
    outer_theta: np.ndarray,
    rows: int,
) -> Int[np.ndarray, "r n"]:
    turns = np.round((inner_theta - outer_theta).mean())
    points = ring_nodes(ring, inner_theta, outer_theta + turns, rows)
    between = nodes.add(points.reshape(-1, 3)).reshape(rows - 1, len(inner))
    return np.vstack([inner, between, outer])


def _cap_ids(
    nodes: _Nodes, partition: Partition, cap: Cap, curve_nodes: np.ndarray, positions: np.ndarray, policy: Policy
) -> tuple[np.ndarray, np.ndarray, tuple[int, ...]]:
    """Ids of the layers of a cap, of its core, and the columns of its corners."""
    curve = partition.curves[cap.curve]
    at, length = curve.arc_length(partition.surface.mesh.vertices)
    place = {int(v): float(s) for v, s in zip(curve.vertices, at, strict=True)}
    loop = np.array([place[int(v)] for v in cap.origin[cap.loop]])
    forward = ((loop[1] - loop[0]) % 1.0) < 0.5
    share = (loop - loop[0]) % 1.0 if forward else (loop[0] - loop) % 1.0
    node_share = (positions - loop[0]) % 1.0 if forward else (loop[0] - positions) % 1.0
    order = np.argsort(node_share, kind="stable")
    filled, points = cap_nodes(
        cap, 2 * np.pi * node_share[order], 2 * np.pi * share, policy, length / len(positions)
    )
    n = len(positions)
    inner = nodes.add(points[n:])
    ids = np.r_[curve_nodes[order], inner]
    layers = filled.parameters.layers
    corners = tuple(sorted(int(c) for c in filled.parameters.corners))
    return ids[: n * (layers + 1)].reshape(layers + 1, n), ids[filled.grids[0]], corners


def _feet(sides: list[np.ndarray]) -> tuple[int, ...]:
    """Columns of the dividing lines of a cell: where its sides begin, and the middle of sides that close on themselves."""
    feet, start = [], 0
    for side in sides:
        feet.append(start)
        if side[0] == side[-1]:
            feet.append(start + (len(side) - 1) // 2)
        start += len(side) - 1
    return tuple(feet)


def _blocks(annuli: list[_Annulus]) -> list[np.ndarray]:
    """Stack rings that share a curve into bands and cut each band along the dividing lines of its first ring.

    A band starts at a cell and runs through tubes to a cap, the boundary or the next cell; caps and tubes that no cell
    reaches start bands of their own.
    """
    at: dict[int, list[int]] = {}
    for k, ring in enumerate(annuli):
        for c in {ring.first, ring.last} - {-1}:
            at.setdefault(c, []).append(k)
    used: set[int] = set()
    grids = []
    starts = [k for k, ring in enumerate(annuli) if ring.last == -1] + list(range(len(annuli)))
    for k in starts:
        if k in used:
            continue
        used.add(k)
        rows, here = annuli[k].ids, annuli[k].first
        while here >= 0:
            ahead = [q for q in at[here] if q not in used and not annuli[q].is_cell]
            if not ahead:
                break
            used.add(ahead[0])
            piece = annuli[ahead[0]] if annuli[ahead[0]].last == here else annuli[ahead[0]].flipped()
            shift = int(np.nonzero(piece.ids[-1] == rows[0, 0])[0][0])
            rows = np.vstack([np.roll(piece.ids, -shift, axis=1)[:-1], rows])
            here = piece.first
        grids += _cut(rows, annuli[k].feet)
    return grids


def _cut(rows: Int[np.ndarray, "r n"], feet: tuple[int, ...]) -> list[np.ndarray]:
    """Grids of a band between consecutive cut columns: its feet, or equal parts where there are fewer than two."""
    n = rows.shape[1]
    if len(feet) < 2:
        parts = 2 if feet else 4
        feet = tuple((feet[0] if feet else 0) + n * p // parts for p in range(parts))
    cuts = sorted(f % n for f in feet)
    return [rows[:, np.arange(a, b + 1) % n].T for a, b in zip(cuts, [*cuts[1:], cuts[0] + n], strict=True)]
