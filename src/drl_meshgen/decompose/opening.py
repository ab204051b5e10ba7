"""Ways to open a junction, and the choice between them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.decompose.cells import Cell, cells
from drl_meshgen.decompose.junction import Junction, Rim
from drl_meshgen.decompose.spine import loop_distances, nearest_distance, spine
from drl_meshgen.decompose.strips import WIDTHS, arc_length, open_strips, strip_graph
from drl_meshgen.decompose.trial import trial_score
from drl_meshgen.decompose.zones import Zone, attracted, misfit, repelled
from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.curves import closed_length
from drl_meshgen.partition import Curve
from drl_meshgen.partition.cutting import midpoint_refined

#: A junction of fewer triangles is refined before it is opened; any is, as long as its spine runs into a loop.
FINE = 10_000
MOST_REFINEMENTS = 3

#: Strips are out of the question above this distortion: columns crowd more than the node optimiser can mend.
MOST_DISTORTION = 0.35

#: Strips bring more irregular nodes and blocks than a spine, so their trial score has to be better by this.
STRIP_MARGIN = 0.005


def open_junction(
    mesh: TriMesh,
    origin: Int[np.ndarray, " v"],
    curves: Mapping[int, Curve],
    exponents: tuple[float, ...],
    *,
    strips: bool,
    zones: tuple[Zone, ...] = (),
) -> tuple[Junction, ...]:
    """Open a region between `curves` (by id) in every way wanted, the most promising first; empty when none works.

    Where `zones` are in reach, there are spines that regard them, and how well they are met comes before quality.

    There is a spine for each of `exponents` (see `nearest_distance`), and strips where they are wanted and fit (see
    `strip_graph`). `origin` are the ids of the region's vertices on the cut surface.
    """
    coarse = len(mesh.triangles) < FINE
    for refinement in range(coarse, MOST_REFINEMENTS + 1):
        mesh = midpoint_refined(mesh) if refinement else mesh
        region = _Region.of(mesh, origin, curves)
        spines = region.by_spines(exponents, zones)
        if spines:
            found = [*spines, *(region.by_strips() if strips else [])]
            misses = [misfit(one.points[one.spine.nodes], mesh.vertices, zones) for one in found]
            return ranked([one for one, miss in zip(found, misses, strict=True) if miss == min(misses)])
    return ()


def ranked(candidates: list[Junction]) -> tuple[Junction, ...]:
    """Sort by promise: spines by distortion, before or after them the strips that are hardly distorted.

    Strips come first where they beat the first spine in a trial. Both rules come from optimising meshes either way for
    32 junctions of 19 models: wherever strips were more distorted than the limit, the worst angle ended worse; below
    it the trial nearly always told which is better.
    """
    spines = sorted((c for c in candidates if not c.strips), key=lambda junction: junction.distortion)
    if not spines:
        return tuple(candidates)
    strips = [c for c in candidates if c.strips and c.distortion <= MOST_DISTORTION]
    if not strips:
        return tuple(spines)
    first = max(map(trial_score, strips)) > trial_score(spines[0]) + STRIP_MARGIN
    return (*strips, *spines) if first else (spines[0], *strips, *spines[1:])


@dataclass(frozen=True, eq=False)
class _Region:
    """A refined junction; its vertices are `origin (v,)` on the cut surface, -1 those that refinement made.

    `loops` are its curves in the order of `ids`, with the mesh on their left; `distances` those to each loop.
    """

    mesh: TriMesh
    origin: Int[np.ndarray, " v"]
    ids: tuple[int, ...]
    curves: tuple[Curve, ...]
    loops: tuple[Int[np.ndarray, " n"], ...]
    distances: Float[np.ndarray, "v k"]

    @staticmethod
    def of(mesh: TriMesh, origin: Int[np.ndarray, " o"], curves: Mapping[int, Curve]) -> "_Region":
        """Find the loops of a refined `mesh` whose first vertices are `origin` on the cut surface."""
        known = np.full(len(mesh.vertices), -1)
        known[: len(origin)] = origin
        of_first = {int(known[loop[known[loop] >= 0][0]]): loop for loop in mesh.topology.loops}
        met = {c: set(curve.vertices.tolist()) for c, curve in curves.items()}
        loops = tuple(next(loop for first, loop in of_first.items() if first in met[c]) for c in curves)
        return _Region(mesh, known, tuple(curves), tuple(curves.values()), loops, loop_distances(mesh, loops))

    def by_spines(self, exponents: tuple[float, ...], zones: tuple[Zone, ...] = ()) -> list[Junction]:
        """Open along the spine of each exponent, and of each that regards `zones`, that leaves one ring per loop."""
        junctions, points = [], self.mesh.vertices
        plain = [nearest_distance(self.mesh, self.loops, self.distances, exponent) for exponent in exponents]
        drawn = (attracted(self.distances, points, zone) for zone in zones)
        plain += [nearest_distance(self.mesh, self.loops, one, 0.0) for one in drawn if one is not None]
        pushed = [repelled(distance, points, zones) for distance in plain] if zones else []
        for distance in (*plain, *(new for old, new in zip(plain, pushed, strict=False) if (new != old).any())):
            graph = spine(self.mesh, distance)
            found = cells(self.mesh, graph, self.loops)
            if found is not None:
                placed = tuple(self._placed(cell) for cell in found)
                junctions.append(Junction(self.mesh.vertices, graph, self.ids, placed))
        return junctions

    def by_strips(self) -> list[Junction]:
        """Open by the widest strips that fit, with the longest loop outside."""
        outer = int(np.argmax([closed_length(self.mesh.vertices[loop]) for loop in self.loops]))
        for width in WIDTHS:
            layout = strip_graph(self.mesh, self.loops, self.distances, outer, width)
            found = layout and open_strips(self.mesh, layout, self.loops, outer)
            if not layout or not found:
                continue
            cell, strips = found
            rims = tuple(
                Rim(self.ids[l], sides, self._places(l, [int(layout.graph.paths[e][0]) for e in sides]))
                for l, sides in enumerate(layout.rims)
                if sides
            )
            return [Junction(self.mesh.vertices, layout.graph, (self.ids[outer],), (self._placed(cell),), strips, rims)]
        return []

    def _placed(self, cell: Cell) -> Cell:
        """Return the cell with vertex ids of the cut surface."""
        return replace(cell, ring=replace(cell.ring, origin=self.origin[cell.ring.origin]))

    def _places(self, l: int, vertices: list[int]) -> Float[np.ndarray, " s"]:
        """Places on curve `l` of some of its vertices, in order around the loop (see `Rim.corners`)."""
        loop, curve = self.loops[l], self.curves[l].vertices
        along = arc_length(self.mesh, loop)
        index = {int(v): k for k, v in enumerate(curve)}
        met = [(k, index[int(v)]) for k, v in enumerate(self.origin[loop]) if v >= 0]
        forward = (met[1][1] - met[0][1]) % len(curve) < (met[0][1] - met[1][1]) % len(curve)
        zero = next(k for k, at in met if at == 0)
        position = {int(v): k for k, v in enumerate(loop)}
        steps = np.array([position[v] for v in vertices])
        share = (along[steps] - along[zero]) / along[-1] + np.r_[0, np.cumsum(np.diff(steps) < 0)]
        return share if forward else -share
