"""The partition stage: depth, join tree, contours, regions (paper section 4.3)."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int

from drl_meshgen.errors import StageError
from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.cutgraph import trace
from drl_meshgen.mesh.topology import Topology, graph_components
from drl_meshgen.partition.collars import with_collars
from drl_meshgen.partition.cutting import CutSurface, cut, superlevel
from drl_meshgen.partition.join_tree import join_tree
from drl_meshgen.partition.levels import Level, PartitionOptions, choose_levels, isovalue_table
from drl_meshgen.partition.necks import at_neck
from drl_meshgen.partition.thin import levelled
from drl_meshgen.seams import Seam


class Outcome(Enum):
    """Verdicts of the partition."""

    DONE = "the regions cover the surface"
    NO_BOUNDARY = "a component of the surface has no boundary, so the depth has no zero level there"
    BAD_REGION = "a region is not a disk, tube or junction with loops"


class RegionKind(Enum):
    """What the contours leave, by Euler characteristic and number of loops."""

    CAP = "cap"
    TUBE = "tube"
    JUNCTION = "junction"


@dataclass(frozen=True, eq=False)
class Curve:
    """A closed curve of vertices of the cut surface: a contour, a boundary loop or one side of a seam.

    `level` is its depth, NaN for contours of other functions (see `with_collars`, `at_neck`).
    """

    vertices: Int[np.ndarray, " n"]
    is_boundary: bool
    level: float

    def arc_length(self, points: Float[np.ndarray, "v 3"]) -> tuple[Float[np.ndarray, " n"], float]:
        """Position of each vertex along the curve as a share of its length, and the length (model units)."""
        p = points[self.vertices]
        step = np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1)
        total = float(step.sum())
        return np.r_[0.0, np.cumsum(step[:-1])] / total, total


@dataclass(frozen=True)
class Region:
    """A connected piece between curves; `loops` are curve ids in increasing order."""

    kind: RegionKind
    loops: tuple[int, ...]
    euler: int


@dataclass(frozen=True, eq=False)
class Partition:
    """Regions of the cut surface. `region (f,)` is the region of each triangle; curves are shared by neighbours.

    `seams` are pairs of curves that are one on the surface: vertex `k` of both is the same point.
    """

    surface: CutSurface
    curves: tuple[Curve, ...]
    region: Int[np.ndarray, " f"]
    regions: tuple[Region, ...]
    merges: pd.DataFrame
    isovalues: pd.DataFrame
    outcome: Outcome
    seams: tuple[tuple[int, int], ...] = ()


def smoothed_depth(surface: TriMesh, u: Float[np.ndarray, " v"], sweeps: int) -> Float[np.ndarray, " v"]:
    """`f = -u` after `sweeps` damped averages over neighbours; 0 stays 0 on the boundary."""
    depth = -u.astype(float)
    topology = surface.topology
    a, b = topology.edges.T
    for _ in range(sweeps):
        total = np.bincount(a, depth[b], len(depth)) + np.bincount(b, depth[a], len(depth))
        mean = total / np.maximum(topology.valence, 1)
        depth = np.where(topology.on_boundary, depth, 0.5 * depth + 0.5 * mean)
    return depth


def partition(
    surface: TriMesh,
    u: Float[np.ndarray, " v"],
    options: PartitionOptions | None = None,
    seams: tuple[Seam, ...] = (),
    size: Float[np.ndarray, " v"] | None = None,
) -> Partition:
    """Cut `surface` along isocontours of the depth of the log conformal factor `u` into caps, tubes and junctions.

    `surface` may have several components; where it was opened along `seams`, these join regions as contours do.
    With `size`, the length of wanted edges at each vertex (model units), limbs too thin for them are left out.

    Raises `StageError` when a component is closed or a region has no loop.
    """
    options = options or PartitionOptions()
    component = surface.vertex_components
    root = {int(component[loop[0]]): int(loop[0]) for loop in reversed(surface.topology.loops)}
    if len(root) < surface.topology.components[0]:
        raise StageError("partition", Outcome.NO_BOUNDARY)
    depth = smoothed_depth(surface, u, options.smoothing)
    large = options.large(surface)
    tree = join_tree(surface.topology.edges, depth, options.persistence, options.min_arc, large)
    while size is not None and (flat := levelled(surface, depth, tree, options, size)) is not depth:
        depth = flat
        tree = join_tree(surface.topology.edges, depth, options.persistence, options.min_arc, large)
    wanted = choose_levels(surface, depth, tree, options)
    limbs = np.bincount([component[level.tip] for level in wanted], minlength=component.max() + 1)
    done, tube = with_collars(CutSurface.whole(surface, depth), _loops_among_others(surface, limbs), 0, options)
    first = int(tube.max(initial=-1)) + 1
    caps = {level.arc: level for level in wanted if level.reason == "cap"}

    def around(level: Level) -> Bool[np.ndarray, " v"] | None:
        """Vertices that the contour of a level is around; None where there is none or it spoils a tube."""
        inside, cap = (
            None if one is None else filled_superlevel(done, one, root[int(component[one.tip])])
            for one in (level, caps.get(level.arc))
        )
        return None if inside is None or _spoils(inside, level, cap, done, tube) else inside

    levels: list[Level] = []
    long: list[Level] = []
    for level in wanted:
        if (inside := around(level)) is None:
            continue
        if options.neck and at_neck(done, inside, level.length / options.neck, first) is not None:
            long.append(level)
            continue
        done = cut(done, inside, level.value, first + len(levels))
        tube = np.r_[tube, np.full(len(done.mesh.vertices) - len(tube), -1)]
        levels.append(level)
    count = first + len(levels)
    for level in long:
        if (inside := around(level)) is not None and (
            neck := at_neck(done, inside, level.length / options.neck, count)
        ) is not None:
            done, tube = neck, np.r_[tube, np.full(len(neck.mesh.vertices) - len(tube), count)]
            count += 1
    values = (*[np.nan] * first, *(level.value for level in levels), *[np.nan] * (count - first - len(levels)))
    curves, pairs = _curves(done, values, seams)
    region, regions = _regions(done, curves)
    isovalues = isovalue_table(tree, tuple(levels), first)
    return Partition(done, curves, region, regions, tree.merges, isovalues, Outcome.DONE, pairs)


def _loops_among_others(surface: TriMesh, limbs: Int[np.ndarray, " c"]) -> tuple[Int[np.ndarray, " n"], ...]:
    """Boundary loops of components that are neither disks, of which the rest is no limb, nor tubes without `limbs`."""
    loops, component = surface.topology.loops, surface.vertex_components
    count = np.bincount([component[loop[0]] for loop in loops], minlength=len(limbs))
    enough = (count > 1) & (count + limbs > 2)
    return tuple(loop for loop in loops if enough[component[loop[0]]])


def _spoils(
    inside: Bool[np.ndarray, " v"],
    level: Level,
    cap: Bool[np.ndarray, " v"] | None,
    surface: CutSurface,
    tube: Int[np.ndarray, " v"],
) -> bool:
    """Whether a contour around `inside` runs through a tube, or ends a limb at a loop, which only tubes do.

    `cap` is what the contour of the cap of the same limb is around: with a loop in it, it is no cap.
    """
    whole = np.bincount(tube[tube >= 0])
    part = np.bincount(tube[inside & (tube >= 0)], minlength=len(whole))
    if ((part > 0) & (part < whole)).any():
        return True
    firsts = [loop[0] for loop in surface.mesh.topology.loops]
    loops = int(inside[firsts].sum())
    if level.reason == "cap":
        return loops > 0
    return loops == 1 and (cap is None or bool(cap[firsts].any()))


def filled_superlevel(surface: CutSurface, level: Level, root: int) -> Bool[np.ndarray, " v"] | None:
    """Vertices of the superlevel component of `level` with its holes filled (see `superlevel`).

    `root` is on the main boundary of that component of the surface. None when the component is the whole surface or
    only a tip of it is left.
    """
    above = surface.depth > level.value
    inside = superlevel(surface.mesh, above, level.tip, root)
    component = surface.mesh.vertex_components
    here = int((component == component[root]).sum())
    return inside if above[level.tip] and 3 < inside.sum() < here - 3 else None


def _curves(
    surface: CutSurface, levels: tuple[float, ...], seams: tuple[Seam, ...]
) -> tuple[tuple[Curve, ...], tuple[tuple[int, int], ...]]:
    """Contours, then both sides of the seams, then boundary loops; and which curves are sides of one seam."""
    edges = surface.mesh.topology.edges
    c = surface.contour
    curves = []
    for n, level in enumerate(levels):
        curves += [Curve(v, is_boundary=False, level=level) for v in trace(edges[(c[edges] == n).all(1)])]
    pairs = tuple((len(curves) + 2 * k, len(curves) + 2 * k + 1) for k in range(len(seams)))
    for seam in seams:
        curves += [Curve(side, is_boundary=False, level=0.0) for side in (seam.left, seam.right)]
    sewn = {int(v) for seam in seams for v in (*seam.left, *seam.right)}
    loops = (loop for loop in surface.mesh.topology.loops if int(loop[0]) not in sewn)
    return (*curves, *(Curve(loop, is_boundary=True, level=0.0) for loop in loops)), pairs


def _labels(surface: CutSurface) -> Int[np.ndarray, " f"]:
    """Region of each triangle."""
    topology = surface.mesh.topology
    c = surface.contour[topology.edges]
    open_edge = (topology.edge_count == 2) & ~((c[:, 0] >= 0) & (c[:, 0] == c[:, 1]))
    return graph_components(topology.edge_faces[open_edge], len(surface.mesh.triangles))


def _regions(surface: CutSurface, curves: tuple[Curve, ...]) -> tuple[np.ndarray, tuple[Region, ...]]:
    label = _labels(surface)
    curve_of = np.full(len(surface.mesh.vertices), -1)
    for n, curve in enumerate(curves):
        curve_of[curve.vertices] = n
    regions = []
    for r in range(label.max() + 1):
        piece = Topology(len(surface.mesh.vertices), surface.mesh.triangles[label == r])
        loops = tuple(sorted(int(curve_of[loop[0]]) for loop in piece.loops))
        if not loops:
            where = surface.mesh.vertices[np.unique(surface.mesh.triangles[label == r])]
            raise StageError("partition", Outcome.BAD_REGION, f"region {r} has no loop", where=where)
        kind = RegionKind.CAP if piece.euler == 1 else RegionKind.JUNCTION
        if piece.euler == 0 and len(loops) == 2:
            kind = RegionKind.TUBE
        regions.append(Region(kind, loops, piece.euler))
    return label, tuple(regions)
