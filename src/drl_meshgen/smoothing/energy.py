"""Shape of quads on a surface as residuals of a least-squares problem, and their exact derivatives.

Arrays of vectors have the component first and the quad last, `(3, 4, m)`: numpy is fastest that way.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import bsr_array, csr_array

from drl_meshgen.mesh import QuadMesh
from drl_meshgen.smoothing.nodes import NodeState
from drl_meshgen.smoothing.options import SmoothingOptions

TINY = np.finfo(float).tiny
AREA_FLOOR = 0.02
"""Quads below this share of the mean area count with this area in the log ratio, so folded ones have one too."""
ROWS = 8
"""Residuals per quad: 4 corner angles, 1 aspect, 2 dihedral angles, 1 log area."""


def cross(a: Float[np.ndarray, "3 ..."], b: Float[np.ndarray, "3 ..."]) -> Float[np.ndarray, "3 ..."]:
    """Cross product along the first axis."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


def dot(a: Float[np.ndarray, "3 ..."], b: Float[np.ndarray, "3 ..."]) -> Float[np.ndarray, "..."]:
    """Scalar product along the first axis."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def unit(a: Float[np.ndarray, "3 ..."]) -> Float[np.ndarray, "3 ..."]:
    """Scale vectors along the first axis to length one (zero stays zero)."""
    return a / np.sqrt(np.maximum(dot(a, a), TINY))


@dataclass(frozen=True, eq=False)
class Shape:
    """Geometry of `m` quads: everything the residuals and the verdict on a mesh are made of."""

    corners: Float[np.ndarray, "3 4 m"]
    ahead: Float[np.ndarray, "3 4 m"]
    """From each corner to the next."""
    behind: Float[np.ndarray, "3 4 m"]
    """From each corner to the one before."""
    normal: Float[np.ndarray, "3 m"]
    """Unit normal of the diagonals, on the side of the surface's normal."""
    corner_cross: Float[np.ndarray, "3 4 m"]
    jacobian: Float[np.ndarray, "4 m"]
    angle: Float[np.ndarray, "4 m"]
    """Corner angles in radians, from -pi/2 (folded) to 3 pi/2 (reflex)."""
    area: Float[np.ndarray, " m"]
    """Signed area of the projection along `normal`."""

    @property
    def valid(self) -> Bool[np.ndarray, " m"]:
        """Quads whose four Jacobians are positive."""
        return np.all(self.jacobian > 0, axis=0)


def shape_of(quads: Int[np.ndarray, "4 m"], points: Float[np.ndarray, "n 3"], up: Float[np.ndarray, "3 m"]) -> Shape:
    """Geometry of quads given by rows of corner ids; `up` is the surface's normal at each (any length)."""
    p = points.T[:, quads]
    ahead = np.empty_like(p)
    ahead[:, :3] = p[:, 1:] - p[:, :3]
    ahead[:, 3] = p[:, 0] - p[:, 3]
    behind = np.empty_like(p)
    behind[:, 1:] = -ahead[:, :3]
    behind[:, 0] = -ahead[:, 3]
    diagonals = cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    sign = np.where(dot(diagonals, up) < 0, -1.0, 1.0)
    length = np.sqrt(dot(diagonals, diagonals))
    normal = diagonals * (sign / np.maximum(length, TINY))
    corner_cross = cross(ahead, behind)
    jacobian = dot(corner_cross, normal[:, None])
    angle = np.arctan2(np.copysign(np.sqrt(dot(corner_cross, corner_cross)), jacobian), dot(ahead, behind))
    angle[angle < -np.pi / 2] += 2 * np.pi
    return Shape(p, ahead, behind, normal, corner_cross, jacobian, angle, 0.5 * sign * length)


def ideal_angles(mesh: QuadMesh) -> Float[np.ndarray, "4 m"]:
    """Equal share of the full turn for the corners at an interior node, of the half turn at a boundary node.

    A boundary node with a single quad is taken for a corner of the outline: a right angle.
    """
    topology = mesh.topology
    quads_at = np.bincount(mesh.quads.ravel(), minlength=len(mesh.points))
    turn = np.where(topology.on_boundary, np.where(quads_at == 1, np.pi / 2, np.pi), 2 * np.pi)
    return (turn / np.maximum(quads_at, 1))[mesh.quads].T


@dataclass(frozen=True, eq=False)
class Residuals:
    """Values of all residuals, unweighted (radians and logarithms)."""

    shape: Shape
    rows: Float[np.ndarray, "8 m"]
    """Deviation of the corner angles (4), log of side ratio (1), dihedral angles (2), log area (1) of each quad."""
    jump: Float[np.ndarray, " e"]
    """Difference of the log areas across each inner edge."""
    wish: Float[np.ndarray, " m"]
    """Log of the wanted area of each quad, up to a constant."""


