"""Wanted edge lengths on a surface: a factor on the global spacing from curvature, absolute ones from the user."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.curves import closed_length
from drl_meshgen.sizing.curvature import largest_curvature

#: Curvature is averaged over this share of the square root of the surface's area.
BLUR = 0.01


@dataclass(frozen=True)
class SizeOptions:
    """Where quads are smaller or larger than elsewhere."""

    curvature: float = 0.0
    """How far sizes follow the radius of curvature R: as R^(curvature / 2), so 1 levels the chord error; 0: not."""
    finest: float = 0.4
    """Least size that curvature asks for, as a factor on that at median curvature."""
    coarsest: float = 1.5
    """Largest size that curvature allows, as a factor on that at median curvature."""
    gradation: float = 0.3
    """Most that the size grows per length along the surface (ratio)."""
    around: float = 8.0
    """Edges that are to fit around boundary loops and seams, however short (count); 0: does not matter."""
    between: float = 1.5
    """Edges that are to fit between two boundary loops or seams, however near (count); 0: does not matter."""
    regions: tuple[tuple[float, float, float, float, float], ...] = ()
    """Balls with an edge length of their own: x, y, z of the centre, radius, edge length (model units)."""

    def __post_init__(self) -> None:
        if not 0 <= self.curvature <= 1:
            raise ValueError("curvature lies between 0 and 1")
        if not 0 < self.finest <= 1 <= self.coarsest:
            raise ValueError("finest lies between 0 and 1, coarsest above 1")
        if self.gradation <= 0:
            raise ValueError("gradation is positive")
        if any(radius <= 0 or size <= 0 for *_, radius, size in self.regions):
            raise ValueError("radius and edge length of a region are positive")


@dataclass(frozen=True, eq=False)
class Sizes:
    """Wanted edge length `size` at `points` of a surface; elsewhere that of the nearest of them."""

    points: Float[np.ndarray, "v 3"]
    size: Float[np.ndarray, " v"]

    @staticmethod
    def of(surface: TriMesh, size: float) -> "Sizes":
        """Return one size for a whole surface."""
        return Sizes(surface.vertices, np.full(len(surface.vertices), size))

    @property
    def uniform(self) -> bool:
        """Whether one size is wanted everywhere."""
        return bool(np.all(self.size == self.size[0]))

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.points)

    def at(self, points: Float[np.ndarray, "*k 3"]) -> Float[np.ndarray, "*k"]:
        """Return the wanted edge length at any points on or near the surface."""
        if self.uniform:
            return np.full(points.shape[:-1], self.size[0])
        return self.size[self._tree.query(points)[1]]

    def length(self, path: Float[np.ndarray, "k 3"]) -> float:
        """Return the integral of ds / size along a polygon: edges of the wanted length that fit in."""
        density = 1 / self.at(path)
        return float((np.linalg.norm(np.diff(path, axis=0), axis=1) * (density[1:] + density[:-1]) / 2).sum())

    def area(self, mesh: TriMesh) -> float:
        """Return the integral of dA / size^2: quads of the wanted size that fit in."""
        density = 1 / self.at(mesh.vertices) ** 2
        return float(mesh.areas @ density[mesh.triangles].mean(axis=1))


@dataclass(frozen=True, eq=False)
class SizeField:
    """What sizes are asked for on a surface, before the global spacing is known.

    `factor (v,)` multiplies the spacing; `wanted (v,)` is an edge length in its place (model units; NaN: none);
    `most (v,)` is the longest that either may be (model units; infinity: no matter).
    """

    surface: TriMesh
    factor: Float[np.ndarray, " v"]
    wanted: Float[np.ndarray, " v"]
    most: Float[np.ndarray, " v"]
    gradation: float

    @staticmethod
    def uniform(surface: TriMesh) -> "SizeField":
        """Return the field that asks for one size everywhere."""
        n = len(surface.vertices)
        return SizeField(surface, np.ones(n), np.full(n, np.nan), np.full(n, np.inf), SizeOptions.gradation)

    @property
    def fixed(self) -> bool:
        """Whether the user said everywhere how long edges should be: then there is no spacing to choose."""
        return not np.isnan(self.wanted).any()

    @cached_property
    def _graph(self) -> coo_matrix:
        """Growth of the size along each edge, and one more node from which sizes spread."""
        e, n = self.surface.topology.edges, len(self.factor)
        growth = self.gradation * self.surface.edge_lengths
        return coo_matrix((np.maximum(growth, np.finfo(float).tiny), (e[:, 0], e[:, 1])), (n + 1, n + 1))

    def at(self, spacing: float) -> Sizes:
        """Return the sizes at a global `spacing`.

        They grow at most by `gradation` per length along the edges of the surface: the smaller size wins, and
        `h(v) = min over w of h(w) + gradation |vw|`.
        """
        size = np.minimum(np.where(np.isnan(self.wanted), spacing * self.factor, self.wanted), self.most)
        if np.ptp(size) > 0:
            graph, n = self._graph, len(size)
            start = coo_matrix((size, (np.full(n, n), np.arange(n))), graph.shape)
            size = dijkstra((graph + graph.T + start).tocsr(), indices=n)[:n]
        return Sizes(self.surface.vertices, size)


def size_field(
    surface: TriMesh,
    options: SizeOptions | None = None,
    given: Float[np.ndarray, " v"] | None = None,
    loops: Sequence[Float[np.ndarray, "n 3"]] = (),
) -> SizeField:
    """Put together what options and the array `given` (edge lengths, model units; NaN, 0 or less: none) ask for.

    The regions of the options count more than the array, later regions more than earlier ones. `loops` are closed
    curves on the surface around which `options.around` edges are to fit, and `options.between` between them.
    """
    options = options or SizeOptions()
    factor = np.ones(len(surface.vertices))
    if options.curvature:
        curvature = largest_curvature(surface, BLUR * float(np.sqrt(surface.area)))
        middle = weighted_median(curvature, vertex_areas(surface))
        bend = np.maximum(curvature / max(middle, np.finfo(float).tiny), np.finfo(float).tiny)
        factor = np.clip(bend ** (-options.curvature / 2), options.finest, options.coarsest)
    wanted = np.full(len(factor), np.nan) if given is None else np.where(given > 0, given, np.nan)
    for *centre, radius, size in options.regions:
        wanted[np.linalg.norm(surface.vertices - np.array(centre), axis=1) <= radius] = size
    most = np.full(len(factor), np.inf)
    near = KDTree(surface.vertices)
    on = [np.atleast_1d(near.query(loop)[1]) for loop in loops]
    if options.around:
        for loop, vertices in zip(loops, on, strict=True):
            np.minimum.at(most, vertices, closed_length(loop) / options.around)
    if options.between and len(loops) > 1:
        most = np.minimum(most, gaps(surface, on) / options.between)
    return SizeField(surface, factor, wanted, most, options.gradation)


def gaps(surface: TriMesh, sets: Sequence[Int[np.ndarray, " n"]]) -> Float[np.ndarray, " v"]:
    """Return how far apart two of the `sets` of vertices are, where a shortest way between them starts, turns and ends.

    Lengths are those of ways along edges (model units), infinity elsewhere. Where the vertices nearest to one set meet
    those nearest to another, each edge between them closes a way from the one to the other.
    """
    owner = np.full(len(surface.vertices), -1)
    for k, vertices in reversed(list(enumerate(sets))):
        owner[vertices] = k
    edges, n = surface.topology.edges, len(owner)
    graph = coo_matrix((np.maximum(surface.edge_lengths, np.finfo(float).tiny), edges.T), (n, n)).tocsr()
    starts = np.flatnonzero(owner >= 0)
    far, _, source = dijkstra(graph, directed=False, indices=starts, min_only=True, return_predecessors=True)
    meet = edges[(source[edges] >= 0).all(axis=1) & (owner[source[edges[:, 0]]] != owner[source[edges[:, 1]]])]
    gap = np.full(n, np.inf)
    way = far[meet].sum(axis=1) + np.linalg.norm(np.diff(surface.vertices[meet], axis=1)[:, 0], axis=1)
    for ends in (meet, source[meet]):
        np.minimum.at(gap, ends, way[:, None])
    return gap


def vertex_areas(surface: TriMesh) -> Float[np.ndarray, " v"]:
    """Return a third of the area of the triangles around each vertex."""
    return np.bincount(surface.triangles.ravel(), np.repeat(surface.areas / 3, 3), len(surface.vertices))


def weighted_median(values: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"]) -> float:
    """Return the least value with at least half of the weight at or below it."""
    order: Int[np.ndarray, " n"] = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(total, total[-1] / 2)]])
