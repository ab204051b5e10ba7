"""A surface cut open along seams."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
import pandas as pd
from jaxtyping import Int

from drl_meshgen.errors import StageError
from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.topology import Topology
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
    component of the opened mesh on the left, length (model units), number of nodes.
    """

    mesh: TriMesh
    parent: Int[np.ndarray, " f"]
    seams: tuple[Seam, ...]
    table: pd.DataFrame


def open_surface(surface: TriMesh, options: SeamOptions | None = None) -> OpenedSurface:
    """Cut `surface` along closed curves until every component has genus 0 and at least one boundary loop.

    Surfaces that are like that already come back as they are. Raises `StageError` where no seam is found.
    """
    options = options or SeamOptions()
    seams: tuple[Seam, ...] = ()
    n, label = surface.topology.components
    for c in range(n):
        piece = Topology(len(surface.vertices), surface.triangles[label == c])
        if not piece.loops or piece.euler + len(piece.loops) != 2:
            detail = f"component {c}: Euler characteristic {piece.euler}, {len(piece.loops)} loops"
            raise StageError("seams", Outcome.NOT_OPENED, detail)
    return OpenedSurface(surface, np.arange(len(surface.triangles)), seams, _table(surface, seams))


def _table(mesh: TriMesh, seams: tuple[Seam, ...]) -> pd.DataFrame:
    """One row per seam."""
    label = mesh.topology.components[1]
    start, around = mesh.vertex_triangles
    rows = []
    for n, seam in enumerate(seams):
        p = mesh.vertices[seam.left]
        length = float(np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1).sum())
        component = int(label[around[start[seam.left[0]]]])
        rows.append((n, seam.kind.value, component, length, len(p)))
    return pd.DataFrame(rows, columns=["seam", "kind", "component", "length", "nodes"])
