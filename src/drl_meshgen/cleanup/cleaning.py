"""The cleanup stage: repairs in a fixed order, checks of what the later stages rely on, and the audit."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from jaxtyping import Float

from drl_meshgen.cleanup import repair
from drl_meshgen.cleanup.meshlab import remesh_isotropic
from drl_meshgen.cleanup.refine import refined, widened_necks
from drl_meshgen.cleanup.repair import CleanupWarning
from drl_meshgen.cleanup.transfer import transferred
from drl_meshgen.errors import InputError
from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.topology import Topology
from drl_meshgen.models.surface import RawSurface, frozen_arrays


@dataclass(frozen=True)
class CleanupOptions:
    """What cleanup may change."""

    merge_tolerance: float = 1e-7
    """Points closer than this are one point (fraction of the bounding-box diagonal)."""
    flat_limit: float = 1e-7
    """Triangles with a smaller height over their longest side are degenerate (ratio)."""
    strict: bool = False
    """Refuse a surface of several components instead of keeping the largest."""
    remesh: bool = False
    """Remesh isotropically after the repairs."""
    remesh_edge: float | None = None
    """Edge length of remeshing (fraction of the diagonal); None: the number of triangles stays about the same."""
    min_triangles: int = 4_000
    """Coarser surfaces are subdivided at edge midpoints, which keeps their shape, to at least this many triangles."""


@dataclass(frozen=True, eq=False)
class CleanupResult:
    """The cleaned surface and what was done to get it."""

    surface: TriMesh
    """One oriented manifold component with at least one boundary loop, in the units of the input."""
    audit: pd.DataFrame
    """One row per step: `step`, `count` (items changed), `remark`."""
    point_data: Mapping[str, Float[np.ndarray, " v"]] = field(default_factory=dict)
    """The input's numbers per point, at the vertices of the surface; interpolated where a vertex is new."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "point_data", frozen_arrays(self.point_data))


class _Audit:
    def __init__(self) -> None:
        self.rows: list[tuple[str, int, str]] = []

    def add(self, step: str, count: int, remark: str = "") -> None:
        self.rows.append((step, int(count), remark))

    def table(self) -> pd.DataFrame:
        return pd.DataFrame(self.rows, columns=["step", "count", "remark"])


def clean(raw: RawSurface, options: CleanupOptions = CleanupOptions()) -> CleanupResult:
    """Make `raw` one oriented manifold surface of genus 0 with a boundary.

    A surface that is clean already comes back unchanged, vertex by vertex. Lengths are judged relative to the
    bounding-box diagonal, so any unit works.

    Raises `InputError` for what cannot be mended: non-manifold edges that are not fins, a surface that cannot be
    oriented, several components when `strict`, a closed surface, handles, no area.
    Warns with `CleanupWarning` when components are left out.
    """
    audit = _Audit()
    points, scale, shift = _normalised(raw)
    triangles = _repaired(raw.name, points, raw.triangles, options, audit)
    triangles, source, copies = repair.split_pinched(len(points), triangles)
    audit.add("split non-manifold vertices", copies)
    oriented, turned = repair.orient(len(source), triangles)
    if oriented is None:
        raise InputError(raw.name, "the surface has only one side (it cannot be oriented)", "cut or repair it")
    audit.add("orient triangles", turned)
    keep, components = repair.largest_component(points[source], oriented)
    if components > 1:
        if options.strict:
            raise InputError(raw.name, f"{components} separate components", "keep one, or drop the strict option")
        message = f"{raw.name}: {components} separate components, only the largest is meshed"
        warnings.warn(message, CleanupWarning, stacklevel=2)
    audit.add("drop smaller components", components - 1, f"{int((~keep).sum())} triangles" if components > 1 else "")
    oriented = oriented[keep]
    used = np.unique(oriented)
    audit.add("drop unused vertices", len(source) - len(used))
    origin = source[used]
    if len(used) == len(raw.points) == len(source):
        surface = TriMesh(raw.points, oriented)
    else:
        renumber = np.zeros(len(source), np.int64)
        renumber[used] = np.arange(len(used))
        surface = TriMesh(raw.points[origin], renumber[oriented])
    _check_topology(raw.name, surface.topology)
    if options.remesh:
        before = len(surface.triangles)
        surface = _remeshed(surface, scale, shift, options)
        audit.add("remesh", len(surface.triangles), f"from {before} triangles")
        _check_topology(raw.name, surface.topology)
    surface, rounds = refined(surface, options.min_triangles)
    audit.add("refine by midpoints", rounds, f"{len(surface.triangles)} triangles")
    surface, necks = widened_necks(surface)
    audit.add("widen necks of three edges", necks)
    slivers = int((repair.flatness(surface.vertices / scale, surface.triangles) < 0.02).sum())
    audit.add("slivers left", slivers, "height below 2 % of the longest side; kept")
    carried = transferred(raw.points[origin], {k: a[origin] for k, a in raw.point_data.items()}, surface.vertices)
    return CleanupResult(surface, audit.table(), carried)


