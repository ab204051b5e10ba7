"""The decomposition stage: pieces with charts, node counts and rows for a wanted number of quads."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.decompose.conflicts import contradiction, numbered
from drl_meshgen.decompose.counts import CountProblem, solve_counts
from drl_meshgen.decompose.lines import Lines, Turning
from drl_meshgen.decompose.names import Names, name_parts
from drl_meshgen.decompose.pieces import Cap, Pieces, pieces
from drl_meshgen.decompose.turning import turned
from drl_meshgen.decompose.zones import Zone
from drl_meshgen.errors import InputError, StageError
from drl_meshgen.partition import Partition
from drl_meshgen.sizing import SizeField, Sizes

#: A tube whose height is less than this share of its girth has no room for a transition.
LEAST_MODULUS = 0.5

#: Most corrections of the spacing; where some sizes are given, each corrects only the rest.
MOST_CORRECTIONS = 10


@dataclass(frozen=True)
class DecomposeOptions:
    """Size of the mesh and how junctions are opened."""

    target_quads: int = 4000
    """Wanted number of quads (count); ignored where `target_edge` is given."""
    target_edge: float = 0.0
    """Wanted edge length (model units); 0 derives it from `target_quads`."""
    exponents: tuple[float, ...] = (0.0, 0.5, 1.0)
    """Powers of a loop's length that its distance is divided by, one candidate spine each (see `nearest_distance`)."""
    spine_weight: float = 1.0
    """How much the spacing along spine edges counts against that around limbs (ratio)."""
    transitions: bool = False
    """Whether tubes may lose an even number of columns in a C-type transition (4 more irregular nodes each)."""
    transition_cost: float = 4.0
    """What a transition must save in the count program to be worth it (in mean weights of a tube)."""
    strips: bool = True
    """Whether junctions are also opened by strips between their loops (see `strip_graph`)."""
    candidates: int = 3
    """Most ways to open each junction that are compared by optimising whole layouts, until one is as good as needed
    (count); 1 takes the most promising."""
    least_columns: int = 2
    """Fewest quads along a spine edge, or an edge of a strip (count)."""
    least_rows: int = 2
    """Fewest quads between a spine and a loop (count)."""
    least_cap: int = 8
    """Fewest nodes around a cap (count, even)."""
    zones: tuple[Zone, ...] = ()
    """Balls and boxes where irregular nodes are wanted or forbidden, tables of `kind`, `centre`, `radius` or `half`
    (model units); spines of junctions regard them, caps do not."""
    fixed: tuple[tuple[str, int], ...] = ()
    """Counts of named edges and rows of named rings that are given (see `layout.toml`), as a table of names."""
    former: tuple[tuple[str, int], ...] = ()
    """All counts and rows of a layout, as a table of names: what is not fixed stays as close to them as it can."""
    block_weight: float = 0.5
    """What a block of the base complex may cost in distorted counts and twist (in quad edges); 0 turns nothing."""
    turnings: int = 1
    """Searches for the turning of limbs with the fewest blocks, of which the best counts (count)."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Pieces with counts: quads along each graph edge (per junction), around each curve, across each cell and tube."""

    pieces: Pieces
    edge_counts: tuple[Int[np.ndarray, " e"], ...]
    curve_counts: Int[np.ndarray, " c"]
    cell_rows: tuple[Int[np.ndarray, " l"], ...]
    tube_rows: Int[np.ndarray, " t"]
    spacing: float
    turning: Turning | None = None
    """How bands and caps are turned; None leaves that to their charts."""


def decompose(partition: Partition, options: DecomposeOptions | None = None, field: SizeField | None = None) -> Layout:
    """Open every junction along its spine and find node counts for sizes that follow `field` (uniform if None).

    Raises `StageError` (see `pieces`, `solve_counts`).
    """
    options = options or DecomposeOptions()
    return with_counts(
        partition, pieces(partition, options.exponents, strips=options.strips, zones=options.zones), options, field
    )


