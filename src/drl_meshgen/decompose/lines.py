"""The base complex of a layout, counted before any node has a place.

Mesh lines of rings are columns. Through caps, spine edges and strips one column goes on as another, which is integer
arithmetic over the counts; lines that begin in an irregular node cut the mesh into the patches of the base complex.
"""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from math import inf

from drl_meshgen.decompose.pieces import Pieces


@dataclass(frozen=True)
class End:
    """Where a junction meets a band. `sides` are graph edges as (edge, forward) in the order of its columns.

    Column 0 starts the first side; columns run with the junction on their left. Edges are numbered through all
    junctions. At a rim the band ends at the curve, else at the graph.
    """

    curve: int
    sides: tuple[tuple[int, bool], ...]
    is_rim: bool


@dataclass(frozen=True)
class Band:
    """Curves that share their columns: from end `ends[0]` through tubes to end `ends[1]`, a cap or the boundary.

    `cap` is the cap at the far end or -1. Bands without ends reach no junction; bands without rows are mere curves.
    """

    curves: tuple[int, ...]
    ends: tuple[int, ...]
    cap: int
    has_rows: bool


@dataclass(frozen=True)
class Turning:
    """How the columns of bands and caps meet.

    `shifts[b]`: column `j` of the first end of band `b` is column `shifts[b] - j` of its second. `corners[k]`: the
    corners of cap `k` lie at the columns `o`, `o + m`, `o + n / 2` and `o + m + n / 2` of the end of its band, as
    `(o, m)`. Both are meaningless where a band has no such end.
    """

    shifts: tuple[int, ...]
    corners: tuple[tuple[int, int], ...]


#: A piece at a graph edge: an end or, as `-1 - s`, strip `s`; which of its sides that is; whether it runs forward.
_Use = tuple[int, int, bool]


@dataclass(frozen=True, eq=False)
class Lines:
    """Bands, their ends and the strips of all junctions, and how they hang together.

    `uses[e]` are both pieces at edge `e`; `place[k]` is the band of end `k` and which of its ends that is; `shared[c]`
    is the curve whose nodes curve `c` has (see `Pieces.shared`).
    """

    ends: tuple[End, ...]
    strips: tuple[tuple[int, int, int, int], ...]
    bands: tuple[Band, ...]
    uses: tuple[tuple[_Use, _Use], ...]
    place: tuple[tuple[int, int], ...]
    shared: tuple[int, ...]

    @staticmethod
    def of(pieces: Pieces, n_curves: int) -> "Lines":
        """Collect them from the pieces."""
        ends: list[End] = []
        strips: list[tuple[int, int, int, int]] = []
        at = 0
        for junction in pieces.junctions:
            for c, cell in zip(junction.curves, junction.cells, strict=True):
                ends.append(End(c, tuple((at + e, forward) for e, forward in cell.sides), is_rim=False))
            ends += [End(rim.curve, tuple((at + e, True) for e in rim.sides), is_rim=True) for rim in junction.rims]
            for strip in junction.strips:
                a, b, c, d = strip.sides
                strips.append((at + a, at + b, at + c, at + d))
            at += len(junction.spine.paths)
        uses: list[list[_Use]] = [[] for _ in range(at)]
        for k, end in enumerate(ends):
            for p, (e, forward) in enumerate(end.sides):
                uses[e].append((k, p, forward))
        for s, sides in enumerate(strips):
            for p, e in enumerate(sides):
                uses[e].append((-1 - s, p, True))
        bands = _bands(pieces, ends, n_curves)
        place = {k: (b, which) for b, band in enumerate(bands) for which, k in enumerate(band.ends)}
        return Lines(
            tuple(ends),
            tuple(strips),
            bands,
            tuple((first, second) for first, second in uses),
            tuple(place[k] for k in range(len(ends))),
            tuple(pieces.shared(n_curves).tolist()),
        )

    def passed(self, pieces: Pieces, band: int) -> list[tuple[int, int]]:
        """Return the tubes that a band passes from its first end on, each with which of its two curves comes first."""
        here = self.shared[self.ends[self.bands[band].ends[0]].curve]
        left = [t for t, tube in enumerate(pieces.tubes) if tube.curves[0] in self.bands[band].curves]
        path = []
        while left:
            ends = {t: [self.shared[c] for c in pieces.tubes[t].curves] for t in left}
            t = next(t for t in left if here in ends[t])
            near = ends[t].index(here)
            path.append((t, near))
            here = ends[t][1 - near]
            left.remove(t)
        return path

    def across(self, edge: int, piece: int, side: int) -> _Use:
        """Return the piece beyond an edge of `piece`, which is its `side`."""
        one, two = self.uses[edge]
        return two if one[0] == piece and one[1] == side else one

    @cached_property
    def crossings(self) -> list[list[_Use]]:
        """What is beyond each side of each end, and whether it counts columns the same way."""
        found = []
        for k, end in enumerate(self.ends):
            beyond = [(self.across(edge, k, p), forward) for p, (edge, forward) in enumerate(end.sides)]
            found.append([(piece, side, ahead == forward) for (piece, side, ahead), forward in beyond])
        return found

    def feet(self, counts: Sequence[int]) -> list[list[int]]:
        """Columns at which the sides of every end begin, and last its number of columns."""
        return [list(accumulate([counts[e] for e, _ in end.sides], initial=0)) for end in self.ends]

    def patches(
        self, counts: Sequence[int], turning: Turning, *, feet: list[list[int]] | None = None, limit: float = inf
    ) -> int:
        """Return the number of patches of the base complex. `counts` are those of all graph edges, `feet` theirs.

        Bands that reach no junction count as one patch per cap and four around. Above `limit` the count breaks off and
        is a lower bound.
        """
        return _Trace(self, counts, turning, feet or self.feet(counts), limit).patches()


