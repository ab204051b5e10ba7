"""Pieces of the decomposition: junctions with their cells, tubes and caps, each with a chart."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.decompose.cells import Ring, ring_between, submesh
from drl_meshgen.decompose.junction import Junction
from drl_meshgen.decompose.opening import open_junction
from drl_meshgen.decompose.strips import Strip
from drl_meshgen.decompose.zones import Zone
from drl_meshgen.errors import StageError
from drl_meshgen.lift.harmonic import disk_chart
from drl_meshgen.mesh import TriMesh
from drl_meshgen.partition import Partition, RegionKind


class PieceOutcome(Enum):
    """Verdicts of the decomposition of regions."""

    NO_RINGS = "the spine of a junction does not leave one ring per loop"
    NOT_A_RING = "a tube is not a ring between two curves"


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
    """Everything the counts and the fill need to know about the regions.

    `seams` are pairs of curves that are one on the surface, the first of which stands for both.
    """

    junctions: tuple[Junction, ...]
    tubes: tuple[Tube, ...]
    caps: tuple[Cap, ...]
    seams: tuple[tuple[int, int], ...] = ()

    def shared(self, n_curves: int) -> Int[np.ndarray, " c"]:
        """Curve whose nodes each of `n_curves` curves has: its own, or those of the other side of its seam."""
        of = np.arange(n_curves)
        for first, second in self.seams:
            of[second] = first
        return of

    @property
    def rings(self) -> tuple[Ring, ...]:
        """Rings of all cells, junction after junction, then those of the tubes: the order used everywhere."""
        return (*(cell.ring for junction in self.junctions for cell in junction.cells), *(t.ring for t in self.tubes))

    @property
    def strips(self) -> tuple[Strip, ...]:
        """Strips of all junctions, junction after junction."""
        return tuple(strip for junction in self.junctions for strip in junction.strips)


@dataclass(frozen=True, eq=False)
class Candidates:
    """All regions charted, with every way to open each junction, the most promising first."""

    junctions: tuple[tuple[Junction, ...], ...]
    tubes: tuple[Tube, ...]
    caps: tuple[Cap, ...]
    seams: tuple[tuple[int, int], ...]

    def pieces(self, chosen: Sequence[int]) -> Pieces:
        """Pieces with the `chosen` candidate of each junction."""
        junctions = tuple(ways[k] for ways, k in zip(self.junctions, chosen, strict=True))
        return Pieces(junctions, self.tubes, self.caps, self.seams)


def candidates(
    partition: Partition, exponents: tuple[float, ...], *, strips: bool, zones: tuple[Zone, ...] = ()
) -> Candidates:
    """Chart every region.

    Every junction is opened once for each of `exponents` (see `nearest_distance`), and by `strips` where they are
    wanted and fit (see `open_junction`).

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
                raise StageError("decompose", PieceOutcome.NOT_A_RING, f"region {r}", where=mesh.vertices)
            tubes.append(Tube((first, second), ring))
        else:
            curves = {c: partition.curves[c] for c in region.loops}
            ways = open_junction(mesh, ids, curves, exponents, strips=strips, zones=zones)
            if not ways:
                detail = f"region {r} with {len(region.loops)} loops"
                raise StageError("decompose", PieceOutcome.NO_RINGS, detail, where=mesh.vertices)
            junctions.append(ways)
    return Candidates(tuple(junctions), tuple(tubes), tuple(caps), partition.seams)


def pieces(partition: Partition, exponents: tuple[float, ...], *, strips: bool, zones: tuple[Zone, ...] = ()) -> Pieces:
    """Chart every region, each junction opened in its most promising way (see `candidates`)."""
    found = candidates(partition, exponents, strips=strips, zones=zones)
    return found.pieces([0] * len(found.junctions))


def _cap(curve: int, mesh: TriMesh, ids: np.ndarray) -> Cap:
    loop = mesh.topology.loops[0]
    p = mesh.vertices[loop]
    step = np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1)
    share = np.r_[0.0, np.cumsum(step[:-1])] / step.sum()
    return Cap(curve, mesh, ids, loop, share, disk_chart(mesh, loop, 2 * np.pi * share))