def with_counts(
    partition: Partition, parts: Pieces, options: DecomposeOptions, field: SizeField | None = None
) -> Layout:
    """Find counts for `parts`, all lengths and areas being measured in wanted sizes.

    Without `target_edge` or former counts the spacing is corrected until the relaxed counts give the wanted number of
    quads, then the integer program is solved, and once more where rounding took it off by more than 3 %. Where the
    field says everywhere how long edges are, there is nothing to correct.

    Raises `InputError` where fixed counts contradict and `StageError` where there are no counts.
    """
    surface = partition.surface.mesh
    field = field or SizeField.uniform(surface)

    def sizing(spacing: float) -> Sizing:
        return Sizing(partition, parts, options, field.at(spacing), spacing)

    spacing = options.target_edge or float(np.sqrt(surface.area / options.target_quads))
    if field.fixed:
        spacing = float(np.sqrt(surface.area / field.at(spacing).area(surface)))
    if field.fixed or options.target_edge or options.former:
        return sizing(spacing).layout()
    for _ in range(MOST_CORRECTIONS):
        one = sizing(spacing)
        ratio = one.quads(one.relaxed) / options.target_quads
        spacing *= float(np.sqrt(ratio))
        if abs(ratio - 1) < 0.01:
            break
    one = sizing(spacing)
    ratio = predicted_quads(one.layout(turn=False), field.at(spacing)) / options.target_quads
    return (one if abs(ratio - 1) <= 0.03 else sizing(spacing * float(np.sqrt(ratio)))).layout()


def predicted_blocks(layout: Layout) -> int:
    """Return the number of patches of the base complex of a turned layout, without making a mesh.

    Raises `InputError` for a layout that nobody turned.
    """
    if layout.turning is None:
        raise InputError("layout", "no turning", "blocks follow from the charts: set decompose.block_weight above 0")
    lines = Lines.of(layout.pieces, len(layout.curve_counts))
    return lines.patches(np.concatenate([*layout.edge_counts, np.empty(0)]).astype(int).tolist(), layout.turning)


def predicted_quads(layout: Layout, sizes: Sizes | None = None) -> float:
    """Quads of cells, strips and tubes, and an estimate for the caps."""
    total = 0.0
    for junction, counts, rows in zip(layout.pieces.junctions, layout.edge_counts, layout.cell_rows, strict=True):
        total += float((layout.curve_counts[list(junction.curves)] * rows).sum())
        total += float(sum(counts[strip.sides[0]] * counts[strip.sides[1]] for strip in junction.strips))
    for tube, rows in zip(layout.pieces.tubes, layout.tube_rows, strict=True):
        total += float(layout.curve_counts[list(tube.curves)].mean() * rows)
    return total + sum(
        _cap_share(cap, sizes) * float(layout.curve_counts[cap.curve]) ** 2 for cap in layout.pieces.caps
    )


def _cap_share(cap: Cap, sizes: Sizes | None) -> float:
    """Quads of the O-type template over n^2: a core of (n / 4)^2, layers by the area over that of the flat disk.

    The line through what a flat disk and a hemisphere take.
    """
    sizes = sizes or Sizes.of(cap.mesh, 1.0)
    depth = 4 * np.pi * sizes.area(cap.mesh) / sizes.length(cap.mesh.vertices[np.r_[cap.loop, cap.loop[0]]]) ** 2
    return 1 / 16 + 0.049 + 0.020 * depth


