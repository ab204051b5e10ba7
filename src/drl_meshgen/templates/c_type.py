r"""C-type transition (paper Fig. 7b): nine blocks that take a four-sided patch from a long side to a short one.

::

    TL - q0 - t0 ----- n ----- t1 - q1 - TR    above
    |         |                |         |
    W ------- F0 ------------- F1 ------ E     F0, F1 five-valent
    |        /  \     core    /  \       |
    |       /    B0 -------- B1   \      |     B0, B1 trivalent
    |      /     |           |     \     |     below
    BL q0 f0  p  f1    n    f2  p  f3 q1 BR

The bottom has q0 + p + n + p + q1 cells, the top q0 + n + q1, left and right `below + above`. The columns that enter
between f0 and f1 turn through the core, whose sides F-B have p cells, and leave between f2 and f3: an even difference
2p of counts is absorbed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.errors import InputError
from drl_meshgen.mesh.topology import Topology
from drl_meshgen.mesh.trimesh import frozen
from drl_meshgen.templates.curves import offsets, sample
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.mesh import TemplateMesh, grid_quads
from drl_meshgen.templates.tfi import arc_fractions, transfinite
from drl_meshgen.templates.tutte import tutte

NAME = "C-type template"

#: Vertices on the boundary in its order, from the bottom left corner anti-clockwise.
RIM: Final = ("BL", "f0", "f1", "f2", "f3", "BR", "E", "TR", "t1", "t0", "TL", "W")
SINGULAR: Final = ("F0", "F1", "B0", "B1")
#: Internal edges 0-11 with the parameter that counts their cells.
EDGES: Final = (
    ("F0", "F1", "n"),
    ("B0", "B1", "n"),
    ("B0", "F0", "p"),
    ("B1", "F1", "p"),
    ("f0", "F0", "below"),
    ("f1", "B0", "below"),
    ("f2", "B1", "below"),
    ("f3", "F1", "below"),
    ("F0", "t0", "above"),
    ("F1", "t1", "above"),
    ("W", "F0", "q0"),
    ("F1", "E", "q1"),
)
#: Ends of the internal edges: 0-11 are vertices of the rim, 12-15 the singular points.
ENDS: Final[np.ndarray] = np.array([[(RIM + SINGULAR).index(name) for name in edge[:2]] for edge in EDGES])
#: Blocks 0-8 by their corners: `i` runs from the first to the second, `j` from the first to the last.
BLOCKS: Final = (
    ("B0", "B1", "F1", "F0"),
    ("BL", "f0", "F0", "W"),
    ("f0", "f1", "B0", "F0"),
    ("f1", "f2", "B1", "B0"),
    ("f2", "f3", "F1", "B1"),
    ("f3", "BR", "E", "F1"),
    ("W", "F0", "t0", "TL"),
    ("F0", "F1", "t1", "t0"),
    ("F1", "E", "TR", "t1"),
)
#: The parameters that count the cells of each block along `i` and `j`.
BLOCK_CELLS: Final = (
    ("n", "p"),
    ("q0", "below"),
    ("p", "below"),
    ("n", "below"),
    ("p", "below"),
    ("q1", "below"),
    ("q0", "above"),
    ("n", "above"),
    ("q1", "above"),
)


class CSides(NamedTuple):
    """Cells of the sides of a domain that a C-type mesh fills."""

    bottom: int
    side: int
    """Cells of the left and of the right side, at least 2."""
    top: int
    """At least 3, and fewer than at the bottom by an even number."""

    def checked(self) -> "CSides":
        """Return the sides; raises `InputError` where no C-type mesh fits them."""
        bottom, side, top = self
        if bottom <= top or (bottom - top) % 2:
            raise InputError(NAME, f"bottom and top have {bottom} and {top} cells", "need an even, positive difference")
        if top < 3 or side < 2:
            raise InputError(NAME, f"top and side have {top} and {side} cells", "at least 3 and 2 are needed")
        return self


@dataclass(frozen=True)
class CCounts:
    """Numbers of cells of a C-type transition, each at least 1."""

    q0: int
    """Columns left of the transition."""
    p: int
    """Columns absorbed on each side of the middle."""
    n: int
    """Columns through the middle."""
    q1: int
    """Columns right of the transition."""
    below: int
    """Rows between the bottom and the singular points."""
    above: int
    """Rows between the five-valent points and the top."""

    def __post_init__(self) -> None:
        if min(self.q0, self.p, self.n, self.q1, self.below, self.above) < 1:
            raise InputError(NAME, f"{self}", "every count must be positive")

    @classmethod
    def between(cls, sides: CSides) -> "CCounts":
        """Return balanced counts: the middle takes about a third of the top, the singular points lie half-way up.

        Raises `InputError` for sides that no C-type mesh fits.
        """
        bottom, side, top = sides.checked()
        n = max(1, round(top / 3))
        q0 = (top - n) // 2
        return cls(q0, (bottom - top) // 2, n, top - n - q0, side // 2, side - side // 2)

    @property
    def sides(self) -> CSides:
        """Cells of the four sides."""
        top = self.q0 + self.n + self.q1
        return CSides(top + 2 * self.p, self.below + self.above, top)

    @property
    def boundary(self) -> int:
        """Boundary nodes."""
        return self.sides.bottom + self.sides.top + 2 * self.sides.side

    @property
    def rim(self) -> Int[np.ndarray, "12"]:
        """Boundary node of each vertex of `RIM`, counted from the bottom left corner."""
        q0, p, n, q1, low, up = self.q0, self.p, self.n, self.q1, self.below, self.above
        return np.concatenate([[0], np.cumsum([q0, p, n, p, q1, low, up, q1, n, q0, up])])


@dataclass(frozen=True, eq=False)
class CParameters:
    """Everything that fixes a C-type mesh of a domain."""

    start: int
    """Boundary node of the bottom left corner."""
    counts: CCounts
    """Cells of each part; `counts.boundary = L`."""
    singular: Float[np.ndarray, "4 2"]
    """Positions of F0, F1 (five-valent), B0, B1 (trivalent)."""
    bulges: Float[np.ndarray, "12 2"]
    """Quadratic and cubic amplitude of each internal edge as fractions of its chord; see `curves.LINE_TYPES`."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "singular", frozen(self.singular, np.float64))
        object.__setattr__(self, "bulges", frozen(self.bulges, np.float64))