@dataclass(frozen=True, eq=False)
class System:
    """Gauss-Newton system `H x = -g`; unknowns are `2 * node + direction`.

    H is the matrix of all residuals within quads plus, in factored form, that of the area jumps between them.
    """

    within: bsr_array
    area: csr_array
    """Derivative of the log areas."""
    pair_weight: Float[np.ndarray, " e"]
    difference: csr_array
    gradient: Float[np.ndarray, " u"]
    diagonal_blocks: Float[np.ndarray, "3 n"]
    """Entries (0,0), (0,1), (1,1) of each node's block of H; the coupling of areas is left out."""

    def multiply(self, x: Float[np.ndarray, " u"]) -> Float[np.ndarray, " u"]:
        """Apply H."""
        jumps = self.pair_weight * (self.difference @ (self.area @ x))
        return self.within @ x + self.area.T @ (self.difference.T @ jumps)


class QuadEnergy:
    """Weighted least squares of the shape of chosen quads of a mesh.

    The cost is the sum of squared weighted residuals plus squared hinge penalties outside the wanted limits.
    """

    def __init__(
        self,
        mesh: QuadMesh,
        options: SmoothingOptions,
        chosen: Int[np.ndarray, " m"] | None = None,
        ideal: Float[np.ndarray, "4 k"] | None = None,
        sizes: Float[np.ndarray, "f 3"] | None = None,
    ) -> None:
        everything = mesh.quads
        ideal = ideal_angles(mesh) if ideal is None else ideal
        pairs = mesh.topology.edge_faces[mesh.topology.edge_count == 2]
        if chosen is None:
            chosen = np.arange(len(everything))
        else:
            local = np.full(len(everything), -1)
            local[chosen] = np.arange(len(chosen))
            pairs = local[pairs]
            pairs = pairs[(pairs >= 0).all(axis=1)]
        self.options = options
        self.ids, quads = np.unique(everything[chosen], return_inverse=True)
        self.quads = np.ascontiguousarray(quads.reshape(-1, 4).T)
        self.ideal = np.ascontiguousarray(ideal[:, chosen])
        self.pairs = np.ascontiguousarray(pairs.T)
        self.sizes = sizes
        self.size_weight = 0.0 if sizes is None else options.size_weight
        self.hinge = 0.0

    @property
    def n_nodes(self) -> int:
        """Nodes of the chosen quads; `ids` are their numbers in the mesh."""
        return len(self.ids)

    def with_hinge(self, weight: float) -> "QuadEnergy":
        """Return the same energy with another weight of the hinge penalties."""
        twin = object.__new__(QuadEnergy)
        twin.__dict__.update(self.__dict__)
        twin.hinge = weight
        return twin

    # -- values ------------------------------------------------------------------------------------------------

    def shape(self, state: NodeState) -> Shape:
        """Geometry of the chosen quads."""
        normals = state.normals[self.ids].T
        up = normals[:, self.quads].sum(axis=1)
        return shape_of(self.quads, state.points[self.ids], up)

    def residuals(self, state: NodeState) -> Residuals:
        """Evaluate all residuals."""
        shape = self.shape(state)
        p = shape.corners
        rows = np.empty((ROWS, p.shape[2]))
        rows[:4] = shape.angle - self.ideal
        sides = np.sqrt(dot(shape.ahead, shape.ahead))
        rows[4] = np.log(np.maximum(sides[0] + sides[2], TINY) / np.maximum(sides[1] + sides[3], TINY))
        n = shape.corner_cross
        for k in range(2):
            axis = p[:, k + 2] - p[:, k]
            # normals of the triangles on both sides of the diagonal from corner k to corner k + 2
            first, second = n[:, k + 1], n[:, (k + 3) % 4]
            sine = dot(cross(first, second), axis) / np.sqrt(np.maximum(dot(axis, axis), TINY))
            rows[5 + k] = np.arctan2(sine, dot(first, second))
        rows[7] = np.log(np.maximum(shape.area, AREA_FLOOR * np.abs(shape.area).mean() + TINY))
        return Residuals(shape, rows, rows[7, self.pairs[0]] - rows[7, self.pairs[1]], self._wish(state))

    def _wish(self, state: NodeState) -> Float[np.ndarray, " m"]:
        if self.sizes is None:
            return np.zeros(self.quads.shape[1])
        return log_wanted_areas(state, self.sizes, self.ids)[self.quads].mean(axis=0)

    def _wanted_jump(self, r: Residuals) -> Float[np.ndarray, " e"]:
        return r.wish[self.pairs[0]] - r.wish[self.pairs[1]]

    def _excess(self, r: Residuals) -> Float[np.ndarray, " m"]:
        """Log ratio of the area of each quad to the wanted one, less the mean."""
        excess = r.rows[7] - r.wish
        return excess - excess.mean()

    def _violations(self, r: Residuals) -> tuple[Float[np.ndarray, "7 m"], Float[np.ndarray, " e"]]:
        """Signed amounts by which angles (4), aspect (1), dihedral angles (2) and area jumps exceed the limits."""
        o = self.options
        low, high = np.radians(o.wanted_angles) + np.radians([o.margin, -o.margin])
        over = np.empty((7, r.rows.shape[1]))
        over[:4] = np.minimum(r.shape.angle - low, 0) + np.maximum(r.shape.angle - high, 0)
        over[4] = beyond(r.rows[4], np.log(o.wanted_aspect))
        over[5:] = beyond(r.rows[5:7], np.radians(o.wanted_warp))
        return over, beyond(r.jump, np.log(o.wanted_area_ratio))

    def quad_costs(self, r: Residuals) -> Float[np.ndarray, " m"]:
        """Weighted sum of squares of each quad, hinge penalties included; edges count half for each side."""
        o = self.options
        rows = r.rows
        total = (rows[:4] ** 2).sum(axis=0) + o.aspect_weight**2 * rows[4] ** 2
        total += o.warp_weight**2 * (rows[5:7] ** 2).sum(axis=0)
        total += self.size_weight**2 * self._excess(r) ** 2
        jumps = o.area_weight**2 * (r.jump - self._wanted_jump(r)) ** 2
        if self.hinge:
            over, jump = self._violations(r)
            total += self.hinge**2 * (over**2).sum(axis=0)
            jumps += self.hinge**2 * jump**2
        return total + np.bincount(self.pairs.ravel(), np.tile(0.5 * jumps, 2), minlength=len(total))

    # -- derivatives -------------------------------------------------------------------------------------------

    @cached_property
    def _pattern(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, csr_array]:
        """Block pattern of H: column and row starts, block of each pair of corners (4 4 m); area columns; difference.

        The difference operator maps log areas to their jumps.
        """
        q, n = self.quads.astype(np.int64), self.n_nodes
        m, e = q.shape[1], self.pairs.shape[1]
        code, block = np.unique(q[:, None] * n + q[None], return_inverse=True)
        starts = np.searchsorted(code, n * np.arange(n + 1))
        columns = (2 * q.T[:, :, None] + np.arange(2)).ravel().astype(np.int32)
        data = np.tile([1.0, -1.0], e)
        difference = csr_array((data, self.pairs.T.ravel(), np.arange(0, 2 * e + 1, 2)), (e, m))
        return (code % n).astype(np.int32), starts.astype(np.int32), block.ravel(), columns, difference

    def derivatives(self, state: NodeState, r: Residuals) -> Float[np.ndarray, "8 4 2 m"]:
        """Differentiate each row of residuals by the two unknowns of each corner of the quad."""
        s, m = r.shape, self.quads.shape[1]
        tangents = state.tangents[:, self.ids].transpose(2, 0, 1)[:, :, self.quads]  # 3 2 4 m
        out = np.zeros((ROWS, 4, 2, m))

        def put(row: int, corner: int, vector: np.ndarray) -> None:
            for direction in range(2):
                out[row, corner, direction] = dot(vector, tangents[:, direction, corner])

        # corner angle: turning a side about the corner's normal changes it at rate 1 / length
        flip = np.where(s.jacobian < 0, -1.0, 1.0)
        size2 = dot(s.corner_cross, s.corner_cross)
        ahead2, behind2 = np.maximum(dot(s.ahead, s.ahead), TINY), np.maximum(dot(s.behind, s.behind), TINY)
        flat = size2 < 1e-12 * ahead2 * behind2
        about = np.where(flat, s.normal[:, None], s.corner_cross * (flip / np.sqrt(np.maximum(size2, TINY))))
        turn_ahead, turn_behind = -cross(about, s.ahead) / ahead2, cross(about, s.behind) / behind2
        for c in range(4):
            put(c, (c + 1) % 4, turn_ahead[:, c])
            put(c, c, -turn_ahead[:, c] - turn_behind[:, c])
            put(c, (c + 3) % 4, turn_behind[:, c])

        # side ratio
        side = s.ahead / np.sqrt(ahead2)
        pair_length = np.sqrt(ahead2)[:2] + np.sqrt(ahead2)[2:]
        pull = side / np.concatenate([pair_length, pair_length])
        for c in range(4):
            sign = 1.0 if c % 2 == 0 else -1.0
            put(4, c, sign * (-pull[:, c] - pull[:, c - 1]))

        # dihedral angles at the diagonals: the triangles' normals over their heights
        for k in range(2):
            axis = s.corners[:, k + 2] - s.corners[:, k]
            length = np.sqrt(np.maximum(dot(axis, axis), TINY))
            inverse, shares = [], []
            for c in (k + 1, (k + 3) % 4):
                n = s.corner_cross[:, c]
                n2 = np.maximum(dot(n, n), 1e-6 * length**4)
                inverse.append(n * (length / n2))
                shares.append(dot(s.corners[:, c] - s.corners[:, k], axis) / length**2)
            put(5 + k, k + 1, inverse[0])
            put(5 + k, (k + 3) % 4, inverse[1])
            put(5 + k, k + 2, -inverse[0] * shares[0] - inverse[1] * shares[1])
            put(5 + k, k, -inverse[0] * (1 - shares[0]) - inverse[1] * (1 - shares[1]))

        # log area
        scale = 0.5 * np.exp(-r.rows[7])
        for k in range(2):
            other = s.corners[:, 3 - k] - s.corners[:, 1 - k]
            gradient = cross(other, s.normal) * (scale if k == 0 else -scale)
            put(7, k + 2, gradient)
            put(7, k, -gradient)
        return out

    def system(self, state: NodeState, r: Residuals) -> System:
        """Linearise the residuals in the unknowns of the nodes."""
        o, n, m = self.options, self.n_nodes, self.quads.shape[1]
        indices, starts, block, columns, difference = self._pattern
        rows = self.derivatives(state, r)
        weight = np.repeat(
            [[1.0], [o.aspect_weight**2], [o.warp_weight**2], [self.size_weight**2]], (4, 1, 2, 1), axis=0
        )
        weight = np.tile(weight, m)
        pair_weight = np.full(len(r.jump), o.area_weight**2)
        forces = weight * r.rows
        pull_apart = pair_weight * (r.jump - self._wanted_jump(r))
        if self.hinge:
            over, jump = self._violations(r)
            w = self.hinge**2
            forces[:7] += w * over
            pull_apart += w * jump
            weight[:7] += w * (over != 0)
            pair_weight += w * (jump != 0)
        forces[7] = self.size_weight**2 * self._excess(r) + difference.T @ pull_apart
        matrix = np.empty((len(indices), 2, 2))
        weighted = weight[:, None, None] * rows
        for a, b in ((0, 0), (0, 1), (1, 1)):
            products = np.einsum("rcm,rdm->cdm", weighted[:, :, a], rows[:, :, b])
            matrix[:, a, b] = np.bincount(block, products.ravel(), minlength=len(indices))
            if a != b:
                products = products.transpose(1, 0, 2)
                matrix[:, b, a] = np.bincount(block, products.ravel(), minlength=len(indices))
        within = bsr_array((matrix, indices, starts), shape=(2 * n, 2 * n))
        area = csr_array((rows[7].transpose(2, 0, 1).ravel(), columns, np.arange(0, 8 * m + 1, 8)), (m, 2 * n))
        weight[7] += np.bincount(self.pairs.ravel(), np.tile(pair_weight, 2), minlength=m)
        corner = self.quads.ravel()

        def at_nodes(values: Float[np.ndarray, "4 m"]) -> Float[np.ndarray, " n"]:
            return np.bincount(corner, values.ravel(), minlength=n)

        pull = np.einsum("rm,rcam->acm", forces, rows)
        gradient = np.stack([at_nodes(pull[0]), at_nodes(pull[1])], axis=1).ravel()
        weighted[7] = weight[7] * rows[7]
        blocks = [
            at_nodes(np.einsum("rcm,rcm->cm", weighted[:, :, a], rows[:, :, b])) for a, b in ((0, 0), (0, 1), (1, 1))
        ]
        return System(within, area, pair_weight, difference, gradient, np.stack(blocks))


def log_wanted_areas(
    state: NodeState, sizes: Float[np.ndarray, "f 3"], nodes: Int[np.ndarray, " k"]
) -> Float[np.ndarray, " k"]:
    """Log of the squared size at nodes, for `sizes` at the corners of the surface's triangles."""
    return 2 * np.log(np.einsum("nk,nk->n", state.weights[nodes], sizes[state.triangle[nodes]]))


def beyond(value: np.ndarray, limit: float) -> np.ndarray:
    """Signed amount by which values lie outside [-limit, limit]."""
    return value - np.clip(value, -limit, limit)
