"""The cleanup stage: repairs in a fixed order, checks of what the later stages rely on, and the audit."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from drl_meshgen.cleanup import repair
from drl_meshgen.cleanup.holes import fill_holes
from drl_meshgen.cleanup.refine import refined, widened_necks
from drl_meshgen.cleanup.remesh import remeshed
from drl_meshgen.cleanup.repair import CleanupWarning
from drl_meshgen.cleanup.sheets import manifold
from drl_meshgen.cleanup.transfer import transferred
from drl_meshgen.errors import InputError
from drl_meshgen.mesh import TriMesh
from drl_meshgen.models.surface import RawSurface, frozen_arrays
from drl_meshgen.ricci.pinches import separating_triangles

_TANGLED = 0.01  # share of the triangles that may be left out where sheets cannot be taken apart


@dataclass(frozen=True)
class CleanupOptions:
    """What cleanup may change."""

    merge_tolerance: float = 1e-7
    """Points closer than this are one point (fraction of the bounding-box diagonal)."""
    flat_limit: float = 1e-7
    """Triangles with a smaller height over their longest side are degenerate (ratio)."""
    fill_holes: float = 0.02
    """Longest hole that is filled (length around, fraction of the diagonal; holes of at most six edges may be twice
    as long, of three five times); 0: none."""
    specks: float = 1e-4
    """Components with less than this share of the area are left out; ten times that below eight triangles (ratio)."""
    strict: bool = False
    """Refuse a surface of several components instead of meshing each."""
    remesh: bool = False
    """Remesh isotropically after the repairs."""
    remesh_edge: float | None = None
    """Edge length of remeshing (fraction of the diagonal); None: the number of triangles stays about the same."""
    min_triangles: int = 4_000
    """Coarser components are subdivided at edge midpoints, which keeps their shape, to at least this many triangles."""


@dataclass(frozen=True, eq=False)
class CleanupResult:
    """The cleaned surface and what was done to get it."""

    surface: TriMesh
    """Oriented and manifold, one component or several, in the units of the input."""
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
    """Make `raw` one oriented manifold surface of one component or several.

    A surface that is clean already comes back unchanged, vertex by vertex. Lengths are judged relative to the
    bounding-box diagonal, so any unit works.

    Raises `InputError` for what cannot be mended: a component that cannot be oriented, several components when
    `strict`, no area, triangles tangled beyond repair.
    Warns with `CleanupWarning` where components are left out or holes are filled.
    """
    audit = _Audit()
    points, scale, shift = _normalised(raw)
    triangles = _repaired(raw.name, points, raw.triangles, options, audit)
    triangles, source, counts, tangled = manifold(points, triangles)
    if counts["triangles"] > _TANGLED * len(triangles):
        defect = f"{counts['triangles']} triangles are tangled at edges of three or more, {_place(raw, tangled)}"
        raise InputError(raw.name, defect, "separate the sheets that meet there", where=raw.points[np.unique(tangled)])
    audit.add("take sheets apart at edges of three or more triangles", counts["edges"])
    audit.add("drop tangled triangles", counts["triangles"])
    audit.add("split non-manifold vertices", counts["vertices"])
    triangles = _without_specks(raw.name, points[source], triangles, options, audit)
    triangles, turned, one_sided = repair.orient(len(source), triangles)
    if one_sided.any():
        ids = source[repair.disagreeing(len(source), triangles[one_sided])]
        defect = f"the surface has only one side {_place(raw, ids)} (it cannot be oriented)"
        raise InputError(raw.name, defect, "cut or repair it", where=raw.points[ids])
    audit.add("orient triangles", turned)
    triangles, filled = fill_holes(points[source], triangles, options.fill_holes)
    audit.add("fill small holes", filled)
    if filled:
        _warn(f"{raw.name}: {filled} small hole{'s'[: filled > 1]} filled")
    used = np.unique(triangles)
    audit.add("drop unused vertices", len(source) - len(used))
    origin = source[used]
    if len(used) == len(raw.points) == len(source):
        surface = TriMesh(raw.points, triangles)
    else:
        renumber = np.zeros(len(source), np.int64)
        renumber[used] = np.arange(len(used))
        surface = TriMesh(raw.points[origin], renumber[triangles])
    if options.remesh:
        before = len(surface.triangles)
        surface, kept = remeshed(surface, scale, shift, options.remesh_edge)
        audit.add("remesh", len(surface.triangles), f"from {before} triangles")
        audit.add("components not remeshed", kept, "remeshing would change their topology")
        if kept:
            _warn(f"{raw.name}: {kept} component{'s'[: kept > 1]} not remeshed, because that would tear them")
    surface, rounds = refined(surface, options.min_triangles)
    audit.add("refine by midpoints", rounds, f"{len(surface.triangles)} triangles")
    surface, necks = widened_necks(surface)
    audit.add("widen necks of three edges", necks)
    slivers = int((repair.flatness(surface.vertices / scale, surface.triangles) < repair.SLIVER).sum())
    audit.add("slivers left", slivers, "height below 2 % of the longest side; kept")
    _check_necks(raw.name, surface)
    carried = transferred(raw.points[origin], {k: a[origin] for k, a in raw.point_data.items()}, surface.vertices)
    return CleanupResult(surface, audit.table(), carried)


def _warn(message: str) -> None:
    warnings.warn(message, CleanupWarning, stacklevel=3)


def _place(raw: RawSurface, vertices: Int[np.ndarray, "..."]) -> str:
    """Where one of the vertices is, in the units of the input: the one nearest to their middle."""
    p = raw.points[np.unique(vertices)]
    x, y, z = p[np.linalg.norm(p - p.mean(axis=0), axis=1).argmin()]
    return f"near ({x:.6g}, {y:.6g}, {z:.6g})"


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
    """Merge points, drop what has no area, trim fins."""
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
    triangles, needless = repair.drop_needless(points, triangles)
    audit.add("drop vertices in slivers", needless)
    triangles, trimmed = repair.trim_fins(points, triangles)
    audit.add("trim fins at non-manifold edges", trimmed)
    return triangles


def _without_specks(
    name: str, points: np.ndarray, triangles: np.ndarray, options: CleanupOptions, audit: _Audit
) -> np.ndarray:
    speck, left_out, components = repair.specks(points, triangles, options.specks)
    if options.strict and components > 1:
        raise InputError(name, f"{components} separate components", "keep one, or drop the strict option")
    if left_out:
        _warn(f"{name}: {left_out} of {components} components left out, each below {options.specks:g} of the area")
    remark = f"{int(speck.sum())} triangles of {components} components" if left_out else f"{components} components"
    audit.add("leave out specks", left_out, remark)
    return triangles[~speck]


def _check_necks(name: str, surface: TriMesh) -> None:
    necks = separating_triangles(surface)
    if len(necks):
        x, y, z = surface.vertices[necks[0]].mean(axis=0)
        defect = f"{len(necks)} necks of three edges cannot be widened, one near ({x:.6g}, {y:.6g}, {z:.6g})"
        raise InputError(name, defect, "remesh the surface there", where=surface.vertices[np.unique(necks)])
