"""From an implicit solid with an opening to a well-shaped triangulated surface with a smooth rim."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import brentq

from drl_meshgen.cleanup.meshlab import remesh_isotropic
from drl_meshgen.cleanup.refine import subdivided
from drl_meshgen.mesh import TriMesh
from drl_meshgen.models.implicit import distance_to_polyline

Field = Callable[[np.ndarray, float], np.ndarray]
"""`field(points, band)`: signed distance-like value per point, right within `band` of the surface."""

COARSE = 3  # fine grid steps per coarse grid step
BASE_TRIANGLES = 120_000  # larger surfaces are midpoint subdivisions of one below this, projected
SMALLEST_FACTOR = 0.35  # edges of a zone relative to the rest of the surface
COUNT_BIAS = 1.055  # isotropic remeshing gives about 5 % fewer triangles than area / target area


@dataclass(frozen=True, eq=False)
class Zone:
    """Where triangles shall be smaller: within `reach` of a polyline."""

    axis: Float[np.ndarray, "p 3"]
    reach: float
    factor: float
    """Edge length relative to the rest of the surface."""
    longest: float
    """Edge length in model units kept on coarse surfaces, so that limbs stay round (down to `SMALLEST_FACTOR`)."""


@dataclass(frozen=True, eq=False)
class Solid:
    """An implicit solid, its opening and how finely its parts are to be meshed."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    area: float
    """Rough surface area, to choose the grid step."""
    smooth: Field
    """The solid without surface detail, to start from."""
    detailed: Callable[[float], Field]
    """`detailed(blur)`: the solid with its detail, marks narrower than `blur` smoothed away."""
    opening: Callable[[np.ndarray], np.ndarray]
    """Field whose negative side is cut off the surface."""
    zones: tuple[Zone, ...]


def zone_of(points: Float[np.ndarray, "n 3"], zones: tuple[Zone, ...]) -> Int[np.ndarray, " n"]:
    """Index of the last zone that each point lies in, -1 for none."""
    index = np.full(len(points), -1)
    for k, zone in enumerate(zones):
        low, high = zone.axis.min(axis=0) - zone.reach, zone.axis.max(axis=0) + zone.reach
        near = np.nonzero(((points > low) & (points < high)).all(axis=1))[0]
        index[near[distance_to_polyline(points[near], zone.axis) < zone.reach]] = k
    return index


def sample(solid: Solid, triangles: int) -> TriMesh:
    """Triangulate the surface of `solid` less its opening with about `triangles` triangles.

    Grid contour, exact cut, isotropic remeshing (zones after the rest), then tangential relaxation with every
    vertex projected on the solid and rim vertices on the rim curve. Deterministic.
    """
    levels = max(0, int(np.ceil(np.log2(triangles / BASE_TRIANGLES) / 2)))
    base = triangles / 4**levels
    edge = np.sqrt(4 / np.sqrt(3) * solid.area / base)
    mesh = cut(TriMesh(*contour(solid.smooth, solid.low, solid.high, 0.4 * edge)), solid.opening)
    mesh = _remesh(mesh, solid, base)
    projector = Projector(solid.detailed(edge / 2**levels / 2), solid.opening, mesh.diagonal)
    mesh = projector.relax(mesh, sweeps=4)
    for _ in range(levels):
        mesh = projector.project(subdivided(mesh))
    return mesh


