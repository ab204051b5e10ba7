"""A surface cut open along seams."""

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from drl_meshgen.errors import StageError
from drl_meshgen.mesh import FeatureCurve, TriMesh
from drl_meshgen.mesh.curves import closed_length
from drl_meshgen.mesh.topology import Topology
from drl_meshgen.seams.cuts import cut_features, cut_handle, cut_waist
from drl_meshgen.seams.features import feature_curves
from drl_meshgen.seams.insertion import Incision
from drl_meshgen.seams.options import Outcome, SeamOptions


class SeamKind(Enum):
    """Why a seam is there."""

    HANDLE = "around a handle"
    WAIST = "around a closed surface"
    FEATURE = "along a sharp edge"


@dataclass(frozen=True, eq=False)
class Seam:
    """A closed curve along which the surface is cut: vertex ids of the opened mesh on either side.

    `left[k]` and `right[k]` are the same point. Each is a whole boundary loop of the opened mesh, both in the same
    order, so that one runs with its mesh on the left and the other against it.
    """

    left: Int[np.ndarray, " n"]
    right: Int[np.ndarray, " n"]
    kind: SeamKind


@dataclass(frozen=True, eq=False)
class OpenedSurface:
    """A surface whose components all have genus 0 and a boundary.

    `parent (f,)` is the triangle of the given surface for each triangle. `table` has one row per seam: kind,
    component of the opened mesh on the left, length (model units), number of nodes. `features` are all sharp
    curves of the given surface, cut or not.
    """

    mesh: TriMesh
    parent: Int[np.ndarray, " f"]
    seams: tuple[Seam, ...]
    table: pd.DataFrame
    features: tuple[FeatureCurve, ...] = ()

    @property
    def loops(self) -> tuple[Float[np.ndarray, "n 3"], ...]:
        """Points of all boundary loops, either side of seams included."""
        return tuple(self.mesh.vertices[loop] for loop in self.mesh.topology.loops)


def open_surface(
    surface: TriMesh, options: SeamOptions | None = None, sharp: Int[np.ndarray, "k 2"] | None = None
) -> OpenedSurface:
    """Cut `surface` along closed curves until every component has genus 0 and at least one boundary loop.

    With a feature angle or given `sharp` edges (vertex pairs), closed sharp curves without corners are cut first.
    Surfaces with nothing to cut come back as they are. Raises `StageError` where no seam is found.
    """
    options = options or SeamOptions()
    curves = feature_curves(surface, options, sharp)
    features = tuple(curve for curve, _ in curves)
    first = cut_features(surface, [v for curve, v in curves if curve.closed and not len(curve.corners)])
    seams = tuple(Seam(left, right, SeamKind.FEATURE) for left, right in first.sides)
    mesh = first.mesh
    n, label = mesh.topology.components
    parts = [np.nonzero(label == c)[0] for c in range(n)]
    if all(_is_open(mesh.topology, part) for part in parts):
        return OpenedSurface(mesh, first.parent, seams, _table(mesh, seams), features)
    points, triangles, parents, opened, count = [], [], [], [], 0
    place = np.full(len(mesh.vertices), -1)
    for c, part in enumerate(parts):
        used, ids = np.unique(mesh.triangles[part], return_inverse=True)
        place[used] = count + np.arange(len(used))
        incision, kinds = _opened(TriMesh(mesh.vertices[used], ids.reshape(-1, 3)), options, c)
        points.append(incision.mesh.vertices)
        triangles.append(incision.mesh.triangles + count)
        parents.append(first.parent[part[incision.parent]])
        opened += [Seam(a + count, b + count, kind) for (a, b), kind in zip(incision.sides, kinds, strict=True)]
        count += len(incision.mesh.vertices)
    mesh = TriMesh(np.concatenate(points), np.concatenate(triangles))
    seams = (*(replace(seam, left=place[seam.left], right=place[seam.right]) for seam in seams), *opened)
    return OpenedSurface(mesh, np.concatenate(parents), seams, _table(mesh, seams), features)


def _is_open(topology: Topology, part: np.ndarray) -> bool:
    piece = Topology(topology.n_vertices, topology.faces[part])
    return _genus(piece) == 0 and bool(piece.loops)


def _genus(topology: Topology) -> int:
    return (2 - topology.euler - len(topology.loops)) // 2


def _opened(mesh: TriMesh, options: SeamOptions, component: int) -> tuple[Incision, list[SeamKind]]:
    """Cut one component open: first around its handles, then around its waist if it is still closed."""
    incision, kinds, known = Incision.none(mesh), [], []
    while _genus(incision.mesh.topology) > 0:
        after, known = cut_handle(incision, known, options)
        if after is None or _genus(after.mesh.topology) >= _genus(incision.mesh.topology):
            detail = f"component {component}: {_genus(incision.mesh.topology)} handles left"
            raise StageError("seams", Outcome.NOT_OPENED, detail, where=mesh.vertices)
        incision, kinds = after, [*kinds, SeamKind.HANDLE]
    if not incision.mesh.topology.loops:
        after = cut_waist(incision, options)
        if after is None:
            detail = f"component {component}: closed, and no curve divides it"
            raise StageError("seams", Outcome.NOT_OPENED, detail, where=mesh.vertices)
        incision, kinds = after, [*kinds, SeamKind.WAIST]
    return incision, kinds


def _table(mesh: TriMesh, seams: tuple[Seam, ...]) -> pd.DataFrame:
    """One row per seam."""
    label = mesh.topology.components[1]
    start, around = mesh.vertex_triangles
    rows = []
    for n, seam in enumerate(seams):
        length = closed_length(mesh.vertices[seam.left])
        component = int(label[around[start[seam.left[0]]]])
        rows.append((n, seam.kind.value, component, length, len(seam.left)))
    return pd.DataFrame(rows, columns=["seam", "kind", "component", "length", "nodes"])