def united(count: int, pairs: Iterable[tuple[int, int]]) -> list[tuple[int, ...]]:
    """Return the classes of `0 .. count - 1` joined in `pairs`, each ascending, in the order of their first members."""
    group = list(range(count))
    for a, b in pairs:
        first, second = sorted((group[a], group[b]))
        group = [first if g == second else g for g in group]
    return [tuple(k for k in range(count) if group[k] == g) for g in sorted(set(group))]


def _bands(pieces: Pieces, ends: list[End], n_curves: int) -> tuple[Band, ...]:
    bands = []
    for curves in united(n_curves, [*(tube.curves for tube in pieces.tubes), *pieces.seams]):
        own = tuple(k for k, end in enumerate(ends) if end.curve in curves)
        cap = next((k for k, cap in enumerate(pieces.caps) if cap.curve in curves), -1)
        cells = any(not ends[k].is_rim for k in own)
        tubes = any(tube.curves[0] in curves for tube in pieces.tubes)
        bands.append(Band(curves, own, cap, cells or tubes or cap >= 0))
    return tuple(bands)


class _Trace:
    """Follows lines from all irregular nodes until they end in another, at the boundary or in a line already there."""

    def __init__(
        self, lines: Lines, counts: Sequence[int], turning: Turning, feet: list[list[int]], limit: float
    ) -> None:
        self.lines, self.counts, self.turning, self.feet = lines, counts, turning, feet
        self.left = limit - len(turning.corners) - len(lines.strips)  # each is a patch, each line in it one more
        self.columns: list[set[int]] = [set() for _ in lines.bands]
        self.cores: list[tuple[set[int], set[int]]] = [(set(), set()) for _ in turning.corners]
        self.strips: list[tuple[set[int], set[int]]] = [(set(), set()) for _ in lines.strips]

    def patches(self) -> int:
        lines = self.lines
        for k, (b, which) in enumerate(lines.place):
            for j in self.feet[k][:-1]:
                self._follow(b, self._turned(b, j) if which else j, which)
        for b, band in enumerate(lines.bands):
            if band.cap >= 0 and band.ends:
                (first, m), n = self.turning.corners[band.cap], self.feet[band.ends[0]][-1]
                for step in (0, m, n // 2, n // 2 + m):
                    self._follow(b, (first + step) % n, 1)
        bands = [(b, band) for b, band in enumerate(lines.bands) if band.has_rows]
        around = sum(len(self.columns[b]) if band.ends else 4 for b, band in bands)
        return around + sum((len(one) + 1) * (len(two) + 1) for one, two in (*self.cores, *self.strips))

    def _turned(self, band: int, column: int) -> int:
        """Column of one end of a band as one of the other."""
        return (self.turning.shifts[band] - column) % self.feet[self.lines.bands[band].ends[0]][-1]

    def _follow(self, b: int, i: int, leaving: int) -> None:
        """Follow column `i` of band `b` (as its first end counts) away from its end `leaving`."""
        feet, columns, place, crossings = self.feet, self.columns, self.lines.place, self.lines.crossings
        while i not in columns[b] and self.left >= 0:
            columns[b].add(i)
            self.left -= 1
            band = self.lines.bands[b]
            if leaving:
                k, j = band.ends[0], i
            elif len(band.ends) == 2:
                k, j = band.ends[1], self._turned(b, i)
            else:
                i, leaving = self._through_cap(band, i) if band.cap >= 0 else -1, 1
                if i < 0:
                    return
                continue
            p = bisect_right(feet[k], j) - 1
            far, side, same = crossings[k][p]
            if feet[k][p] == j:
                return  # an irregular node
            if far >= 0:
                j = feet[far][side] + (j - feet[k][p] if same else feet[k][p + 1] - j)
            else:
                far, j = self._through_strips(k, p, j)
                if far < 0:
                    return
            b, leaving = place[far]
            i = self._turned(b, j) if leaving else j

    def _through_cap(self, band: Band, i: int) -> int:
        """Column where a line comes out of a core again; -1 at a corner."""
        (first, m), n = self.turning.corners[band.cap], self.feet[band.ends[0]][-1]
        r, half = (i - first) % n, n // 2
        if r in (0, m, half, half + m):
            return -1
        across, along = self.cores[band.cap]
        self.left -= 1
        if r % half < m:  # sides 0 and 2 face each other, so do 1 and 3
            across.add(r if r < half else n - half + m - r)
            r = half + m - r
        else:
            along.add(r if r < half else n + m - r)
            r = n + m - r
        return (first + r) % n

    def _through_strips(self, k: int, p: int, j: int) -> tuple[int, int]:
        """End and column where a line comes out of the strips that it enters at column `j` of end `k`, on side `p`.

        End -1 where it meets a line that is already there.
        """
        feet = self.feet[k]
        edge, forward = self.lines.ends[k].sides[p]
        count = self.counts[edge]
        t = j - feet[p] if forward else feet[p + 1] - j
        k, p, forward = self.lines.across(edge, k, p)
        while k < 0:
            met, at = self.strips[-1 - k][p % 2], t if p < 2 else count - t
            if at in met:
                return -1, 0
            met.add(at)
            self.left -= 1
            t, p = count - t, (p + 2) % 4
            k, p, forward = self.lines.across(self.lines.strips[-1 - k][p], k, p)
        return k, self.feet[k][p] + (t if forward else count - t)
