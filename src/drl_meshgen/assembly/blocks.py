"""Bands of stacked rings, cut into structured blocks along dividing lines or along all lines of the base complex."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Int

from drl_meshgen.mesh import BlockMesh
from drl_meshgen.quality.base_complex import separatrix_edges


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
    (Only bands with fewer than two such lines are cut in equal parts, so that no block touches itself.)
    """
    closed = [band.ids[:, np.arange(band.ids.shape[1] + 1) % band.ids.shape[1]].T for band in bands]
    mesh = BlockMesh(np.zeros((n_nodes, 3)), (*patches, *closed)).mesh
    ends = mesh.topology.edges[separatrix_edges(mesh)]
    cut = np.sort(ends[:, 0] * np.int64(n_nodes) + ends[:, 1])

    def lines(one: np.ndarray, two: np.ndarray) -> list[int]:
        low, high = np.minimum(one, two), np.maximum(one, two)
        return np.nonzero(np.isin(low * np.int64(n_nodes) + high, cut))[0].tolist()

    grids = []
    for grid in patches:
        i, j = lines(grid[1:-1, 0], grid[1:-1, 1]), lines(grid[0, 1:-1], grid[1, 1:-1])
        across, along = ([0, *(k + 1 for k in cuts), size - 1] for cuts, size in zip((i, j), grid.shape, strict=True))
        grids += [grid[a : b + 1, c : d + 1] for a, b in pairwise(across) for c, d in pairwise(along)]
    for band in bands:
        rows = [0, *(k + 1 for k in lines(band.ids[1:-1, 0], band.ids[1:-1, 1])), len(band.ids) - 1]
        columns = tuple(lines(band.ids[0], band.ids[1]))
        grids += [grid for a, b in pairwise(rows) for grid in _cut(band.ids[a : b + 1], columns)]
    return grids


def _cut(rows: Int[np.ndarray, "r n"], feet: tuple[int, ...]) -> list[np.ndarray]:
    """Grids of a band between consecutive cut columns, or equal parts where there are fewer than two of them."""
    n = rows.shape[1]
    if len(feet) < 2:
        parts = 2 if feet else 4
        feet = tuple((feet[0] if feet else 0) + n * p // parts for p in range(parts))
    cuts = sorted(f % n for f in feet)
    return [rows[:, np.arange(a, b + 1) % n].T for a, b in zip(cuts, [*cuts[1:], cuts[0] + n], strict=True)]
