"""Cutting a surface along isocontours of a vertex function."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from drl_meshgen.mesh import TriMesh
from drl_meshgen.mesh.splitting import crossing, split_crossed
from drl_meshgen.mesh.topology import Topology, graph_components


@dataclass(frozen=True, eq=False)
class CutSurface:
    """A refined surface that remembers where it came from.

    `parent (f,)` is the original triangle of each triangle, `depth (v,)` the function (equal to the level on a
    contour), `contour (v,)` the contour a vertex was made for, -1 elsewhere.
    """

    mesh: TriMesh
    depth: Float[np.ndarray, " v"]
    parent: Int[np.ndarray, " f"]
    contour: Int[np.ndarray, " v"]

    @staticmethod
    def whole(surface: TriMesh, depth: Float[np.ndarray, " v"]) -> "CutSurface":
        """Return the surface before the first cut."""
        return CutSurface(surface, depth, np.arange(len(surface.triangles)), np.full(len(surface.vertices), -1))


def cut(
    surface: CutSurface,
    inside: Bool[np.ndarray, " v"],
    level: float,
    contour: int,
    function: Float[np.ndarray, " v"] | None = None,
) -> CutSurface:
    """Split every triangle that has corners both in and out of `inside` where `function` (the depth) passes `level`.

    The crossing of edge `ij` is `v_i + (level - f_i) / (f_j - f_i) (v_j - v_i)` (eq. 9), kept clear of the ends.
    """
    edges = surface.mesh.topology.edges
    crossed = inside[edges[:, 0]] != inside[edges[:, 1]]
    a, b = edges[crossed].T
    passing = surface.depth if function is None else function
    share = crossing(passing[a], passing[b], level)
    split = split_crossed(surface.mesh, crossed, share)
    depth = np.full(len(share), level) if function is None else between(surface.depth, a, b, share)
    return CutSurface(
        split.mesh,
        np.r_[surface.depth, depth],
        surface.parent[split.parent],
        np.r_[surface.contour, np.full(len(share), contour)],
    )


def superlevel(
    mesh: TriMesh, above: Bool[np.ndarray, " v"], tip: int, root: int | None = None
) -> Bool[np.ndarray, " v"]:
    """Vertices of the component of `above` with `tip`, its holes filled, so that its border is one closed curve.

    A hole is a component of the complement without `root`; all but the largest where there is no root or it is inside.
    """
    edges = mesh.topology.edges
    component = mesh.vertex_components
    label = graph_components(edges[above[edges].all(1)], len(above))
    core = label == label[tip]
    rest = (component == component[tip]) & ~core
    outside = graph_components(edges[rest[edges].all(1)], len(above))
    by_size = root is None or core[root]
    main = np.bincount(outside[rest], minlength=1).argmax() if by_size else outside[root]
    return core | (rest & (outside != main))


def between(
    values: Float[np.ndarray, "v *k"],
    a: Int[np.ndarray, " e"],
    b: Int[np.ndarray, " e"],
    share: Float[np.ndarray, " e"],
) -> Float[np.ndarray, "e *k"]:
    """Return what linear functions are at a share of the way from vertices `a` to `b`."""
    t = np.clip(share, 0, 1).reshape(-1, *(1,) * (values.ndim - 1))
    return values[a] + t * (values[b] - values[a])


def midpoint_refined(mesh: TriMesh) -> TriMesh:
    """Split every triangle in four at its edge midpoints; old vertices keep their ids."""
    topology: Topology = mesh.topology
    middle = mesh.vertices[topology.edges].mean(1)
    m = topology.face_edges + len(mesh.vertices)
    t = mesh.triangles
    fine = np.stack(
        [
            np.c_[t[:, 0], m[:, 0], m[:, 2]],
            np.c_[t[:, 1], m[:, 1], m[:, 0]],
            np.c_[t[:, 2], m[:, 2], m[:, 1]],
            np.c_[m[:, 0], m[:, 1], m[:, 2]],
        ],
        axis=1,
    )
    return TriMesh(np.vstack([mesh.vertices, middle]), fine.reshape(-1, 3))
