"""Nodes of a quad mesh that live on a surface: where they are, which ways they may go, and how they get there."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from drl_meshgen.errors import InputError
from drl_meshgen.mesh import FeatureCurve, QuadMesh, TriMesh
from drl_meshgen.smoothing.curves import CurveTrack
from drl_meshgen.smoothing.walk import SurfaceWalker

MIN_GAP = 0.05
"""Boundary nodes that start closer than this share of the mean spacing, or in the wrong order, are spread."""
MAX_APPROACH = 0.4
"""Largest share of the gap to its neighbour that a boundary node may cross in one step."""


def shortened(step: Float[np.ndarray, "n 2"], reach: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 2"]:
    """Return steps of which none is longer than its reach."""
    length = np.linalg.norm(step, axis=1)
    return step * np.divide(reach, length, out=np.ones_like(length), where=length > reach)[:, None]


@dataclass(frozen=True, eq=False)
class NodeState:
    """Positions of all nodes with what is needed to move on: all arrays are per node."""

    triangle: Int[np.ndarray, " n"]
    weights: Float[np.ndarray, "n 3"]
    s: Float[np.ndarray, " b"]
    """Coordinate of each sliding node along its curve (see `CurveTrack`)."""
    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    tangents: Float[np.ndarray, "2 n 3"]
    """Directions the two unknowns of a node stand for; zero where a node has fewer."""


@dataclass(frozen=True, eq=False)
class Chain:
    """Nodes in order along a feature curve of the surface (by number), linked by mesh edges; the last not the first."""

    feature: int
    nodes: Int[np.ndarray, " k"]
    pinned: Bool[np.ndarray, " k"]
    """Nodes that stay: the ends of the curve and its corners."""
    s: Float[np.ndarray, " k"]
    """Where on the curve the nodes start (see `CurveTrack`)."""


class NodeSpace:
    """The unknowns of a mesh on a surface: two tangential ones inside, one on curves, none where fixed or pinned.

    Boundary nodes slide along the boundary, those of `chains` along `features`. With `corner_turn` (radians) the
    boundary node next to a corner of the boundary at least that sharp is put there and pinned, if the angle at the
    corner, shared by the quads there, is within `corner_limits` (radians).
    """

    def __init__(
        self,
        surface: TriMesh,
        mesh: QuadMesh,
        fixed: Bool[np.ndarray, " n"] | None = None,
        *,
        features: Sequence[FeatureCurve] = (),
        chains: Sequence[Chain] = (),
        corner_turn: float = np.inf,
        corner_limits: tuple[float, float] = (0.0, np.inf),
    ) -> None:
        self.walker = SurfaceWalker(surface)
        self.track = CurveTrack(self.walker, features)
        self.mesh = mesh
        self.fixed = np.zeros(len(mesh.points), bool) if fixed is None else np.asarray(fixed, bool)
        loops = mesh.topology.loops
        if len(loops) > self.track.n_loops:
            defect = f"the mesh has {len(loops)} boundary loops, the surface {self.track.n_loops}"
            raise InputError("quad mesh", defect)
        rows = [*loops, *(chain.nodes for chain in chains)]
        closed = [True] * len(loops) + [features[chain.feature].closed for chain in chains]
        self.sliding = np.concatenate([*rows, np.empty(0, np.int64)])
        self._next, self._previous = _neighbours([len(row) for row in rows], closed)
        self._curve = np.zeros(len(self.sliding), np.int64)
        self._slot = np.full(len(mesh.points), -1)
        self._slot[self.sliding[::-1]] = np.arange(len(self.sliding))[::-1]
        self._start = np.zeros(len(self.sliding))
        self.pinned = np.zeros(len(mesh.points), bool)
        first = 0
        for row in rows[: len(loops)]:
            slots = slice(first, first + len(row))
            self._curve[slots], self._start[slots] = self._boundary_row(row)
            self._pin_corners(slots, corner_turn, corner_limits)
            first = slots.stop
        for chain in chains:
            slots = slice(first, first + len(chain.nodes))
            self._curve[slots], self._start[slots] = self.track.n_loops + chain.feature, chain.s
            self.pinned[chain.nodes[chain.pinned]] = True
            self._meet_boundary(chain.nodes, slots)
            first = slots.stop

    def _boundary_row(self, row: Int[np.ndarray, " k"]) -> tuple[int, Float[np.ndarray, " k"]]:
        """Boundary loop that most nodes of a loop of the mesh are nearest to, and their places on it."""
        near, s, _ = self.track.project(self.mesh.points[row], np.arange(self.track.n_loops))
        loop = int(np.bincount(near).argmax())
        return loop, self._spread(loop, s, near == loop)

    def _pin_corners(self, slots: slice, least_turn: float, limits: tuple[float, float]) -> None:
        """Put the nearest of a row of boundary nodes on each sharp corner that suits the quads there."""
        if least_turn >= np.pi:
            return
        curve, s, nodes = int(self._curve[slots.start]), self._start[slots], self.sliding[slots]
        length, quads_at = self.track.length[curve], np.bincount(self.mesh.quads.ravel())[nodes]
        for corner, angle in zip(*self.track.corners(curve, 0.5 * length / len(s), least_turn), strict=True):
            gap = np.abs(s - corner)
            k = int(np.argmin(np.minimum(gap, length - gap)))
            share = angle / quads_at[k]
            if not self.pinned[nodes[k]] and limits[0] <= share <= limits[1]:
                s[k] = corner
                self.pinned[nodes[k]] = True

    def _meet_boundary(self, row: Int[np.ndarray, " k"], slots: slice) -> None:
        """Take nodes of a chain that are on the boundary too along it to where the chain has them."""
        mine = np.arange(slots.start, slots.stop)
        met = self._slot[row] < slots.start
        other = self._slot[row[met]]
        points = self.track.points(self._curve[mine[met]], self._start[mine[met]])
        for slot, point in zip(other, points, strict=True):
            self._start[slot] = self.track.project(point[None], self._curve[slot : slot + 1])[1][0]

    @property
    def free(self) -> Bool[np.ndarray, " n"]:
        """Nodes that may go anywhere on the surface."""
        return (self._slot < 0) & ~self.fixed

    def start(self, triangle: Int[np.ndarray, " n"]) -> NodeState:
        """Return the state with nodes at `mesh.points`, `triangle[k]` carrying node `k`; those on curves moved there.

        Boundary nodes that are out of order along the boundary are spread.
        """
        return self._state(triangle.copy(), self.walker.locate(triangle, self.mesh.points), self._start)

    def _spread(self, loop: int, s: Float[np.ndarray, " k"], known: Bool[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Coordinates of one mesh loop in strictly increasing order, changed only where they are not."""
        length, count = self.track.length[loop], len(s)
        gap = np.mod(np.roll(s, -1) - s, length)
        in_order = known.all() and abs(gap.sum() - length) < 1e-6 * length and gap.min() > MIN_GAP * length / count
        if in_order:
            return s
        if abs(gap.sum() - length) > 0.5 * length or not known.all():
            # somewhere a node lies behind its predecessor: such gaps are nearly a whole turn
            gap = np.where((gap > 0.5 * length) | ~known | ~np.roll(known, -1), 0.0, gap)
        gap = np.maximum(gap, MIN_GAP * length / count)
        gap *= length / gap.sum()
        first = int(np.argmax(known))
        turned = np.r_[0.0, np.cumsum(np.roll(gap, -first))[:-1]]
        fixed_first = self.track.wrap(np.full(count, loop), s[first] + turned)
        return np.roll(fixed_first, first)

    def _tangents(
        self, normals: Float[np.ndarray, "k 3"], nodes: Int[np.ndarray, " k"], direction: Float[np.ndarray, "b 3"]
    ) -> Float[np.ndarray, "2 k 3"]:
        tangents = tangent_frame(normals)
        slot = self._slot[nodes]
        sliding = slot >= 0
        tangents[0, sliding], tangents[1, sliding] = direction[slot[sliding]], 0.0
        tangents[:, self.fixed[nodes] | self.pinned[nodes]] = 0.0
        return tangents

    def _state(
        self, triangle: Int[np.ndarray, " n"], weights: Float[np.ndarray, "n 3"], s: Float[np.ndarray, " b"]
    ) -> NodeState:
        direction = np.empty((0, 3))
        if self.sliding.size:
            triangle[self.sliding], weights[self.sliding], direction = self.track.locate(self._curve, s)
        points = self.walker.positions(triangle, weights)
        points[self.fixed] = self.mesh.points[self.fixed]
        normals = self.walker.normals(triangle, weights)
        return NodeState(
            triangle, weights, s, points, normals, self._tangents(normals, np.arange(len(points)), direction)
        )

    def freeze(self, state: NodeState, moving: Bool[np.ndarray, " n"]) -> NodeState:
        """Return the state with the tangents of all nodes but the moving ones set to zero: they stay for good."""
        return replace(state, tangents=state.tangents * moving[:, None])

    def thaw(self, state: NodeState) -> NodeState:
        """Undo `freeze`."""
        return self._state(state.triangle.copy(), state.weights.copy(), state.s)

    def mixed(self, old: NodeState, new: NodeState, take: Bool[np.ndarray, " n"]) -> NodeState:
        """Return the state that has the chosen nodes where `new` has them and the others where `old` has them."""
        chosen = take[:, None]
        return NodeState(
            np.where(take, new.triangle, old.triangle),
            np.where(chosen, new.weights, old.weights),
            np.where(take[self.sliding], new.s, old.s),
            np.where(chosen, new.points, old.points),
            np.where(chosen, new.normals, old.normals),
            np.where(chosen, new.tangents, old.tangents),
        )

    def _gaps(self, s: Float[np.ndarray, " b"]) -> Float[np.ndarray, " b"]:
        """Way along the curve to the next node of each row."""
        ahead = s[self._next] - s
        return np.where(self.track.closed[self._curve], np.mod(ahead, self.track.length[self._curve]), np.abs(ahead))

    def moved(self, state: NodeState, step: Float[np.ndarray, "n 2"]) -> NodeState:
        """Return the state after moving each node by `step` in units of its tangents."""
        step = np.where(state.tangents.any(axis=2).T, step, 0.0)
        going = np.nonzero(step.any(axis=1))[0]
        displacement = np.einsum("kni,nk->ni", state.tangents[:, going], step[going])
        triangle, weights, s = state.triangle.copy(), state.weights.copy(), state.s
        inner = self._slot[going] < 0
        walking = going[inner]
        triangle[walking], weights[walking] = self.walker.walk(triangle[walking], weights[walking], displacement[inner])
        direction = np.empty((0, 3))
        if not inner.all():
            gap = self._gaps(s)
            slide = np.clip(step[self.sliding, 0], -MAX_APPROACH * gap[self._previous], MAX_APPROACH * gap)
            s = self.track.wrap(self._curve, s + slide)
            on_track, at, direction = self.track.locate(self._curve, s)
            slots = self._slot[going[~inner]]
            triangle[going[~inner]], weights[going[~inner]] = on_track[slots], at[slots]
        points, normals, tangents = state.points.copy(), state.normals.copy(), state.tangents.copy()
        points[going] = self.walker.positions(triangle[going], weights[going])
        normals[going] = self.walker.normals(triangle[going], weights[going])
        tangents[:, going] = self._tangents(normals[going], going, direction)
        return NodeState(triangle, weights, s, points, normals, tangents)


def _neighbours(sizes: Sequence[int], closed: Sequence[bool]) -> tuple[Int[np.ndarray, " s"], Int[np.ndarray, " s"]]:
    """Slots after and before each slot of consecutive rows; at the ends of open rows the slot itself."""
    following, preceding, first = [], [], 0
    for size, around in zip(sizes, closed, strict=True):
        slot = np.arange(first, first + size)
        following.append(np.roll(slot, -1) if around else np.minimum(slot + 1, first + size - 1))
        preceding.append(np.roll(slot, 1) if around else np.maximum(slot - 1, first))
        first += size
    none = np.empty(0, np.int64)
    return np.concatenate([none, *following]), np.concatenate([none, *preceding])


def tangent_frame(normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "2 n 3"]:
    """Two unit vectors orthogonal to each unit normal (Duff et al., JCGT 6(1), 2017)."""
    x, y, z = normals.T
    sign = np.where(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1)
    second = np.stack([b, sign + y * y * a, -y], axis=1)
    return np.stack([first, second])