def _normalised(raw: RawSurface) -> tuple[np.ndarray, float, np.ndarray]:
    """Positions with the bounding box of the used points centred and its diagonal 1, the scale and the shift."""
    if len(raw.triangles) == 0:
        raise InputError(raw.name, "holds no triangles")
    used = raw.points[np.unique(raw.triangles)]
    if not np.isfinite(used).all():
        raise InputError(raw.name, "points have NaN or infinite coordinates")
    low, high = used.min(axis=0), used.max(axis=0)
    shift, largest = low / 2 + high / 2, float((high / 2 - low / 2).max())
    if largest == 0:
        raise InputError(raw.name, "the surface has no area (all points coincide)")
    scale = 2 * largest * float(np.linalg.norm((high / 2 - low / 2) / largest))
    return np.nan_to_num((raw.points - shift) / scale), scale, shift


def _repaired(
    name: str, points: np.ndarray, triangles: np.ndarray, options: CleanupOptions, audit: _Audit
) -> np.ndarray:
    """Merge, drop and trim until every edge has one or two triangles."""
    ids = repair.merged_ids(points, options.merge_tolerance)
    audit.add("merge duplicate points", (ids != np.arange(len(ids))).sum())
    triangles = ids[triangles]
    count = len(triangles)
    triangles = repair.drop_collapsed(triangles)
    audit.add("drop degenerate triangles", count - len(triangles))
    count = len(triangles)
    triangles = repair.drop_duplicates(triangles)
    audit.add("drop duplicate triangles", count - len(triangles))
    if len(triangles) == 0 or (repair.flatness(points, triangles) < options.flat_limit).all():
        raise InputError(name, "the surface has no area (every triangle is degenerate)")
    triangles, mended = repair.mend_flat(points, triangles, options.flat_limit)
    audit.add("mend flat triangles", mended)
    triangles, trimmed = repair.trim_fins(points, triangles)
    audit.add("trim fins at non-manifold edges", trimmed)
    topology = Topology(len(points), triangles)
    crowded = np.nonzero(topology.edge_count > 2)[0]
    if len(crowded):
        place = points[topology.edges[crowded[0]]].mean(axis=0)
        raise InputError(
            name,
            f"{len(crowded)} edges belong to three or more triangles, one near ({place[0]:.3g}, {place[1]:.3g}, "
            f"{place[2]:.3g}) x diagonal from the centre",
            "separate the sheets that meet there",
        )
    return triangles


def _check_topology(name: str, topology: Topology) -> None:
    loops, euler = len(topology.loops), topology.euler
    genus = (2 - euler - loops) // 2
    facts = f"Euler characteristic {euler}, genus {genus}, {loops} boundary loops"
    if loops == 0:
        raise InputError(name, f"closed surfaces are not meshed yet ({facts})", "cut an opening")
    if genus > 0:
        raise InputError(name, f"surfaces with handles are not meshed yet ({facts})", "cut the handles open")


def _remeshed(surface: TriMesh, scale: float, shift: np.ndarray, options: CleanupOptions) -> TriMesh:
    points = (surface.vertices - shift) / scale
    area = surface.area / scale**2
    edge = options.remesh_edge or float(np.sqrt(4 / np.sqrt(3) * area / len(surface.triangles)))
    new_points, triangles = remesh_isotropic(points, surface.triangles, edge)
    return TriMesh(new_points * scale + shift, triangles)