def contour(
    field: Field, low: tuple[float, float, float], high: tuple[float, float, float], step: float
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Zero set of `field`, normals outwards, on a grid of spacing `step` that is evaluated only near the surface."""
    import pyvista as pv

    origin, coarse = np.array(low), COARSE * step
    cells = np.ceil((np.array(high) - origin) / coarse).astype(int)
    band = 1.4 * np.sqrt(3) / 2 * coarse  # half a cell diagonal, for fields up to 1.4 times a distance
    axes = [origin[k] + coarse * np.arange(cells[k] + 1) for k in range(3)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    value = field(nodes, band).reshape(cells + 1)
    fine_value = np.repeat(np.repeat(np.repeat(value, COARSE, 0), COARSE, 1), COARSE, 2)
    trim = tuple(slice(0, COARSE * n + 1) for n in cells)
    close = np.abs(value) < band
    active = np.zeros(cells, bool)
    for corner in np.ndindex(2, 2, 2):
        active |= close[tuple(slice(c, c + n) for c, n in zip(corner, cells, strict=True))]
    fine = fine_value[trim].astype(np.float32)
    mask = np.zeros(fine.shape, bool)
    block = np.repeat(np.repeat(np.repeat(active, COARSE, 0), COARSE, 1), COARSE, 2)
    for corner in np.ndindex(2, 2, 2):
        mask[tuple(slice(c, c + n) for c, n in zip(corner, block.shape, strict=True))] |= block
    index = np.argwhere(mask)
    exact = field(origin + step * index, band)
    fine[mask] = np.where(np.abs(exact) < 1e-6 * step, 1e-6 * step, exact)
    image = pv.ImageData(dimensions=fine.shape, spacing=(step,) * 3, origin=origin)
    image.point_data["field"] = fine.ravel(order="F")
    surface = image.contour([0.0], scalars="field", method="flying_edges")
    return np.asarray(surface.points, np.float64), surface.regular_faces[:, ::-1].astype(np.int64)


def cut(mesh: TriMesh, opening: Callable[[np.ndarray], np.ndarray]) -> TriMesh:
    """Return the largest component of what `clipped` leaves."""
    return largest_component(clipped(mesh, opening))


def clipped(mesh: TriMesh, opening: Callable[[np.ndarray], np.ndarray]) -> TriMesh:
    """Keep the part of the mesh where `opening` is positive; cut edges are split at its linear zero."""
    import pyvista as pv

    value = opening(mesh.vertices)
    tiny = 1e-9 * mesh.diagonal
    surface = pv.PolyData.from_regular_faces(mesh.vertices, mesh.triangles)
    surface.point_data["opening"] = np.where(np.abs(value) < tiny, tiny, value)
    kept = surface.clip_scalar(scalars="opening", value=0.0, invert=False).triangulate()
    return TriMesh(np.asarray(kept.points, np.float64), kept.regular_faces.astype(np.int64))


def largest_component(mesh: TriMesh) -> TriMesh:
    """Keep the component with most triangles and the vertices it uses."""
    _, label = mesh.topology.components
    keep = mesh.triangles[label == np.bincount(label).argmax()]
    used, triangles = np.unique(keep, return_inverse=True)
    return TriMesh(mesh.vertices[used], triangles.reshape(-1, 3))


def _remesh(mesh: TriMesh, solid: Solid, triangles: float) -> TriMesh:
    """Remesh to the edge length of each zone: all at the finest first if limbs could collapse, then zone by zone."""
    zone = zone_of(mesh.corners.mean(axis=1), solid.zones)
    area = np.bincount(zone + 1, weights=mesh.areas, minlength=len(solid.zones) + 1)
    factor = np.array([1.0, *(z.factor for z in solid.zones)])
    longest = np.array([np.inf, *(z.longest for z in solid.zones)])

    def zone_lengths(edge: float) -> np.ndarray:
        return np.minimum(factor * edge, np.maximum(longest, SMALLEST_FACTOR * edge))

    def excess(edge: float) -> float:
        return float((4 / np.sqrt(3) * area / zone_lengths(edge) ** 2).sum()) - COUNT_BIAS * triangles

    edge, _ = brentq(excess, 1e-4 * mesh.diagonal, mesh.diagonal, full_output=True)
    lengths = zone_lengths(edge)
    current = min(edge, max(longest.min(), SMALLEST_FACTOR * edge))
    points, faces = remesh_isotropic(mesh.vertices, mesh.triangles, current)
    for length in np.unique(lengths[lengths != current]):
        selected = lengths[zone_of(points[faces].mean(axis=1), solid.zones) + 1] == length
        points, faces = remesh_isotropic(points, faces, float(length), selected=selected)
    return TriMesh(points, faces)


@dataclass(frozen=True, eq=False)
class Projector:
    """Newton projection on the zero set of a field, and of a second field for rim vertices."""

    field: Field
    opening: Callable[[np.ndarray], np.ndarray]
    size: float
    """Model size: finite differences and the band of the field are relative to it."""

    def _value_and_gradient(
        self, function: Callable[[np.ndarray], np.ndarray], points: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        eps = 1e-5 * self.size
        offsets = np.vstack([np.zeros(3), eps * np.eye(3), -eps * np.eye(3)])
        value = function((points[None] + offsets[:, None]).reshape(-1, 3)).reshape(7, -1)
        return value[0], (value[1:4] - value[4:7]).T / (2 * eps)

    def _distance(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        return self.field(points, 0.05 * self.size)

    def onto_surface(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Move each point along the gradient at its start onto the surface (two chord steps)."""
        f, g = self._value_and_gradient(self._distance, points)
        step = g / np.maximum(np.einsum("ij,ij->i", g, g), 0.05)[:, None]
        points = points - f[:, None] * step
        return points - self._distance(points)[:, None] * step

    def onto_rim(self, points: Float[np.ndarray, "n 3"], steps: int = 3) -> Float[np.ndarray, "n 3"]:
        """Move each point by the shortest step that makes both linearised fields zero."""
        for _ in range(steps):
            f, g = self._value_and_gradient(self._distance, points)
            c, d = self._value_and_gradient(self.opening, points)
            jacobian = np.stack([g, d], axis=1)
            gram = jacobian @ jacobian.transpose(0, 2, 1)
            weight = np.linalg.solve(gram, np.stack([f, c], axis=1)[..., None])
            points = points - (jacobian.transpose(0, 2, 1) @ weight)[..., 0]
        return points

    def project(self, mesh: TriMesh) -> TriMesh:
        """Project every vertex, rim vertices on the rim."""
        rim = mesh.topology.on_boundary
        points = mesh.vertices.copy()
        points[rim] = self.onto_rim(points[rim])
        points[~rim] = self.onto_surface(points[~rim])
        return TriMesh(points, mesh.triangles)

    def relax(self, mesh: TriMesh, sweeps: int) -> TriMesh:
        """Even out the triangles: half-steps to the mean of the neighbours within the tangent plane, projected.

        In between, vertices follow their normals onto the surface; the last projection is exact. Rim vertices move
        towards the mean of their two rim neighbours only.
        """
        t = mesh.topology
        rim = t.on_boundary
        rim_edges = t.edges[t.edge_count == 1]
        points = mesh.vertices
        for _ in range(sweeps):
            normal = TriMesh(points, mesh.triangles).vertex_normals
            shift = (_neighbour_mean(points, t.edges) - points) / 2
            shift -= np.einsum("ij,ij->i", shift, normal)[:, None] * normal
            moved = points + shift
            moved -= self._distance(moved)[:, None] * normal
            moved[rim] = self.onto_rim(((points + _neighbour_mean(points, rim_edges)) / 2)[rim], steps=1)
            points = moved
        return self.project(TriMesh(points, mesh.triangles))


def _neighbour_mean(points: Float[np.ndarray, "v 3"], edges: Int[np.ndarray, "e 2"]) -> Float[np.ndarray, "v 3"]:
    count = np.bincount(edges.ravel(), minlength=len(points))
    total = np.stack(
        [
            np.bincount(edges[:, 0], weights=points[edges[:, 1], k], minlength=len(points))
            + np.bincount(edges[:, 1], weights=points[edges[:, 0], k], minlength=len(points))
            for k in range(3)
        ],
        axis=1,
    )
    return total / np.maximum(count, 1)[:, None]