@dataclass(frozen=True, eq=False)
class Layout:
    """Node ids along every side of every block, in both directions, and the grids."""

    path: dict[tuple[str, str], np.ndarray]
    grids: tuple[Int[np.ndarray, "ni1 nj1"], ...]
    size: int


def layout(start: int, counts: CCounts) -> Layout:
    """Return node ids: boundary, singular points, interiors of internal edges 0-11, interiors of blocks 0-8."""
    boundary = counts.boundary
    rim = np.append(counts.rim, boundary)
    node = dict(zip(RIM, (start + rim[:-1]) % boundary, strict=True))
    node |= {name: boundary + i for i, name in enumerate(SINGULAR)}
    path = {}
    for i, name in enumerate(RIM):
        path[name, RIM[(i + 1) % len(RIM)]] = (start + np.arange(rim[i], rim[i + 1] + 1)) % boundary
    size = boundary + len(SINGULAR)
    for a, b, kind in EDGES:
        inner = getattr(counts, kind) - 1
        path[a, b] = np.concatenate([[node[a]], size + np.arange(inner), [node[b]]])
        size += inner
    path |= {(b, a): ids[::-1] for (a, b), ids in path.items()}
    grids = []
    for a, b, c, d in BLOCKS:
        bottom, top, left, right = path[a, b], path[d, c], path[a, d], path[b, c]
        grid = np.empty((len(bottom), len(left)), np.int64)
        grid[:, 0], grid[:, -1], grid[0], grid[-1] = bottom, top, left, right
        inner = np.array(grid.shape) - 2
        grid[1:-1, 1:-1] = size + np.arange(inner.prod()).reshape(inner)
        size += int(inner.prod())
        grids.append(grid)
    return Layout(path, tuple(grids), size)