class Sizing:
    """Targets of the count program and what follows from its solution, for `sizes` at one `spacing`.

    Counts are those of the graph edges, junction by junction, then those of the curves. Lengths are measured in sizes.
    """

    def __init__(
        self, partition: Partition, parts: Pieces, options: DecomposeOptions, sizes: Sizes, spacing: float
    ) -> None:
        self.partition, self.parts, self.options, self.spacing = partition, parts, options, spacing
        lengths = [
            np.array([sizes.length(junction.points[path]) for path in junction.spine.paths])
            for junction in parts.junctions
        ]
        self.start = np.cumsum([0, *(len(x) for x in lengths)])
        self.n_edges, n_curves = int(self.start[-1]), len(partition.curves)
        girth, weight = _girths(partition, parts, sizes)
        self.length = np.r_[np.concatenate([*lengths, np.empty(0)]), girth]
        self.weight = np.r_[options.spine_weight * self.length[: self.n_edges], weight]
        self.least = np.r_[np.full(self.n_edges, options.least_columns), np.full(n_curves, 4)]
        for cap in parts.caps:
            self.least[self.n_edges + cap.curve] = options.least_cap
        self.sums: list[tuple[int, tuple[int, ...]]] = []
        self.equal: list[tuple[int, int]] = [(self.n_edges + a, self.n_edges + b) for a, b in parts.seams]
        self.steps: list[tuple[int, int]] = []
        for tube in parts.tubes:
            ends = sorted(tube.curves, key=lambda c: -girth[c])
            pair = (self.n_edges + ends[0], self.n_edges + ends[1])
            # a transition takes a sector about as high as it is wide
            roomy = options.transitions and tube.ring.chart.modulus > LEAST_MODULUS
            (self.steps if roomy else self.equal).append(pair)
        self.strips: list[tuple[int, int]] = []
        for at, junction in zip(self.start.tolist(), parts.junctions, strict=False):
            around = [(c, [e for e, _ in cell.sides]) for c, cell in zip(junction.curves, junction.cells, strict=True)]
            around += [(rim.curve, list(rim.sides)) for rim in junction.rims]
            self.sums += [(self.n_edges + c, tuple(at + e for e in sides)) for c, sides in around]
            for strip in junction.strips:
                mouth, side, far, back = (at + e for e in strip.sides)
                self.equal += [(mouth, far), (side, back)]
                self.strips.append((mouth, side))
        cells = [
            (c, cell.ring)
            for junction in parts.junctions
            for c, cell in zip(junction.curves, junction.cells, strict=True)
        ]
        rings = [*(((c, c), ring) for c, ring in cells), *((tube.curves, tube.ring) for tube in parts.tubes)]
        self.ring_curves = np.array([c for c, _ in rings], np.int64).reshape(-1, 2)
        self.modulus = np.array([ring.chart.modulus for _, ring in rings])
        self.height = np.sqrt([sizes.area(ring.mesh) for _, ring in rings] * self.modulus)
        self.cap_shares = [_cap_share(cap, sizes) for cap in parts.caps]
        self.least_rows = np.r_[np.full(len(cells), options.least_rows), np.ones(len(parts.tubes), np.int64)]
        self.fixed, self.fixed_rows = self._given(options.fixed)
        self.former, self.former_rows = self._given(options.former)
        if options.former and len(self.former) + len(self.former_rows) < len(self.length) + len(rings):
            raise InputError("layout", "lacks edges or rings of this surface", "write it again with the layout command")

    def _given(self, given: tuple[tuple[str, int], ...]) -> tuple[tuple[tuple[int, int], ...], dict[int, int]]:
        """Split named values into (count, value) of edges and rows by ring."""
        if not given:
            return (), {}
        n = len(self.length)
        found = numbered((*self.names.edges, *self.names.rings), given)
        rows = {k - n: value for k, value in found if k >= n}
        for ring, value in rows.items():
            if value < self.least_rows[ring]:
                raise InputError("layout", f"{self.names.rings[ring]} = {value} is less than {self.least_rows[ring]}")
        return tuple((k, value) for k, value in found if k < n), rows

    @cached_property
    def names(self) -> Names:
        """Names of all counts and rows."""
        return name_parts(self.partition, self.parts)

    def problem(self) -> CountProblem:
        """Return the count program before former counts come in."""
        n = self.n_edges
        return CountProblem(
            np.maximum(self.length, 0.5),
            self.weight,
            self.least,
            tuple(self.sums),
            tuple(self.equal),
            tuple(n + cap.curve for cap in self.parts.caps),
            tuple(self.steps),
            self.options.transition_cost * float(np.mean(self.weight[n:])),
            self.fixed,
        )

    @cached_property
    def counts(self) -> Int[np.ndarray, " n"]:
        """Counts nearest to the wanted lengths or, where there are any, to the former counts.

        Raises `InputError` where fixed counts contradict, `StageError` where there are none.
        """
        return self._solved(integral=True).astype(np.int64)

    @property
    def relaxed(self) -> Float[np.ndarray, " n"]:
        """The same without rounding."""
        return self._solved(integral=False)

    def _solved(self, *, integral: bool) -> Float[np.ndarray, " n"]:
        problem = self.problem()
        if self.former:
            former = np.array([value for _, value in sorted(self.former)], float)
            problem = replace(problem, target=former, weight=former, hold=1.0)
        try:
            return solve_counts(problem, integral=integral)
        except StageError as error:
            raise contradiction(problem, self.names.edges) or error from None

    def rows(self, counts: np.ndarray) -> Float[np.ndarray, " r"]:
        """Rows of each ring: between those of square cells and those of the wanted spacing (geometric mean)."""
        square = self._around(counts) * self.modulus
        return np.maximum(self.least_rows, np.sqrt(square * self.height))

    def quads(self, counts: np.ndarray) -> float:
        """Return the number of quads that counts lead to, an estimate for the caps."""
        around = counts[self.n_edges :]
        caps = sum(s * float(around[cap.curve]) ** 2 for cap, s in zip(self.parts.caps, self.cap_shares, strict=True))
        strips = sum(float(counts[mouth] * counts[side]) for mouth, side in self.strips)
        return float((self._around(counts) * self.rows(counts)).sum()) + strips + caps

    def _around(self, counts: np.ndarray) -> Float[np.ndarray, " r"]:
        """Mean number of columns of each ring."""
        return counts[self.n_edges + self.ring_curves].mean(axis=1)

    def layout(self, *, turn: bool = True) -> Layout:
        """Solve the counts and the rows; with `turn` also turn bands and caps (see `turned`)."""
        counts, turning, more = self.counts, None, 1.0
        if turn and self.options.block_weight > 0 and not self.options.transitions:
            problem = self.problem()
            if self.former:
                problem = replace(problem, fixed=tuple(enumerate(counts.tolist())))
            wanted = self.quads(counts)
            counts, turning = turned(
                self.partition, self.parts, problem, counts, self.options.block_weight, searches=self.options.turnings
            )
            more = self.quads(counts) / wanted
        rows = np.round(self.rows(counts) / more).astype(np.int64).clip(min=self.least_rows)
        for ring, value in (self.former_rows | self.fixed_rows).items():
            rows[ring] = value
        split = np.cumsum([0, *(len(junction.cells) for junction in self.parts.junctions)])
        return Layout(
            self.parts,
            tuple(counts[a:b] for a, b in pairwise(self.start)),
            counts[self.n_edges :],
            tuple(rows[a:b] for a, b in pairwise(split)),
            rows[split[-1] :],
            self.spacing,
            turning,
        )


def _girths(partition: Partition, parts: Pieces, sizes: Sizes) -> tuple[np.ndarray, np.ndarray]:
    """Wanted nodes of each curve: those on its own length and on the mean girth of the tubes at it, by area."""
    points = partition.surface.mesh.vertices
    own = np.array([sizes.length(points[np.r_[c.vertices, c.vertices[0]]]) for c in partition.curves])
    weighted, weight = own * own, own.copy()
    for tube in parts.tubes:
        area = sizes.area(tube.ring.mesh)
        girth = np.sqrt(area / tube.ring.chart.modulus)
        for c in tube.curves:
            weighted[c] += area
            weight[c] += area / girth
    return weighted / weight, weight
