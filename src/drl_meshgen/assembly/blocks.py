"""Bands of stacked rings, cut into structured blocks along dividing lines or along all lines of the base complex."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Int

from drl_meshgen.mesh import BlockMesh
from drl_meshgen.mesh.topology import graph_components
from drl_meshgen.quality.base_complex import separatrix_edges, straight_pairs


@dataclass(frozen=True, eq=False)
class Annulus:
    """Node ids `(rows + 1, n)` from curve `first` to curve `last` (-1: a spine or a core).

    Columns run so that (column, row) is right-handed on the surface. `feet` are the columns of dividing lines.
    """

    ids: Int[np.ndarray, "r n"]
    first: int
    last: int
    feet: tuple[int, ...] = ()
    is_cell: bool = False

    def flipped(self) -> "Annulus":
        """Return the same ring seen from its other end; column 0 stays."""
        n = self.ids.shape[1]
        ids = np.roll(self.ids[::-1, ::-1], 1, axis=1)
        return Annulus(ids, self.last, self.first, tuple((n - f) % n for f in self.feet), self.is_cell)


@dataclass(frozen=True, eq=False)
class Band:
    """Node ids `(rows + 1, n)` of stacked rings, and the columns of the dividing lines of the first of them."""

    ids: Int[np.ndarray, "r n"]
    feet: tuple[int, ...]


def bands(annuli: list[Annulus], *, through: bool) -> list[Band]:
    """Stack rings that share a curve.

    A band starts at a cell and runs through tubes to a cap, the boundary or the next cell, which `through` adds to it;
    caps and tubes that no cell reaches start bands of their own.
    """
    at: dict[int, list[int]] = {}
    for k, ring in enumerate(annuli):
        for c in sorted({ring.first, ring.last} - {-1}):
            at.setdefault(c, []).append(k)
    used: set[int] = set()
    found = []
    starts = [k for k, ring in enumerate(annuli) if ring.last == -1] + list(range(len(annuli)))
    for k in starts:
        if k in used:
            continue
        used.add(k)
        rows, here = annuli[k].ids, annuli[k].first
        while here >= 0:
            ahead = [q for q in at[here] if q not in used and (through or not annuli[q].is_cell)]
            if not ahead:
                break
            used.add(ahead[0])
            piece = annuli[ahead[0]] if annuli[ahead[0]].last == here else annuli[ahead[0]].flipped()
            shift = int(np.nonzero(piece.ids[-1] == rows[0, 0])[0][0])
            rows = np.vstack([np.roll(piece.ids, -shift, axis=1)[:-1], rows])
            here = piece.first
        found += [Band(part, annuli[k].feet) for part in _unrolled(rows)]
    return found


def _unrolled(rows: Int[np.ndarray, "r n"]) -> list[np.ndarray]:
    """Halves of a band that a handle closes on itself, else the band: no block may touch itself."""
    middle = len(rows) // 2
    return [rows[: middle + 1], rows[middle:]] if np.isin(rows[0], rows[-1]).any() else [rows]


def along_feet(bands: list[Band]) -> list[Int[np.ndarray, "ni1 nj1"]]:
    """Cut every band along its dividing lines: few blocks, which meet in T-junctions."""
    return [grid for band in bands for grid in _cut(band.ids, band.feet)]


def along_separatrices(
    patches: list[Int[np.ndarray, "ni1 nj1"]], bands: list[Band], n_nodes: int
) -> list[Int[np.ndarray, "ni1 nj1"]]:
    """Cut four-sided patches and bands along all mesh lines that begin in an irregular node.

    The blocks are the patches of the base complex: each side of one is a whole side of another, or on the boundary.
    Where such a patch would touch itself, a whole mesh line more is cut along.
    """
    lines = _Lines(patches, bands, n_nodes)
    for band in bands:
        if not len(lines.cuts(band.ids[0], band.ids[1])):
            lines.cut(band.ids[0, 0], band.ids[1, 0])
    while True:
        grids = [part for grid in patches for part in _along_lines(grid, lines)]
        for band in bands:
            first = int(lines.cuts(band.ids[0], band.ids[1])[0])
            n = band.ids.shape[1]
            grids += _along_lines(band.ids[:, np.arange(first, first + n + 1) % n].T, lines)
        touching = [grid for grid in grids if len(np.unique(grid)) < grid.size]
        if not touching:
            return grids
        for grid in touching:
            lines.cut(*_middle(grid))


class _Lines:
    """Mesh lines of patches and bands; those of the base complex are cut along from the start."""

    def __init__(self, patches: list[Int[np.ndarray, "ni1 nj1"]], bands: list[Band], n_nodes: int) -> None:
        closed = [band.ids[:, np.arange(band.ids.shape[1] + 1) % band.ids.shape[1]].T for band in bands]
        mesh = BlockMesh(np.zeros((n_nodes, 3)), (*patches, *closed)).mesh
        edges = mesh.topology.edges
        self._n_nodes = np.int64(n_nodes)
        self._code = edges[:, 0] * self._n_nodes + edges[:, 1]
        self._line = graph_components(straight_pairs(mesh), len(edges))
        self._is_cut = separatrix_edges(mesh)

    def _edges(self, one: np.ndarray, two: np.ndarray) -> Int[np.ndarray, " k"]:
        return np.searchsorted(self._code, np.minimum(one, two) * self._n_nodes + np.maximum(one, two))

    def cuts(self, one: Int[np.ndarray, " k"], two: Int[np.ndarray, " k"]) -> Int[np.ndarray, " c"]:
        """Which of the edges from `one` to `two` are cut along."""
        return np.nonzero(self._is_cut[self._edges(one, two)])[0]

    def cut(self, one: int, two: int) -> None:
        """Cut along the whole line that the edge from `one` to `two` is on."""
        self._is_cut |= self._line == self._line[self._edges(np.array([one]), np.array([two]))]


def _along_lines(grid: Int[np.ndarray, "ni1 nj1"], lines: _Lines) -> list[np.ndarray]:
    i, j = lines.cuts(grid[1:-1, 0], grid[1:-1, 1]), lines.cuts(grid[0, 1:-1], grid[1, 1:-1])
    across, along = ([0, *(k + 1), size - 1] for k, size in zip((i, j), grid.shape, strict=True))
    return [grid[a : b + 1, c : d + 1] for a, b in pairwise(across) for c, d in pairwise(along)]


def _middle(grid: Int[np.ndarray, "ni1 nj1"]) -> tuple[int, int]:
    """Edge of a block in the middle between two places that are the same node, across the way from one to the other."""
    order = np.argsort(grid.ravel(), kind="stable")
    twice = np.nonzero(np.diff(grid.ravel()[order]) == 0)[0][0]
    (i, j), (k, l) = (divmod(int(order[twice + s]), grid.shape[1]) for s in (0, 1))
    if abs(i - k) >= 2:
        return int(grid[(i + k) // 2, 0]), int(grid[(i + k) // 2, 1])
    return int(grid[0, (j + l) // 2]), int(grid[1, (j + l) // 2])


def _cut(rows: Int[np.ndarray, "r n"], feet: tuple[int, ...]) -> list[np.ndarray]:
    """Grids of a band between consecutive cut columns, or equal parts where there are fewer than two of them."""
    n = rows.shape[1]
    if len(feet) < 2:
        parts = 2 if feet else 4
        feet = tuple((feet[0] if feet else 0) + n * p // parts for p in range(parts))
    cuts = sorted(f % n for f in feet)
    return [rows[:, np.arange(a, b + 1) % n].T for a, b in zip(cuts, [*cuts[1:], cuts[0] + n], strict=True)]
