"""Every metric of a quad mesh, in one dictionary with a fixed order."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh import QuadMesh, TriMesh
from drl_meshgen.quality.base_complex import base_complex, straight_pairs
from drl_meshgen.quality.closest import TriangleSearch
from drl_meshgen.quality.deviation import boundary_mse, deviation
from drl_meshgen.quality.mixed import MixedTopology, Outline
from drl_meshgen.quality.normals import pseudo_normals
from drl_meshgen.quality.shape import QuadShape, own_normals
from drl_meshgen.quality.structure import boundary_loops, structural_defects, t_junctions, topology_defects


@dataclass(frozen=True, eq=False)
class Quality:
    """What was measured on one mesh."""

    metrics: dict[str, float]
    """Name -> figure, in the order of the tables; NaN where a figure has no meaning."""
    shape: QuadShape
    """Angles, Jacobians, warp and size of each quad."""
    defects: tuple[str, ...]
    """One sentence per structural defect, including invalid quads; empty for a sound mesh."""


def surface_normals(mesh: QuadMesh, search: TriangleSearch, surface: TriMesh) -> tuple[Float[np.ndarray, "m 3"], bool]:
    """Return the quads' normals, each on the side its surface is on, and whether the mesh is wound against the surface.

    A mesh wound as a whole against the surface is measured as if it were turned round; single turned quads are not.
    """
    corners = mesh.points[mesh.quads]
    own = own_normals(corners)
    _, triangle, point = search(corners.mean(axis=1))
    under = pseudo_normals(surface, triangle, point)
    agreement = np.einsum("ij,ij->i", own, under)
    reverse = bool(np.median(agreement) < 0)
    return np.where(((agreement < 0) != reverse)[:, None], -own, own), reverse


def _neighbour_ratio(mesh: QuadMesh, size: Float[np.ndarray, " m"]) -> float:
    pair = mesh.topology.edge_faces[mesh.topology.edge_count == 2]
    if not len(pair):
        return 1.0
    both = size[pair]
    return float((both.max(axis=1) / np.maximum(both.min(axis=1), np.finfo(float).tiny)).max())


def line_smoothness(mesh: QuadMesh) -> tuple[float, float]:
    """Return the means of shorter / longer and of longer / shorter over consecutive interior edges of mesh lines.

    NaN where no mesh line has two. Manifold, oriented meshes only.
    """
    t = mesh.topology
    pair = straight_pairs(mesh)
    pair = pair[(t.edge_count[pair] > 1).all(axis=1)]
    if not len(pair):
        return np.nan, np.nan
    ends = mesh.points[t.edges]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[pair]
    ratio = length.min(axis=1) / np.maximum(length.max(axis=1), np.finfo(float).tiny)
    return float(ratio.mean()), float((1 / np.maximum(ratio, 1e-12)).mean())


def measure(
    mesh: QuadMesh,
    surface: TriMesh | None = None,
    block: Int[np.ndarray, " m"] | None = None,
    *,
    with_deviation: bool = True,
    search: TriangleSearch | None = None,
    triangles: Int[np.ndarray, "t 3"] | None = None,
) -> Quality:
    """Measure a quad mesh.

    Definitions are those of the documentation's table of metrics. With a `surface`, normals come from it, topology is
    compared with it and, unless switched off, distances to it are measured (fractions of its bounding-box diagonal).
    `search` is a search structure of the surface, if there is one already.
    `block` names the block of each quad. `triangles` are the faces a mixed mesh has beside its quads: shape is that of
    the quads, everything about topology and distance is that of the mixed mesh.
    """
    t = mesh.topology
    extra = 0 if triangles is None else len(triangles)
    outline: Outline = MixedTopology(len(mesh.points), mesh.quads, triangles) if triangles is not None and extra else t
    search = TriangleSearch(surface.corners) if search is None and surface is not None else search
    defects = [f"{extra} faces are triangles"] if extra else list(structural_defects(mesh, block))
    normals = own_normals(mesh.points[mesh.quads])
    if surface is not None and search is not None:
        defects += topology_defects(outline, surface)
        normals, against = surface_normals(mesh, search, surface)
        if against:
            defects.append("wound against the surface")
    shape = QuadShape(mesh.points[mesh.quads], normals)
    invalid = int((~shape.valid).sum())
    if invalid:
        defects.append(f"{invalid} {'quad' if invalid == 1 else 'quads'} with a Jacobian that is not positive")
    manifold = not (t.edge_count > 2).any() and not len(t.misoriented_edges)
    smoothness, edge_ratio = line_smoothness(mesh) if manifold else (np.nan, np.nan)
    metrics = {
        "quads": len(mesh.quads),
        "nodes": outline.used.sum(),
        "irregular": (outline.used & ~outline.on_boundary & (outline.valence != 4)).sum(),
        "blocks": base_complex(mesh).max() + 1 if manifold and not extra else np.nan,
        "named_blocks": np.nan if block is None else len(np.unique(block)),
        "t_junctions": np.nan if block is None or not manifold or extra else len(t_junctions(mesh, block)),
        "validity": shape.valid.mean(),
        "min_angle": shape.min_angle.min(),
        "max_angle": shape.max_angle.max(),
        "warp": shape.warp.max(),
        "area_ratio": _neighbour_ratio(mesh, shape.area),
        "side_ratio": _neighbour_ratio(mesh, shape.size),
        "orthogonality": shape.orthogonality.mean(),
        "orthogonality_printed": shape.orthogonality_printed.mean(),
        "compliance": (shape.deviation < 15).mean(),
        "jacobian_ratio": shape.jacobian_ratio.mean(),
        "scaled_jacobian_min": shape.scaled_jacobian.min(),
        "smoothness": smoothness,
        "edge_ratio": edge_ratio,
        "non_quads": extra / (len(mesh.quads) + extra),
        "components": outline.components[0],
        "loops": boundary_loops(outline),
        "euler": outline.euler,
    }
    if surface is not None:
        metrics["boundary_mse"], metrics["boundary_fit"] = boundary_mse(mesh.points, outline.boundary_edges, surface)
        if with_deviation:
            d = deviation(mesh, surface, outline.boundary_edges, search, triangles)
            metrics |= {
                "surface_deviation": d.surface,
                "surface_deviation_rms": d.surface_rms,
                "node_deviation": d.nodes,
                "boundary_deviation": d.boundary,
                "boundary_deviation_rms": d.boundary_rms,
            }
    return Quality({name: float(value) for name, value in metrics.items()}, shape, tuple(defects))


def quality_row(
    method: str, quality: Quality | None, seconds: float = np.nan, *, ok: bool = True, cause: str = ""
) -> dict[str, str | float | bool]:
    """Return one row of the quality table: method, ok, cause, seconds, defects, then every metric.

    A method that gave no mesh has `quality` None and no metrics in its row.
    """
    head: dict[str, str | float | bool] = {"method": method, "ok": ok, "cause": cause, "seconds": float(seconds)}
    if quality is None:
        return head | {"defects": ""}
    return head | {"defects": "; ".join(quality.defects)} | quality.metrics
