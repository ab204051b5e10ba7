"""The decomposition stage: pieces with charts, node counts and rows for a wanted number of quads."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from drl_meshgen.decompose.cells import Ring
from drl_meshgen.decompose.counts import CountProblem, solve_counts
from drl_meshgen.decompose.pieces import Pieces, pieces
from drl_meshgen.partition import Partition


@dataclass(frozen=True)
class DecomposeOptions:
    """Size of the mesh and how junctions are opened."""

    target_quads: int = 4000
    """Wanted number of quads (count); ignored where `target_edge` is given."""
    target_edge: float = 0.0
    """Wanted edge length (model units); 0 derives it from `target_quads`."""
    exponents: tuple[float, ...] = (0.0, 1.0)
    """Powers of a loop's length that its distance is divided by, one candidate spine each (see `nearest_distance`)."""
    least_columns: int = 2
    """Fewest quads along a spine edge (count)."""
    least_rows: int = 2
    """Fewest quads between a spine and a loop (count)."""
    least_cap: int = 8
    """Fewest nodes around a cap (count, even)."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Pieces with counts: quads along each spine edge (per junction), around each curve, across each cell and tube."""

    pieces: Pieces
    edge_counts: tuple[Int[np.ndarray, " e"], ...]
    curve_counts: Int[np.ndarray, " c"]
    cell_rows: tuple[Int[np.ndarray, " l"], ...]
    tube_rows: Int[np.ndarray, " t"]
    spacing: float


def decompose(partition: Partition, options: DecomposeOptions | None = None) -> Layout:
    """Open every junction along its spine and find node counts. Raises `StageError` (see `pieces`, `solve_counts`)."""
    options = options or DecomposeOptions()
    return with_counts(partition, pieces(partition, options.exponents), options)


def with_counts(partition: Partition, parts: Pieces, options: DecomposeOptions) -> Layout:
    """Find counts for `parts`: the spacing is corrected until the predicted number of quads is as wanted."""
    area = partition.surface.mesh.area
    spacing = options.target_edge or float(np.sqrt(area / options.target_quads))
    layout = _counted(partition, parts, options, spacing)
    if options.target_edge:
        return layout
    for _ in range(3):
        predicted = predicted_quads(layout)
        if abs(predicted / options.target_quads - 1) < 0.03:
            break
        spacing *= float(np.sqrt(predicted / options.target_quads))
        layout = _counted(partition, parts, options, spacing)
    return layout


def predicted_quads(layout: Layout) -> float:
    """Quads of cells and tubes, and those of the caps from their area."""
    total = 0.0
    for junction, rows in zip(layout.pieces.junctions, layout.cell_rows, strict=True):
        total += float((layout.curve_counts[list(junction.curves)] * rows).sum())
    for tube, rows in zip(layout.pieces.tubes, layout.tube_rows, strict=True):
        total += float(layout.curve_counts[tube.curves[0]] * rows)
    for cap in layout.pieces.caps:
        length = np.linalg.norm(np.diff(cap.mesh.vertices[np.r_[cap.loop, cap.loop[0]]], axis=0), axis=1).sum()
        total += cap.mesh.area * (layout.curve_counts[cap.curve] / length) ** 2
    return total


def _counted(partition: Partition, parts: Pieces, options: DecomposeOptions, spacing: float) -> Layout:
    lengths = [junction.lengths for junction in parts.junctions]
    start = np.cumsum([0, *(len(x) for x in lengths)])
    n_edges, n_curves = int(start[-1]), len(partition.curves)
    girth, weight = _girths(partition, parts)
    target = np.maximum(np.r_[np.concatenate([*lengths, np.empty(0)]), girth] / spacing, 0.5)
    least = np.r_[np.full(n_edges, options.least_columns), np.full(n_curves, 4)]
    sums = []
    for j, junction in enumerate(parts.junctions):
        for curve, cell in zip(junction.curves, junction.cells, strict=True):
            sums.append((n_edges + curve, tuple(int(start[j]) + e for e, _ in cell.sides)))
    for cap in parts.caps:
        least[n_edges + cap.curve] = options.least_cap
    problem = CountProblem(
        target,
        np.r_[target[:n_edges], weight / spacing],
        least,
        tuple(sums),
        tuple((n_edges + a, n_edges + b) for a, b in (tube.curves for tube in parts.tubes)),
        tuple(n_edges + cap.curve for cap in parts.caps),
    )
    counts = solve_counts(problem)
    around = counts[n_edges:]

    def rows(n: int, ring: Ring, least_rows: int) -> int:
        """Rows of square cells, meeting those of the wanted spacing half way (geometric mean)."""
        square = n * ring.chart.modulus
        height = np.sqrt(ring.mesh.area * ring.chart.modulus)
        return max(least_rows, round(float(np.sqrt(square * height / spacing))))

    return Layout(
        parts,
        tuple(counts[start[j] : start[j + 1]] for j in range(len(parts.junctions))),
        around,
        tuple(
            np.array(
                [
                    rows(around[c], cell.ring, options.least_rows)
                    for c, cell in zip(junction.curves, junction.cells, strict=True)
                ]
            )
            for junction in parts.junctions
        ),
        np.array([rows(around[t.curves[0]], t.ring, 1) for t in parts.tubes], np.int64),
        spacing,
    )


def _girths(partition: Partition, parts: Pieces) -> tuple[np.ndarray, np.ndarray]:
    """Wanted length of each curve's nodes: its own, and the mean girth of the tubes at it, weighted by area."""
    points = partition.surface.mesh.vertices
    own = np.array([curve.arc_length(points)[1] for curve in partition.curves])
    weighted, weight = own * own, own.copy()
    for tube in parts.tubes:
        area = tube.ring.mesh.area
        girth = np.sqrt(area / tube.ring.chart.modulus)
        for c in tube.curves:
            weighted[c] += girth * area / girth
            weight[c] += area / girth
    return weighted / weight, weight
