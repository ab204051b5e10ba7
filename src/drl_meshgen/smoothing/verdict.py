"""How good a quad mesh is, in the few figures the optimiser steers by."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drl_meshgen.mesh import QuadMesh, TriMesh
from drl_meshgen.smoothing.energy import Shape, shape_of
from drl_meshgen.smoothing.options import SmoothingOptions


@dataclass(frozen=True)
class Figures:
    """Worst quads of a mesh."""

    invalid: int
    """Quads with a non-positive Jacobian."""
    min_angle: float
    """Degrees."""
    max_angle: float
    """Degrees, reflex counted."""
    area_ratio: float
    """Largest ratio of the areas of edge-adjacent quads."""
    orthogonality: float
    """Mean of one minus the largest deviation from a right angle in each quad, in right angles."""

    def shortfall(self, options: SmoothingOptions) -> float:
        """Single figure to compare meshes by, smaller is better: folded quads first, then missed limits."""
        low, high = options.wanted_angles
        missed = max(0.0, low - self.min_angle) + max(0.0, self.max_angle - high)
        missed += 20 * max(0.0, np.log(self.area_ratio / options.wanted_area_ratio))
        return 1e3 * self.invalid + missed + 100 * (1 - self.orthogonality)


def figures(shape: Shape, pairs: Int[np.ndarray, "2 e"]) -> Figures:
    """Figures of quads from their geometry; `pairs` are the edge-adjacent ones."""
    angle = np.degrees(np.mod(shape.angle, 2 * np.pi))
    area = np.maximum(np.abs(shape.area), np.finfo(float).tiny)
    jump = np.abs(np.log(area[pairs[0]] / area[pairs[1]]))
    skew = np.clip(np.abs(angle - 90).max(axis=0) / 90, 0, 1)
    return Figures(
        invalid=int((~shape.valid).sum()),
        min_angle=float(angle.min()),
        max_angle=float(angle.max()),
        area_ratio=float(np.exp(min(jump.max(initial=0.0), 700.0))),
        orthogonality=float(1 - skew.mean()),
    )


def shape_on_surface(surface: TriMesh, mesh: QuadMesh, points: Float[np.ndarray, "n 3"]) -> Shape:
    """Geometry of all quads, oriented by the surface triangle closest to each centroid (what a referee sees)."""
    import pyvista as pv  # heavy: loaded only where the exact verdict is asked for

    centroids = points[mesh.quads].mean(axis=1)
    grid = pv.PolyData.from_regular_faces(surface.vertices, surface.triangles)
    nearest = np.atleast_1d(grid.find_closest_cell(centroids))
    return shape_of(np.ascontiguousarray(mesh.quads.T), points, surface.normals[nearest].T)
