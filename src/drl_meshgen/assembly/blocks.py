"""Bands of stacked rings, cut into structured blocks along dividing lines."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int


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


def blocks(annuli: list[Annulus]) -> list[Int[np.ndarray, "ni1 nj1"]]:
    """Stack rings that share a curve into bands and cut each band along the dividing lines of its first ring.

    A band starts at a cell and runs through tubes to a cap, the boundary or the next cell; caps and tubes that no cell
    reaches start bands of their own.
    """
    at: dict[int, list[int]] = {}
    for k, ring in enumerate(annuli):
        for c in sorted({ring.first, ring.last} - {-1}):
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
        grids += [grid for part in _unrolled(rows) for grid in _cut(part, annuli[k].feet)]
    return grids


def _unrolled(rows: Int[np.ndarray, "r n"]) -> list[np.ndarray]:
    """Halves of a band that a handle closes on itself, else the band: no block may touch itself."""
    middle = len(rows) // 2
    return [rows[: middle + 1], rows[middle:]] if np.isin(rows[0], rows[-1]).any() else [rows]


def _cut(rows: Int[np.ndarray, "r n"], feet: tuple[int, ...]) -> list[np.ndarray]:
    """Grids of a band between consecutive cut columns: its feet, or equal parts where there are fewer than two."""
    n = rows.shape[1]
    if len(feet) < 2:
        parts = 2 if feet else 4
        feet = tuple((feet[0] if feet else 0) + n * p // parts for p in range(parts))
    cuts = sorted(f % n for f in feet)
    return [rows[:, np.arange(a, b + 1) % n].T for a, b in zip(cuts, [*cuts[1:], cuts[0] + n], strict=True)]
