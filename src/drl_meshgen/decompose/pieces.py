"""Pieces of the decomposition: junctions with their cells, tubes and caps, each with a chart."""

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.decompose.cells import Cell, Ring, cells, ring_between, submesh
from drl_meshgen.decompose.spine import Spine, loop_distances, nearest_distance, spine
from drl_meshgen.errors import StageError
from drl_meshgen.lift.harmonic import disk_chart
from drl_meshgen.mesh import TriMesh
from drl_meshgen.partition import Partition, RegionKind
from drl_meshgen.partition.cutting import midpoint_refined

#: A junction is refined once before it is opened, and again where its spine still runs into a loop.
MOST_REFINEMENTS = 3


class PieceOutcome(Enum):
    """Verdicts of the decomposition of regions."""

    NO_RINGS = "the spine of a junction does not leave one ring per loop"
    NOT_A_RING = "a tube is not a ring between two curves"


@dataclass(frozen=True, eq=False)
class Junction:
    """A region with three or more loops: its spine and one cell per loop (`curves` are the ids of the loops).

    `points` are the vertices that the spine's paths refer to.
    """

    points: Float[np.ndarray, "v 3"]
    spine: Spine
    curves: tuple[int, ...]
    cells: tuple[Cell, ...]

    @property
    def lengths(self) -> Float[np.ndarray, " e"]:
        """Length of each spine edge (model units)."""
        steps = [np.linalg.norm(np.diff(self.points[path], axis=0), axis=1) for path in self.spine.paths]
        return np.array([step.sum() for step in steps])

    @property
    def distortion(self) -> float:
        """Largest over the cells of the relative entropy between shares of length and of theta along the spine.

        0 when theta runs evenly along the outer loop; large when much of the spine sits in a pocket of its cell, where
        the columns of a chart crowd.
        """
        lengths = self.lengths
        worst = 0.0
        for cell in self.cells:
            share = lengths[[edge for edge, _ in cell.sides]]
            share = share / share.sum()
            worst = max(worst, float((share * np.log(share / np.maximum(cell.theta_shares, 1e-9))).sum()))
        return worst


@dataclass(frozen=True, eq=False)
class Tube:
    """A ring between two curves; its chart has h = 0 on `curves[0]`."""

    curves: tuple[int, int]
    ring: Ring


@dataclass(frozen=True, eq=False)
class Cap:
    """A disk inside one curve, with its harmonic map to the unit disk.

    `loop` are the vertices of `mesh` on the curve, the cap on their left; `share` their place along it, from 0 to 1.
    `plane` maps the loop to angles `2 pi share`.
    """

    curve: int
    mesh: TriMesh
    origin: Int[np.ndarray, " v"]
    loop: Int[np.ndarray, " n"]
    share: Float[np.ndarray, " n"]
    plane: Float[np.ndarray, "v 2"]


@dataclass(frozen=True, eq=False)
class Pieces:
    """Everything the counts and the fill need to know about the regions."""

    junctions: tuple[Junction, ...]
    tubes: tuple[Tube, ...]
    caps: tuple[Cap, ...]

    @property
    def rings(self) -> tuple[Ring, ...]:
        """Rings of all cells, junction after junction, then those of the tubes: the order used everywhere."""
        return (*(cell.ring for junction in self.junctions for cell in junction.cells), *(t.ring for t in self.tubes))


def pieces(partition: Partition, exponents: tuple[float, ...]) -> Pieces:
    """Chart every region.

    Every junction is opened once for each of `exponents` (see `nearest_distance`); the candidate whose worst cell is
    least distorted stays.

    Raises `StageError` when a region does not have the shape that its kind promises.
    """
    junctions, tubes, caps = [], [], []
    for r, region in enumerate(partition.regions):
        mesh, ids = submesh(partition.surface.mesh, np.nonzero(partition.region == r)[0])
        if region.kind is RegionKind.CAP:
            caps.append(_cap(region.loops[0], mesh, ids))
        elif region.kind is RegionKind.TUBE:
            first, second = region.loops
            ring = ring_between(mesh, ids, partition.curves[first].vertices)
            if ring is None:
                raise StageError("decompose", PieceOutcome.NOT_A_RING, f"region {r}")
            tubes.append(Tube((first, second), ring))
        else:
            junction = _junction(partition, mesh, ids, region.loops, exponents)
            if junction is None:
                raise StageError("decompose", PieceOutcome.NO_RINGS, f"region {r} with {len(region.loops)} loops")
            junctions.append(junction)
    return Pieces(tuple(junctions), tuple(tubes), tuple(caps))


def _cap(curve: int, mesh: TriMesh, ids: np.ndarray) -> Cap:
    loop = mesh.topology.loops[0]
    p = mesh.vertices[loop]
    step = np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1)
    share = np.r_[0.0, np.cumsum(step[:-1])] / step.sum()
    return Cap(curve, mesh, ids, loop, share, disk_chart(mesh, loop, 2 * np.pi * share))


def _junction(
    partition: Partition, mesh: TriMesh, ids: np.ndarray, curves: tuple[int, ...], exponents: tuple[float, ...]
) -> Junction | None:
    on_curve = {c: set(partition.curves[c].vertices.tolist()) for c in curves}
    fine = mesh
    for _ in range(MOST_REFINEMENTS):
        fine = midpoint_refined(fine)
        loops = tuple(
            next(loop for loop in fine.topology.loops if int(_old(loop, ids)[0]) in on_curve[c]) for c in curves
        )
        distances = loop_distances(fine, loops)
        known = np.full(len(fine.vertices), -1)
        known[: len(ids)] = ids
        candidates = []
        for exponent in exponents:
            graph = spine(fine, nearest_distance(fine, loops, distances, exponent))
            found = cells(fine, graph, loops)
            if found is not None:
                placed = tuple(replace(cell, ring=replace(cell.ring, origin=known[cell.ring.origin])) for cell in found)
                candidates.append(Junction(fine.vertices, graph, curves, placed))
        if candidates:
            return min(candidates, key=lambda junction: junction.distortion)
    return None


def _old(loop: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Ids of the vertices of a refined loop that were there before the refinement."""
    return ids[loop[loop < len(ids)]]
