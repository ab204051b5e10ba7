"""How good a quad mesh is, in the few figures the optimiser steers by."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from drl_meshgen.mesh import QuadMesh, TriMesh
from drl_meshgen.quality.normals import least_agreeing_normals
from drl_meshgen.smoothing.energy import Shape, beyond, log_wanted_areas, shape_of
from drl_meshgen.smoothing.nodes import NodeState
from drl_meshgen.smoothing.options import SmoothingOptions

FOLDED = 180.0
"""Penalty of a folded quad, in degrees beyond the wanted angles."""
HOPELESS = 1000.0
"""The same where places are tried: no gain in angles makes up for a folded quad."""
FIRST_PLACES = 2
"""Places whose quads are oriented exactly at first; twice as many each time after."""
JUMP = 20.0
"""Penalty of an area ratio of e times the wanted one, in degrees beyond the wanted angles."""
SIZE = 20.0
"""Penalty of areas that miss the wanted ones by a factor of e (root mean square), in degrees."""
AGREEMENT = 0.5
"""A quad is judged by the surface triangle nearest to its centroid unless its normal and those of the surface at its
corners agree at least this well (cosine)."""


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
    size_error: float
    """Root mean square of the log ratio of areas to wanted ones; 0 where sizes do not vary."""

    def shortfall(self, options: SmoothingOptions) -> float:
        """Single figure to compare meshes by, smaller is better: folded quads first, then missed limits."""
        low, high = options.wanted_angles
        missed = max(0.0, low - self.min_angle) + max(0.0, self.max_angle - high)
        missed += JUMP * max(0.0, np.log(self.area_ratio / options.wanted_area_ratio))
        return 1e3 * self.invalid + missed + 100 * (1 - self.orthogonality) + SIZE * self.size_error


class Referee:
    """Judges states of one mesh on one surface as an outsider would: only the shape of the quads counts."""

    def __init__(
        self,
        surface: TriMesh,
        mesh: QuadMesh,
        options: SmoothingOptions,
        sizes: Float[np.ndarray, "f 3"] | None = None,
    ) -> None:
        self.surface, self.mesh, self.options, self.sizes = surface, mesh, options, sizes
        self.quads = np.ascontiguousarray(mesh.quads.T)
        self.pairs = np.ascontiguousarray(mesh.topology.edge_faces[mesh.topology.edge_count == 2].T)

    @cached_property
    def _nearest(self) -> Any:
        import pyvista as pv  # heavy: loaded only where quads are in doubt

        return pv.PolyData.from_regular_faces(self.surface.vertices, self.surface.triangles)

    def shape(self, state: NodeState, *, exact: bool = False) -> Shape:
        """Geometry of all quads, oriented by the surface triangle nearest to the centroid (if in doubt or `exact`)."""
        corner_normals = state.normals.T[:, self.quads]
        up = corner_normals.sum(axis=1)
        shape = shape_of(self.quads, state.points, up)
        agreement = np.einsum("im,icm->cm", shape.normal, corner_normals).min(axis=0)
        doubt = np.nonzero(agreement < (2.0 if exact else AGREEMENT))[0]
        if doubt.size:
            up[:, doubt] = self._under(np.moveaxis(shape.corners[:, :, doubt], (0, 1, 2), (2, 1, 0))).T
            shape = shape_of(self.quads, state.points, up)
        return shape

    def _under(self, corners: Float[np.ndarray, "m 4 3"]) -> Float[np.ndarray, "m 3"]:
        """Return the normal of the surface nearest to each quad's centroid.

        Where the nearest point lies on an edge or vertex of the surface, it is up to the searcher which triangle is
        found; the normal that agrees least with the quad is taken, so that the verdict holds for every searcher.
        """
        found, points = self._nearest.find_closest_cell(corners.mean(axis=1), return_closest_point=True)
        own = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        return least_agreeing_normals(self.surface, np.atleast_1d(found), np.atleast_2d(points), own)

    def figures(self, state: NodeState, *, exact: bool = False) -> Figures:
        """Worst angles, area ratio and number of folded quads."""
        shape = self.shape(state, exact=exact)
        angle = outer_angles(shape)
        jump = np.abs(self._jumps(shape)).max(initial=0.0)
        skew = np.clip(np.abs(angle - 90).max(axis=0) / 90, 0, 1)
        return Figures(
            invalid=int((~shape.valid).sum()),
            min_angle=float(angle.min()),
            max_angle=float(angle.max()),
            area_ratio=float(np.exp(min(jump, 700.0))),
            orthogonality=float(1 - skew.mean()),
            size_error=self._size_error(state, shape),
        )

    def _size_error(self, state: NodeState, shape: Shape) -> float:
        if self.sizes is None:
            return 0.0
        wanted = log_wanted_areas(state, self.sizes, np.arange(len(state.points)))[self.quads].mean(axis=0)
        return float(np.std(np.log(np.maximum(np.abs(shape.area), np.finfo(float).tiny)) - wanted))

    def _jumps(self, shape: Shape) -> Float[np.ndarray, " e"]:
        area = np.maximum(np.abs(shape.area), np.finfo(float).tiny)
        return np.log(area[self.pairs[0]] / area[self.pairs[1]])

    def penalties(self, state: NodeState) -> Float[np.ndarray, " m"]:
        """Squared amount by which each quad misses the wanted limits, in degrees; folded ones miss by much."""
        shape, (low, high) = self.shape(state), self.options.wanted_angles
        angle = outer_angles(shape)
        missed = np.maximum(low - angle, 0).max(axis=0) + np.maximum(angle - high, 0).max(axis=0)
        excess = JUMP * np.abs(beyond(self._jumps(shape), np.log(self.options.wanted_area_ratio)))
        total = (missed + FOLDED * ~shape.valid) ** 2
        return total + np.bincount(self.pairs.ravel(), np.tile(0.5 * excess**2, 2), minlength=len(total))

    def best_of_places(self, corners: Float[np.ndarray, "p q 4 3"]) -> int:
        """Return which of `p` sets of corner positions of `q` quads has the least sum of squared penalties.

        A quad is oriented by the surface under it. The lesser of its penalties one way up and the other is a bound
        without asking: the surface is asked for the most promising places only, until no bound is below the best.
        """
        quads = np.arange(corners[..., 0].size).reshape(-1, 4).T
        flat = corners.reshape(-1, 3)
        facing = np.cross(corners[..., 2, :] - corners[..., 0, :], corners[..., 3, :] - corners[..., 1, :])
        shape = shape_of(quads, flat, facing.reshape(-1, 3).T)
        angle = outer_angles(shape)
        upright = self._lost(angle, shape.valid).reshape(len(corners), -1)
        over = self._lost(360 - angle, np.zeros_like(shape.valid)).reshape(len(corners), -1)
        bound = np.minimum(upright, over).sum(axis=1)
        order = np.argsort(bound, kind="stable")
        best, least, first, many = int(order[0]), np.inf, 0, FIRST_PLACES
        while first < len(order) and bound[order[first]] < least:
            some = order[first : first + many]
            up = self._under(corners[some].reshape(-1, 4, 3)).reshape(len(some), -1, 3)
            down = np.einsum("pqi,pqi->pq", up, facing[some]) < 0
            total = np.where(down, over[some], upright[some]).sum(axis=1)
            if total.min() < least:
                best, least = int(some[np.argmin(total)]), float(total.min())
            first, many = first + many, 2 * many
        return best

    def _lost(self, angle: Float[np.ndarray, "4 m"], valid: Bool[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Squared amount by which quads miss the wanted limits, where no gain in angles makes up for a folded one."""
        low, high = self.options.wanted_angles
        missed = np.maximum(low - angle, 0).max(axis=0) + np.maximum(angle - high, 0).max(axis=0)
        return (missed + HOPELESS * ~valid) ** 2

    def bad(self, state: NodeState) -> Bool[np.ndarray, " m"]:
        """Quads beyond the limits of repair."""
        shape, (low, high) = self.shape(state), self.options.repair_angles
        angle = outer_angles(shape)
        jump = np.abs(self._jumps(shape)) > np.log(self.options.repair_area_ratio)
        bad = (angle < low).any(axis=0) | (angle > high).any(axis=0) | ~shape.valid
        bad[self.pairs[:, jump].ravel()] = True
        return bad


def outer_angles(shape: Shape) -> Float[np.ndarray, "4 m"]:
    """Corner angles in degrees from 0 to 360."""
    return np.degrees(np.mod(shape.angle, 2 * np.pi))
