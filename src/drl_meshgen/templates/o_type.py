"""O-type template (paper Fig. 7a): a core block of m x n cells and four outer blocks of k layers.

Corners are the boundary nodes `i0`, `i0 + m`, `i0 + m + n`, `i0 + 2m + n` (mod L); side `s` runs from corner `s` to
corner `s + 1` and has m, n, m, n cells. Singular point `s` belongs to corner `s`. Internal edges 0-3 are the spokes
from corner to singular point, 4-7 the sides of the core from singular point `s` to `s + 1`.

Ring 0 is the boundary, ring k the rim of the core; ring `r` holds the points `r L .. r L + L - 1`, point `r L + i`
facing boundary node `i`; the interior of the core follows, `j` fastest.
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.errors import InputError
from drl_meshgen.mesh.trimesh import frozen
from drl_meshgen.templates.curves import SWELLS, WAVES, graded, offsets, sample, sines
from drl_meshgen.templates.domain import Domain
from drl_meshgen.templates.mesh import TemplateMesh
from drl_meshgen.templates.tfi import arc_fractions, transfinite

EDGES = 8


@dataclass(frozen=True, eq=False)
class OParameters:
    """Everything that fixes an O-type mesh of a domain; 2m + 2n = L."""

    i0: int
    """Boundary node of the first corner."""
    m: int
    """Cells of sides 0 and 2."""
    n: int
    """Cells of sides 1 and 3."""
    layers: int
    """Radial cells of the outer blocks, k >= 1."""
    singular: Float[np.ndarray, "4 2"]
    """Positions of the four trivalent nodes."""
    bulges: Float[np.ndarray, "8 2"]
    """Quadratic and cubic amplitude of each internal edge as fractions of its chord; see `curves.LINE_TYPES`."""
    grading: float = 1.0
    """Ratio of the thickness of each layer to that of the layer outside it."""
    waves: Float[np.ndarray, "8 2 2"] = field(default_factory=lambda: np.zeros((EDGES, WAVES, 2)))
    """Displacement of each internal edge by its sines, in the units of the domain; see `curves.shapes`."""
    swells: Float[np.ndarray, "4 3 2"] = field(default_factory=lambda: np.zeros((4, SWELLS, 2)))
    """Displacement of the middle of each outer block by sines along its side, in the units of the domain."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "singular", frozen(self.singular, np.float64))
        object.__setattr__(self, "bulges", frozen(self.bulges, np.float64))
        object.__setattr__(self, "waves", frozen(self.waves, np.float64))
        object.__setattr__(self, "swells", frozen(self.swells, np.float64))
        if min(self.m, self.n, self.layers) < 1:
            raise InputError("O-type template", f"m, n, k = {self.m}, {self.n}, {self.layers}", "each must be positive")

    @property
    def corners(self) -> Int[np.ndarray, "4"]:
        """Boundary nodes of the four corners."""
        m, n = self.m, self.n
        return (self.i0 + np.array([0, m, m + n, 2 * m + n])) % (2 * m + 2 * n)


def grids(i0: int, m: int, n: int, k: int) -> tuple[Int[np.ndarray, "ni1 nj1"], ...]:
    """Return the node grids: the core, then outer blocks 0-3 with `i` along the boundary and `j` inwards."""
    boundary = 2 * (m + n)
    start = np.cumsum([0, m, n, m])
    rings = np.arange(k + 1) * boundary
    outer = [
        ((i0 + s + np.arange(count + 1)) % boundary)[:, None] + rings
        for s, count in zip(start, (m, n, m, n), strict=True)
    ]
    core = np.empty((m + 1, n + 1), np.int64)
    core[:, 0], core[m] = outer[0][:, k], outer[1][:, k]
    core[:, n], core[0] = outer[2][::-1, k], outer[3][::-1, k]
    core[1:m, 1:n] = boundary * (k + 1) + np.arange((m - 1) * (n - 1)).reshape(m - 1, n - 1)
    return core, *outer


def rim_fractions(nodes: Float[np.ndarray, "l 2"], i0: int, m: int, n: int) -> tuple[np.ndarray, ...]:
    """Return the length fractions at which the boundary nodes divide sides 0-3, each in its own direction."""
    loop = np.roll(nodes, -i0, axis=0)
    loop = np.concatenate([loop, loop[:1]])
    start = np.cumsum([0, m, n, m, n])
    return tuple(arc_fractions(loop[a : b + 1]) for a, b in pairwise(start))


def positions(
    boundary: Float[np.ndarray, "l d"],
    singular: Float[np.ndarray, "4 d"],
    offset: Float[np.ndarray, "8 s d"],
    *,
    corners: tuple[int, int, int],
    radial: Float[np.ndarray, " k1"],
    fractions: tuple[np.ndarray, ...],
    swells: Float[np.ndarray, "4 w d"] | None = None,
) -> Float[np.ndarray, "p d"]:
    """Return all points of the mesh; linear in all but `corners`, `radial` and `fractions`.

    `corners` is `(i0, m, n)`, `radial` the fractions of the spokes, `fractions` those of `rim_fractions`. A side of the
    core is divided at the mean of the fractions of the two boundary sides that face it.
    """
    i0, m, n = corners
    k, size = len(radial) - 1, 2 * (m + n)
    points = np.empty((size * (k + 1) + (m - 1) * (n - 1), boundary.shape[1]))
    points[:size] = boundary
    core, *outer = grids(i0, m, n, k)
    spokes = [sample(boundary[outer[s][0, 0]], singular[s], offset[s], radial) for s in range(4)]
    across = (fractions[0] + 1 - fractions[2][::-1]) / 2, (fractions[1] + 1 - fractions[3][::-1]) / 2
    divided = across[0], across[1], 1 - across[0][::-1], 1 - across[1][::-1]
    for s in range(4):
        rim, ahead = outer[s][:, 0], (s + 1) % 4
        side = sample(singular[s], singular[ahead], offset[4 + s], divided[s])
        share = fractions[s], divided[s], radial, radial
        points[outer[s]] = transfinite(boundary[rim], side, spokes[s], spokes[ahead], share)
        if swells is not None:
            along, inwards = sines(np.linspace(0, 1, len(rim)), SWELLS), sines(np.linspace(0, 1, k + 1), 1)
            points[outer[s][1:-1, 1:-1]] += (along @ swells[s])[1:-1, None] * inwards[1:-1]
    share = across[0], across[0], across[1], across[1]
    rims = points[core[:, 0]], points[core[:, -1]], points[core[0]], points[core[-1]]
    points[core] = transfinite(*rims, share)
    return points


def instantiate(domain: Domain, parameters: OParameters) -> TemplateMesh:
    """Return the O-type mesh: 5 blocks, `L k + (m + 1)(n + 1)` points, `L k + m n` quads.

    Raises `InputError` if the corners do not divide the domain's boundary.
    """
    p = parameters
    if 2 * (p.m + p.n) != len(domain):
        raise InputError("O-type template", f"2m + 2n = {2 * (p.m + p.n)} but the boundary has {len(domain)} nodes")
    corner = domain.nodes[p.corners]
    start = np.concatenate([corner, p.singular])
    end = np.concatenate([p.singular, np.roll(p.singular, -1, axis=0)])
    points = positions(
        domain.nodes,
        p.singular,
        np.concatenate([offsets(start, end, p.bulges), p.waves], axis=1),
        corners=(p.i0, p.m, p.n),
        radial=graded(p.layers, p.grading),
        fractions=rim_fractions(domain.nodes, p.i0, p.m, p.n),
        swells=p.swells,
    )
    return TemplateMesh(points, grids(p.i0, p.m, p.n, p.layers))