def rim_parts(nodes: Float[np.ndarray, "l 2"], start: int, counts: CCounts) -> tuple[np.ndarray, ...]:
    """Return the fractions of arc length of the boundary nodes along each of the 12 parts of the rim."""
    rim = start + np.append(counts.rim, counts.boundary)
    return tuple(arc_fractions(nodes[np.arange(a, b + 1) % len(nodes)]) for a, b in pairwise(rim))


def vertices(
    nodes: Float[np.ndarray, "l d"], singular: Float[np.ndarray, "4 d"], start: int, counts: CCounts
) -> np.ndarray:
    """Return the vertices of the rim, then the singular points, (16, d); `ENDS` counts in this order."""
    return np.concatenate([nodes[(start + counts.rim) % len(nodes)], singular])


def positions(
    boundary: Float[np.ndarray, "l d"],
    singular: Float[np.ndarray, "4 d"],
    offset: Float[np.ndarray, "12 s d"],
    plan: Layout,
    fractions: Sequence[np.ndarray],
) -> Float[np.ndarray, "p d"]:
    """Return all nodes; linear in boundary, singular points and displacements of the internal edges (`curves.offsets`).

    `fractions` divide the 12 parts of the rim, in any dimension `d`.
    """
    points = np.empty((plan.size, boundary.shape[1]))
    points[: len(boundary)] = boundary
    points[len(boundary) : len(boundary) + 4] = singular
    share = {(name, RIM[(i + 1) % len(RIM)]): fractions[i] for i, name in enumerate(RIM)}
    for (a, b, _), moved in zip(EDGES, offset, strict=True):
        ids = plan.path[a, b]
        share[a, b] = t = np.linspace(0, 1, len(ids))
        points[ids] = sample(points[ids[0]], points[ids[-1]], moved, t)
    share |= {(b, a): 1 - t[::-1] for (a, b), t in share.items()}
    for (a, b, c, d), grid in zip(BLOCKS, plan.grids, strict=True):
        sides = (a, b), (d, c), (a, d), (b, c)
        bottom, top, left, right = (share[s] for s in sides)
        points[grid] = transfinite(*(points[plan.path[s]] for s in sides), fractions=(bottom, top, left, right))
    return points


def instantiate_c(domain: Domain, parameters: CParameters) -> TemplateMesh:
    """Return the C-type mesh: 9 blocks, 12 internal edges, two trivalent and two five-valent interior nodes.

    Raises `InputError` if the counts do not add up to the domain's boundary nodes.
    """
    start, c = parameters.start, parameters.counts
    if c.boundary != len(domain):
        raise InputError(NAME, f"the counts need {c.boundary} boundary nodes but the domain has {len(domain)}")
    plan = layout(start, c)
    tail, head = vertices(domain.nodes, parameters.singular, start, c)[ENDS.T]
    moved = offsets(tail, head, parameters.bulges)
    points = positions(domain.nodes, parameters.singular, moved, plan, rim_parts(domain.nodes, start, c))
    return TemplateMesh(points, plan.grids)


def rule_c(domain: Domain, start: int, counts: CCounts) -> CParameters:
    """Return straight internal edges with the singular points where Tutte's embedding of the mesh puts them."""
    plan = layout(start, counts)
    quads = grid_quads(plan.grids)
    placed = tutte(domain.nodes, Topology(plan.size, quads).edges, plan.size)
    return CParameters(start, counts, placed[len(domain) : len(domain) + 4], np.zeros((len(EDGES), 2)))
